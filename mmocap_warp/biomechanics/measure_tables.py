"""Measures as CSV files of every frame, heel strike, toe off and bone, and as a report of all frames together."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.biomechanics.measure_all import Measures, RunMeasures
from mmocap_warp.result.result import STATUS
from mmocap_warp.whole_file import csv_text, write_whole

Row = Sequence[str | int | float]
"""Of a table; a value that is not known is NaN."""

_OF_STRIKES = ("step_seconds", "step_length_m", "stride_seconds", "stride_length_m", "stance_share")


def write_tables(folder: Path, measures: Measures) -> list[Path]:
    """Write each of :func:`tables` that has rows as a CSV file; their paths. An InputError if that cannot be."""
    written = []
    for name, (head, rows) in tables(measures).items():
        if rows:
            write_whole(folder / f"{name}.csv", csv_text([head, *map(_cells, rows)]).encode())
            written.append(folder / f"{name}.csv")
    return written


def _cells(row: Row) -> list[str]:
    """Numbers to nine digits; what is not known is empty."""
    return ["" if value != value else f"{value:.9g}" if isinstance(value, float) else str(value) for value in row]


def tables(measures: Measures) -> dict[str, tuple[list[str], list[Row]]]:
    """Head and rows of each table, by name; a table without known values has no rows."""
    lengths: list[Row] = [(bone, *length) for bone, length in measures.lengths.items()]
    columns = [_columns(measures, run) for run in measures.runs]
    events = [row for run in measures.runs for row in _events(measures, run)]
    return {
        "lengths": (["bone", "length_m", "sigma_m"], lengths),
        **{name: _frame_table(measures, [of_run[name] for of_run in columns]) for name in columns[0]},
        "events": (["run", "foot", "event", "frame", "seconds", *_OF_STRIKES], events),
    }


Columns = dict[str, np.ndarray]
"""(frame,) each, by name."""


def _frame_table(measures: Measures, columns: list[Columns]) -> tuple[list[str], list[Row]]:
    """Head and rows of a table of every frame, from the columns of each run."""
    rows: list[Row] = []
    numbers, seconds = measures.result.frame_numbers.tolist(), measures.seconds.tolist()
    for run, of_run in zip(measures.runs, columns, strict=True):
        status = [STATUS[number] for number in measures.result.status[run.run]]
        for i, values in enumerate(zip(*(column.tolist() for column in of_run.values()), strict=True)):
            rows.append((run.run, numbers[i], seconds[i], status[i], *values))
    return ["run", "frame", "seconds", "status", *columns[0]], rows


def _columns(measures: Measures, run: RunMeasures) -> dict[str, Columns]:
    """The columns of each table of every frame, by the table's name."""
    joints: Columns = {}
    names, places, points = measures.result.subject.body.skeleton.joints, run.joints, measures.joint_set
    if points is not None:
        raw = measures.result.raw_pose if measures.raw else None
        pose = measures.result.pose if raw is None else raw
        names, places = points.names, points.positions(measures.result.subject, pose[run.run])
    for number, joint in enumerate(names):
        joints |= _axes(f"{joint}.", "_m", places[:, number])
        if points is None and run.joint_sigma is not None:
            joints |= _axes(f"{joint}.", "_sigma_m", run.joint_sigma[:, number])
    contacts: Columns = {}
    for side, foot in run.feet.items():
        contacts[f"{side}.on_floor"] = foot.on_floor.astype(int)
        contacts[f"{side}.height_m"], contacts[f"{side}.speed_m_per_s"] = foot.height, foot.speed
    return {
        "angles": {f"{joint}.{name}_deg": each for joint, own in run.angles.items() for name, each in own.items()},
        "shifts": {f"{joint}.{axis}_m": each for joint, own in run.shifts.items() for axis, each in own.items()},
        "joints": joints,
        "centre_of_mass": {} if run.centre_of_mass is None else _axes("", "_m", run.centre_of_mass),
        "contacts": contacts,
    }


def _axes(before: str, after: str, places: np.ndarray) -> Columns:
    return {f"{before}{axis}{after}": places[:, i] for i, axis in enumerate("xyz")}


def _events(measures: Measures, run: RunMeasures) -> Iterator[Row]:
    """By time: toe offs, and heel strikes with the step that each ends and the stride that it begins."""
    steps = {(step.side, step.frame): (step.seconds, step.length) for step in run.walking.steps}
    strides = {(each.side, each.frame): (each.seconds, each.length, each.stance_share) for each in run.walking.strides}
    moments = [(int(frame), side, "heel strike") for side, foot in run.feet.items() for frame in foot.strikes]
    moments += [(int(frame), side, "toe off") for side, foot in run.feet.items() for frame in foot.offs]
    unknown = (np.nan,) * len(_OF_STRIKES)
    for frame, side, event in sorted(moments):
        lengths = steps.get((side, frame), unknown[:2]) + strides.get((side, frame), unknown[2:])
        moment = int(measures.result.frame_numbers[frame]), float(measures.seconds[frame])
        yield run.run, side, event, *moment, *(lengths if event == "heel strike" else unknown)


def report(measures: Measures) -> dict[str, Any]:
    """What ``mmocap measure --json`` prints; a value that is not known is NaN or None."""
    result = measures.result
    return {
        "frames": len(result.frame_numbers),
        "fps": result.fps,
        "track": "raw" if measures.raw else "as tracked" if result.raw_pose is None else "smoothed",
        "shown_run": measures.shown.run,
        "shares_of_mass": measures.sex or "mean of female and male",
        "left_out": list(measures.left_out),
        "not_searched": list(measures.held),
        "lengths_mm": {
            bone: {"length": 1000 * length, "sigma": 1000 * sigma} for bone, (length, sigma) in measures.lengths.items()
        },
        "per_run": [_summary(measures, run) for run in measures.runs],
    }


def _summary(measures: Measures, run: RunMeasures) -> dict[str, Any]:
    numbers, gait = measures.result.frame_numbers, run.walking
    up, centre = measures.result.cameras.up_vector, run.centre_of_mass
    shifts = {joint: {axis: _spread(1000 * each) for axis, each in own.items()} for joint, own in run.shifts.items()}

    def mean_by_side(values: list[tuple[str, float]]) -> dict[str, float]:
        return {side: _spread([value for foot, value in values if foot == side])["mean"] for side in run.feet}

    return {
        "run": run.run,
        "angles_deg": {
            joint: {name: _spread(angle) for name, angle in angles.items()} for joint, angles in run.angles.items()
        },
        **({"shifts_mm": shifts} if shifts else {}),
        "on_floor_share": {side: float(foot.on_floor.mean()) for side, foot in run.feet.items()},
        "strike_frames": {side: numbers[foot.strikes].tolist() for side, foot in run.feet.items()},
        "off_frames": {side: numbers[foot.offs].tolist() for side, foot in run.feet.items()},
        "cadence_per_minute": gait.cadence,
        "step_length_m": mean_by_side([(step.side, step.length) for step in gait.steps]),
        "stride_length_m": mean_by_side([(stride.side, stride.length) for stride in gait.strides]),
        "stance_share": mean_by_side([(stride.side, stride.stance_share) for stride in gait.strides]),
        "centre_of_mass_height_m": None if centre is None else _spread(centre @ up),
    }


def _spread(values: np.ndarray | list[float]) -> dict[str, float]:
    """Least, mean and greatest of the values that are known; NaN where none is."""
    is_known = np.isfinite(values)
    known = np.asarray(values, float)[is_known] if np.any(is_known) else np.array([np.nan])
    return {"min": float(known.min()), "mean": float(known.mean()), "max": float(known.max())}
