"""``mmocap mask``: a scene's masks, made once and judged."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import CHECK_FAILED, OK, Console, Identity, Switch
from mmocap_warp.errors import UsageError

if TYPE_CHECKING:
    from mmocap_warp.masks.mask_check import MaskReport
    from mmocap_warp.scene.recording import Scene


def mask(
    scene: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    scale: float = 1.0,
    frames: str | None = None,
    from_body: Path | None = None,
    identity: Identity = None,
    force: Switch = False,
    console: Console | None = None,
) -> int:
    """Write a scene's foreground masks and an overlay of them, and judge whether they show one whole subject.

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
        a count of those that the scene names. [default: those that the scene names]
    from_body
        A result of this scene: draw the masks anew around its body, by the images' colours (GrabCut).
    force
        Write into a folder that holds files.
    """
    from mmocap_warp.cli.console import next_step
    from mmocap_warp.cli.refine_masks import masks_around_body
    from mmocap_warp.commands.inputs import note_others, scene_from
    from mmocap_warp.commands.outputs import new_folder
    from mmocap_warp.masks.mask_check import MaskJudge
    from mmocap_warp.scene.mask_writing import write_masks

    console = console or Console()
    if not 0 < scale <= 1:
        raise UsageError(f"--scale must be in (0, 1], got {scale:g}")
    loaded = scene_from(scene, frames, identity)
    note_others(loaded, console)
    refine = None if from_body is None else masks_around_body(loaded, from_body, scale)
    folder = new_folder(output, force=force)
    judge = MaskJudge(loaded.rig(scale), loaded.frame_count, _body_volume(loaded))
    with console.stage("mask") as progress:
        total = loaded.frame_count
        written = write_masks(
            loaded, folder, scale, progress=lambda done: progress(done, total), look=judge.add, refine=refine
        )
    report = judge.report()
    failed = bool(report.faults)
    step = next_step("track", written, "-o", loaded.directory / "result.usdc")
    values = {
        "scene": written,
        "overlay": folder / "overlay.webm",
        "frames": loaded.frame_count,
        "views": {
            name: {
                "area_px": view.area,
                "empty_frames": int((view.area == 0).sum()),
                "explained": view.explained,
                "covered": view.covered,
            }
            for name, view in report.views.items()
        },
        "hull_litres": 1000 * report.volume,
        "masks_ok": not failed,
        "faults": list(report.faults),
        "next": None if failed else step,
    }
    lines = [f"{written}: {loaded.frame_count} frames, {len(loaded.cameras)} cameras", *_table(report)]
    if failed:
        lines += [f"check failed: {fault}" for fault in report.faults] + [_remedy(loaded, folder)]
    else:
        lines.append(f"next: {step}")
    console.result(values, "\n".join(lines))
    return CHECK_FAILED if failed else OK


def _body_volume(scene: Scene) -> float:
    """What the scene's subject holds, or else the body that a fit would start from [m^3]."""
    from mmocap_warp.formats.usd.usd_body import read_subject
    from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body

    if scene.subject is not None:
        return read_subject(scene.subject).body.volume
    return load_body(scene.body or DEFAULT_BODY, scene.path).volume


def _table(report: MaskReport) -> list[str]:
    """Each view's areas, how many frames are empty, and how well it agrees with the others."""
    import numpy as np

    lines = [f"{'camera':<12} {'median':>8} {'least':>8} {'most':>8} {'empty':>8} {'explained':>10} {'covered':>8}"]
    lines += [f"{'':<12} {'px':>8} {'px':>8} {'px':>8} {'frames':>8} {'%':>10} {'%':>8}"]
    for name, view in report.views.items():
        seen = view.area[view.area > 0]
        areas = (np.median(seen), seen.min(), seen.max()) if len(seen) else (0, 0, 0)
        shares = f"{_percent(view.explained):>10} {_percent(view.covered):>8}"
        columns = " ".join(f"{area:8.0f}" for area in areas)
        lines.append(f"{name:<12} {columns} {(view.area == 0).sum():8d} {shares}")
    return lines


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if share == share else "-"


def _remedy(scene: Scene, folder: Path) -> str:
    """What to do about masks that are not good enough."""
    look = f"look at {folder / 'overlay.webm'}; "
    if scene.foreground.source == "recording":
        return (
            look + 'source = "recording" takes for background what does not move for most of the recording. Where the'
            " subject never leaves its place, name an image without it (clean_plate), a recording without it"
            " (background), or masks made with a segmentation program (docs/masks.md). Masks that can just be tracked"
            " are refined with --from-body RESULT"
        )
    if scene.foreground.source == "masks":
        return (
            look + "are they of the right subject, all of it, and in step? docs/masks.md tells how to make better ones"
        )
    return look + "docs/scene.md has the settings of [foreground], docs/masks.md other ways to make masks"
