"""What is shown against frame: error, overlap, uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.pose_errors import nanmean
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth

_ERRORS = (("mpjpe_mm", "Joint error, mean"), ("marker_error_mm", "Marker error, mean"))
"""Series of an evaluation, best first, and what they are called."""


@dataclass(frozen=True)
class Curve:
    """A measure of every frame.

    Attributes:
        name: for people.
        unit: likewise; empty for a share.
        values: (run, frame) float64 by track, NaN where there is none: ``final``, and ``raw`` where that has its own.
    """

    name: str
    unit: str
    values: dict[str, np.ndarray]


def tracks(result: Result) -> dict[str, np.ndarray]:
    """A result's poses (run, frame, coordinate): ``final``, and ``raw`` where it was smoothed."""
    return {"final": result.pose} | ({} if result.raw_pose is None else {"raw": result.raw_pose})


def curves(result: Result, truth: Truth | None) -> list[Curve]:
    """The curves that are known of a result.

    Raises:
        InputError: the truth is of another recording.
    """
    known = [] if truth is None else [_error(result, truth)]
    known.append(Curve("IoU, mean over views", "", {"final": nanmean(result.iou, axis=-1)}))
    if result.joint_sigma is not None:
        sigma = 1000.0 * np.linalg.norm(result.joint_sigma, axis=-1)
        known.append(Curve("Uncertainty of a joint, mean", "mm", {"final": nanmean(sigma, axis=-1)}))
    return [curve for curve in known if any(np.isfinite(values).any() for values in curve.values.values())]


def _error(result: Result, truth: Truth) -> Curve:
    """The error of joints where the truth names them, else of markers, for each track."""
    series = {name: evaluate(replace(result, pose=pose), truth)["series"] for name, pose in tracks(result).items()}
    errors = [
        Curve(name, "mm", {track: np.array(each[key], float) for track, each in series.items()})  # None becomes NaN
        for key, name in _ERRORS
    ]
    return next((error for error in errors if np.isfinite(error.values["final"]).any()), errors[0])
