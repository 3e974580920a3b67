"""``mmocap eval``, ``show``, ``view`` and ``export``: what is done with a result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from mmocap_warp.cli.command_help import documented_by
from mmocap_warp.cli.console import (
    CHECK_FAILED,
    OK,
    Console,
    Output,
    ResultFile,
    ResultFrames,
    Switch,
)
from mmocap_warp.formats.table import EXPORT_SUFFIXES
from mmocap_warp.formats.toml_table import listed


@documented_by("evaluate:evaluate")
def evaluate(
    result: ResultFile,
    /,
    *,
    truth: Path | None = None,
    truth_axes: str = "xyz",
    scene: Path | None = None,
    frames: ResultFrames = None,
    console: Console | None = None,
) -> int:
    from mmocap_warp.cli.result_report import summary
    from mmocap_warp.commands.evaluate import evaluate

    console = console or Console()
    report = evaluate(result, truth, truth_axes=truth_axes, scene=scene, frames=frames, reporter=console)
    console.result(report, summary(report))
    return OK if report.get("other_world") is None else CHECK_FAILED


@documented_by("show:show")
def show(
    result: Path,
    /,
    *,
    output: Annotated[Path | None, Output] = None,
    scene: Path | None = None,
    frames: ResultFrames = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    from mmocap_warp.commands.show import show

    console = console or Console()
    drawn = show(result, scene, output=output, frames=frames, force=force, reporter=console)
    files = {"sheet": drawn.sheet} if drawn.video is None else {"video": drawn.video, "sheet": drawn.sheet}
    console.result(files, "\n".join(map(str, files.values())))


@documented_by("show:view")
def view(
    result: ResultFile,
    /,
    *,
    output: Annotated[Path | None, Output] = None,
    images: Switch = False,
    rerun: Path | None = None,
    scene: Path | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    from mmocap_warp.commands.show import view

    console = console or Console()
    page = output or result.with_suffix(".html")
    shown = view(result, scene, images=images, output=page, rerun=rerun, force=force, reporter=console)
    size = page.stat().st_size
    text = f"{page}: {shown.frames} frames, {size / 1e6:.1f} MB" + (f"\n{rerun}" if rerun is not None else "")
    console.result({"file": page, "rerun": rerun, "frames": shown.frames, "bytes": size}, text)


@documented_by("export:export")
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
    force: Switch = False,
    console: Console | None = None,
) -> None:
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
