"""``mmocap eval``, ``show``, ``view``, ``export`` and ``measure``: what is done with a result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from mmocap_warp.cli.command import Answer, command
from mmocap_warp.cli.console import CHECK_FAILED, OK, ResultFrames, table
from mmocap_warp.formats.table import EXPORT_SUFFIXES
from mmocap_warp.formats.toml_table import listed


@command("evaluate:evaluate", frames=ResultFrames)
def evaluate(call: Any) -> Answer:
    from mmocap_warp.cli.result_report import summary

    report = call()
    return Answer(report, [summary(report)], OK if report.get("other_world") is None else CHECK_FAILED)


@command("show:show", order="output scene", result=Path, frames=ResultFrames)
def show(call: Any) -> Answer:
    drawn = call()
    files = {"sheet": drawn.sheet} if drawn.video is None else {"video": drawn.video, "sheet": drawn.sheet}
    return Answer(files, files.values())


@command("show:view", order="output images rerun scene", truth=None, name=None)
def view(call: Any, result: Path, output: Path | None, rerun: Path | None) -> Answer:
    page = output or result.with_suffix(".html")
    shown = call(output=page)
    size = page.stat().st_size
    lines = [f"{page}: {shown.frames} frames, {size / 1e6:.1f} MB", *([] if rerun is None else [rerun])]
    return Answer({"file": page, "rerun": rerun, "frames": shown.frames, "bytes": size}, lines)


@command(
    "export:export",
    output=Annotated[Path, Parameter(help=f"The animation's file: {listed(EXPORT_SUFFIXES)}.")],
    run=Annotated[str | None, Parameter(show_default=False)],
    frames=ResultFrames,
    up=Annotated[Literal["y", "z"] | None, Parameter(show_choices=False)],
    rig=Literal["mixamo"] | None,
)
def export(call: Any, output: Path) -> Answer:
    written = call()
    values = {
        "file": output if output in written.files else None,
        "files": list(written.files),
        "frames": written.frames,
        "fps": written.fps,
        "up": written.up,
    }
    frames = f"{written.frames} frames, {written.fps:g} a second, {written.up} up"
    return Answer(values, [f"{file}: {frames}" for file in written.files])


@command("measure:measure", order="output run raw frames", frames=ResultFrames)
def measure(call: Any, output: Path | None) -> Answer:
    from mmocap_warp.biomechanics.measure_tables import report

    measures = call()
    values = report(measures)
    if output is not None:
        values["files"] = [str(file) for file in measures.files]
    return Answer(values, [_measures_text(values)])


def _measures_text(values: dict[str, Any]) -> str:
    """The answer for people."""
    shown = next(run for run in values["per_run"] if run["run"] == values["shown_run"])
    parts = [f"run {values['shown_run']}, {values['frames']} frames, {values['track']}"]
    angles = [
        (joint, name.replace("_", " "), *(f"{spread[key]:.1f}" for key in ("min", "mean", "max")))
        for joint, names in shown["angles_deg"].items()
        for name, spread in names.items()
    ]
    if angles:
        parts.append(table([("joint", "angle [°]", "least", "mean", "most"), *angles]))
    shifts = [
        (joint, axis, *(f"{spread[key]:.1f}" for key in ("min", "mean", "max")))
        for joint, axes in shown.get("shifts_mm", {}).items()
        for axis, spread in axes.items()
    ]
    if shifts:
        parts.append(table([("joint", "shift [mm]", "least", "mean", "most"), *shifts]))
    if shown["on_floor_share"]:
        parts.append(_gait(shown))
    height = shown["centre_of_mass_height_m"]
    if height is not None:
        spread = ", ".join(f"{word} {height[key]:.3f}" for word, key in (("least", "min"), ("most", "max")))
        parts.append(f"centre of mass [m]: mean height {height['mean']:.3f}, {spread} ({values['shares_of_mass']})")
    lengths = [
        (bone, f"{length['length']:.0f}", f"{length['sigma']:.0f}" if length["sigma"] == length["sigma"] else "-")
        for bone, length in values["lengths_mm"].items()
    ]
    parts.append(table([("bone", "length [mm]", "sigma [mm]"), *lengths]))
    parts += [f"left out, for lack of such joints: {', '.join(values['left_out'])}"] if values["left_out"] else []
    if "files" in values:
        parts.append("\n".join(values["files"]))
    return "\n\n".join(parts)


def _gait(shown: dict[str, Any]) -> str:
    """A row for each foot, then the cadence."""
    rows: list[tuple[str, ...]] = [("foot", "heel strikes", "toe offs", "step [m]", "stride [m]", "stance", "on floor")]
    for side in shown["on_floor_share"]:
        events = (_frames(shown[key][side]) for key in ("strike_frames", "off_frames"))
        means = (
            _known(shown[key][side], form)
            for key, form in (("step_length_m", ".3f"), ("stride_length_m", ".3f"), ("stance_share", ".0%"))
        )
        rows.append((side, *events, *means, f"{shown['on_floor_share'][side]:.0%}"))
    return f"{table(rows)}\ncadence: {_known(shown['cadence_per_minute'], '.1f')} steps a minute"


def _frames(numbers: list[int]) -> str:
    """Frame numbers; of many the first and how many there are."""
    first = " ".join(map(str, numbers[:6])) or "-"
    return first + (f" ... ({len(numbers)})" if len(numbers) > 6 else "")


def _known(value: float, form: str) -> str:
    return "-" if value != value else format(value, form)
