"""``mmocap measure``: joint angles, contacts, steps, centre of mass and lengths."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from mmocap_warp.cli.command_help import documented_by
from mmocap_warp.cli.console import Console, Output, ResultFile, ResultFrames, Switch, table


@documented_by("measure:measure")
def measure(
    result: ResultFile,
    /,
    *,
    output: Annotated[Path | None, Output] = None,
    run: int | None = None,
    raw: Switch = False,
    frames: ResultFrames = None,
    sex: Literal["female", "male"] | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    from mmocap_warp.biomechanics.measure_tables import report
    from mmocap_warp.commands.measure import measure

    console = console or Console()
    measures = measure(result, run, raw, sex, output=output, frames=frames, force=force)
    values = report(measures)
    if output is not None:
        values["files"] = [str(file) for file in measures.files]
    console.result(values, _text(values))


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
