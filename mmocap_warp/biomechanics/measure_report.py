"""Measures of all frames together, in plain types."""

from __future__ import annotations

from typing import Any

import numpy as np

from mmocap_warp.biomechanics.measure_all import Measures, RunMeasures


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
        "lengths_mm": {
            bone: {"length": 1000 * length, "sigma": 1000 * sigma} for bone, (length, sigma) in measures.lengths.items()
        },
        "per_run": [_of_run(measures, run) for run in measures.runs],
    }


def _of_run(measures: Measures, run: RunMeasures) -> dict[str, Any]:
    numbers, gait = measures.result.frame_numbers, run.walking
    up, centre = measures.result.cameras.up_vector, run.centre_of_mass

    def mean_by_side(values: list[tuple[str, float]]) -> dict[str, float]:
        return {side: _spread([value for foot, value in values if foot == side])["mean"] for side in run.feet}

    return {
        "run": run.run,
        "angles_deg": {
            joint: {name: _spread(angle) for name, angle in angles.items()} for joint, angles in run.angles.items()
        },
        **({"shifts_mm": _shifts(run)} if run.shifts else {}),
        "on_floor_share": {side: float(foot.on_floor.mean()) for side, foot in run.feet.items()},
        "strike_frames": {side: numbers[foot.strikes].tolist() for side, foot in run.feet.items()},
        "off_frames": {side: numbers[foot.offs].tolist() for side, foot in run.feet.items()},
        "cadence_per_minute": gait.cadence,
        "step_length_m": mean_by_side([(step.side, step.length) for step in gait.steps]),
        "stride_length_m": mean_by_side([(stride.side, stride.length) for stride in gait.strides]),
        "stance_share": mean_by_side([(stride.side, stride.stance_share) for stride in gait.strides]),
        "centre_of_mass_height_m": None if centre is None else _spread(centre @ up),
    }


def _shifts(run: RunMeasures) -> dict[str, Any]:
    return {joint: {axis: _spread(1000 * shift) for axis, shift in own.items()} for joint, own in run.shifts.items()}


def _spread(values: np.ndarray | list[float]) -> dict[str, float]:
    """Least, mean and greatest of the values that are known."""
    known = np.asarray(values, float)
    known = known[np.isfinite(known)]
    if not len(known):
        return {"min": np.nan, "mean": np.nan, "max": np.nan}
    return {"min": float(known.min()), "mean": float(known.mean()), "max": float(known.max())}
