"""``mmocap eval``, ``show``, ``view`` and ``export``: what is done with a result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mmocap_warp.cli.console import (
    CHECK_FAILED,
    OK,
    Console,
    Force,
    MovedScene,
    Output,
    ResultFile,
    ResultFrames,
    Switch,
)
from mmocap_warp.formats.table import EXPORT_SUFFIXES
from mmocap_warp.formats.toml_table import listed


def evaluate(
    result: ResultFile,
    /,
    *,
    truth: Path | None = None,
    truth_axes: str = "xyz",
    scene: MovedScene = None,
    frames: ResultFrames = None,
    console: Console | None = None,
) -> int:
    """Print a result's IoU, and its errors in millimetres where the truth is known.

    Exits with 4 where the truth is in another world than the result, and says how to mend that.

    Parameters
    ----------
    truth
        True markers or joints: .usdc, .usda or .trc. The scene's own by default.
    truth_axes
        Of a .trc: which of its axes are the world's x, y and z, such as zxy.
    """
    from mmocap_warp.cli.result_report import summary
    from mmocap_warp.commands.evaluate import evaluate

    console = console or Console()
    report = evaluate(result, truth, truth_axes=truth_axes, scene=scene, frames=frames, reporter=console)
    console.result(report, summary(report))
    return OK if report.get("other_world") is None else CHECK_FAILED


def show(
    result: Path,
    /,
    *,
    output: Annotated[Path | None, Output] = None,
    scene: MovedScene = None,
    frames: ResultFrames = None,
    force: Force = False,
    console: Console | None = None,
) -> None:
    """Write an overlay video of all cameras, and a contact sheet beside it: mask against model, skin and skeleton.

    Of a subject it is a picture: the fit over the first frame, or the body alone where the scene is not known.

    Parameters
    ----------
    result
        What 'mmocap track' or 'mmocap fit' wrote.
    output
        The video's file, .webm; beside the result and named after it by default. The sheet, and a subject's picture,
        have the ending .png.
    """
    from mmocap_warp.commands.show import show

    console = console or Console()
    drawn = show(result, scene, output=output, frames=frames, force=force, reporter=console)
    files = {"sheet": drawn.sheet} if drawn.video is None else {"video": drawn.video, "sheet": drawn.sheet}
    console.result(files, "\n".join(map(str, files.values())))


def view(
    result: ResultFile,
    /,
    *,
    output: Annotated[Path | None, Output] = None,
    images: Switch = False,
    rerun: Path | None = None,
    scene: MovedScene = None,
    force: Force = False,
    console: Console | None = None,
) -> None:
    """Write one page that shows a result in any browser, without a network: body, cameras, masks, curves, all runs.

    Parameters
    ----------
    output
        The page's file, .html; beside the result and named after it by default.
    images
        Show the recording's images too, not its masks alone.
    rerun
        Also write the best run as a recording of Rerun's, .rrd; needs the package rerun-sdk.
    """
    from mmocap_warp.commands.show import view

    console = console or Console()
    page = output or result.with_suffix(".html")
    shown = view(result, scene, images=images, output=page, rerun=rerun, force=force, reporter=console)
    size = page.stat().st_size
    text = f"{page}: {shown.frames} frames, {size / 1e6:.1f} MB" + (f"\n{rerun}" if rerun is not None else "")
    console.result({"file": page, "rerun": rerun, "frames": shown.frames, "bytes": size}, text)


def export(
    result: ResultFile,
    /,
    *,
    output: Annotated[Path, Output, Parameter(help=f"The animation's file: {listed(EXPORT_SUFFIXES)}.")],
    run: Annotated[str | None, Parameter(show_default=False)] = None,
    raw: Switch = False,
    frames: ResultFrames = None,
    fps: float | None = None,
    up: Annotated[Literal["y", "z"] | None, Parameter(show_choices=False)] = None,
    rig: Literal["mixamo"] | None = None,
    bake: Switch = False,
    force: Force = False,
    console: Console | None = None,
) -> None:
    """Write a result's animation alone, for other programs: the best run's motion, in the format of the file's ending.

    The world is the result's, which is the calibration's: its up axis, its heading and its origin. Formats that are
    Y up always (.glb, .bvh, .trc, .mot) have it turned.

    Parameters
    ----------
    run
        Which run: its number from 0, or "all" for a file a run, such as walk-run0.bvh. [default: the best]
    raw
        The track as it was before it was smoothed.
    fps
        Frames per second, resampled by time. [default: the result's own]
    up
        Turn the world so that y or z is up: (x, y, z) becomes (x, z, -y) from z up to y up, and (x, -z, y) back.
        [default: the result's own, or the format's]
    rig
        Name and bind the body as this rig, in its rest pose.
    bake
        USD only: the skin's points at every frame instead of a skeleton that moves it.
    """
    from mmocap_warp.commands.export import export

    console = console or Console()
    written = export(result, output, run=run, raw=raw, frames=frames, fps=fps, up=up, rig=rig, bake=bake, force=force)
    values = {
        "file": output if output in written.files else None,
        "files": list(written.files),
        "frames": written.frames,
        "fps": written.fps,
        "up": written.up,
    }
    lines = [f"{file}: {written.frames} frames, {written.fps:g} a second, {written.up} up" for file in written.files]
    console.result(values, "\n".join(lines))
