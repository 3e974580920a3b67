"""``mmocap measure``: joint angles, contacts, steps, centre of mass and lengths."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch, table
from mmocap_warp.cli.exit_codes import UsageError

if TYPE_CHECKING:
    from mmocap_warp.biomechanics.measure_all import Measures


def measure(
    result: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    run: int | None = None,
    raw: Switch = False,
    frames: str | None = None,
    sex: Literal["female", "male"] | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Print joint angles, heel strikes, steps, the centre of mass and the lengths of the bones.

    The table is of the run that is animated, or of the one that is named; docs/measures.md defines every figure.

    Parameters
    ----------
    result
        What 'mmocap track' wrote.
    output
        A folder for every frame's figures as .csv, and plots of angles and feet as .svg.
    run
        The number of one run; all by default.
    raw
        Measure the track before it was smoothed.
    frames
        Which of the result's frames: first:end or first:end:stride by the recording's numbers, or a count. All by
        default.
    sex
        Whose shares of mass the body's segments have: female or male; the mean of both by default.
    force
        Write into a folder that holds something.
    """
    from mmocap_warp.biomechanics.measure_all import measure
    from mmocap_warp.biomechanics.measure_tables import report
    from mmocap_warp.cli.devices import start_warp
    from mmocap_warp.cli.flag_settings import as_flag
    from mmocap_warp.cli.outputs import new_folder
    from mmocap_warp.cli.result_report import positions_of
    from mmocap_warp.formats.usd.usd_result import read_result

    console = console or Console()
    tracked = read_result(result)
    tracked = tracked.at(positions_of(tracked, frames))
    if raw and tracked.raw_pose is None:
        raise UsageError("--raw needs a result that was smoothed; this one was not")
    folder = None if output is None else new_folder(output, force=force)
    start_warp()
    try:
        measures = measure(tracked, run, raw, sex)
    except ValueError as error:
        raise UsageError(as_flag(error)) from None
    values = report(measures)
    if folder is not None:
        values["files"] = [str(file) for file in _write(folder, measures)]
    console.result(values, _text(values))


def _write(folder: Path, measures: Measures) -> list[Path]:
    from mmocap_warp.biomechanics.measure_tables import write_tables
    from mmocap_warp.display.result_plots import plot_angles, plot_feet

    written = write_tables(folder, measures)
    for name, plot, has_any in (
        ("angles.svg", plot_angles, measures.shown.angles),
        ("feet.svg", plot_feet, measures.shown.feet),
    ):
        if has_any:
            plot(folder / name, measures)
            written.append(folder / name)
    return written


def _text(values: dict[str, Any]) -> str:
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
