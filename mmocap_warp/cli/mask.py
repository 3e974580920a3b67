"""``mmocap mask``: a scene's masks, made once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.cli.exit_codes import UsageError


def mask(
    scene: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    scale: float = 1.0,
    frames: str | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a scene's foreground masks and an overlay of them.

    Parameters
    ----------
    scene
        The scene file, or its folder.
    output
        The folder to write.
    scale
        Of the masks relative to the recording, up to 1.
    frames
        Which of the recording's frames: first:end or first:end:stride, such as 120:480:2, which leaves out the end; or
        a count of those that the scene names. The folder's scene numbers them from 0. [default: those that the scene
        names]
    force
        Write into a folder that holds files.
    """
    from mmocap_warp.cli.judging import scene_for
    from mmocap_warp.cli.next_step import command
    from mmocap_warp.cli.outputs import new_folder
    from mmocap_warp.cli.progress import Progress
    from mmocap_warp.scene.mask_writing import write_masks

    console = console or Console()
    if not 0 < scale <= 1:
        raise UsageError(f"--scale must be in (0, 1], got {scale:g}")
    loaded = scene_for(scene, frames)
    folder = new_folder(output, force=force)
    with Progress("mask", quiet=console.quiet) as progress:
        written = write_masks(loaded, folder, scale, progress=lambda done: progress(done, loaded.frame_count))
    step = command("track", written, "-o", loaded.directory / "result.usdc")
    values = {"scene": written, "overlay": folder / "overlay.webm", "frames": loaded.frame_count, "next": step}
    console.result(values, f"{written}: {loaded.frame_count} frames, {len(loaded.cameras)} cameras\nnext: {step}")
