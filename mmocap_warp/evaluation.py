"""How good a result is: overlap with what was seen, and distance to what is known."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from mmocap_warp.body import JOINTS
from mmocap_warp.errors import InputError
from mmocap_warp.posing import Poser
from mmocap_warp.result import STATUS, TrackResult
from mmocap_warp.skin_points import attach
from mmocap_warp.truth import Truth

LIMB_GROUPS: dict[str, tuple[str, str]] = {
    "shoulders": ("LShoulder", "RShoulder"),
    "elbows": ("LElbow", "RElbow"),
    "wrists": ("LWrist", "RWrist"),
    "hips": ("LHip", "RHip"),
    "knees": ("LKnee", "RKnee"),
    "ankles": ("LAnkle", "RAnkle"),
}
"""The joints that every source of truth defines alike: the ones that the joint errors are taken over."""

LOST_LIMB_MM = 200.0
"""A limb is lost in a frame where its wrist or ankle is farther off than this [mm]."""

_METRES_TO_MM = 1000.0


def evaluate(result: TrackResult, truth: Truth | None = None) -> dict[str, Any]:
    """Judge a result; numbers over several runs are means of the runs' numbers, except the worst and the medians.

    Without truth: ``frames``, ``runs``, ``lost`` and ``partial`` frames, ``evaluations`` (all runs),
    ``evaluations_per_second``, ``mean_cost``, ``mean_iou``, ``worst_iou`` (the lowest mean over views of a frame,
    over runs) and its ``worst_iou_frame``, ``iou_by_camera``, ``jitter_mm`` (median second difference of the joints
    over consecutive frames), ``per_run`` and ``series`` (per run and frame).

    With truth also, over the frames that have it: ``truth_frames``; ``marker_error_mm``, Eq. 20: the mean over
    markers, then frames, of markers attached to the nearest point of the tracked skin when first seen (what lies
    between marker and skin then is dropped, so it counts as error); over the twelve joints of ``LIMB_GROUPS``:
    ``mpjpe_mm`` the mean distance, ``pa_mpjpe_mm`` the same after the best similarity transform of each frame,
    ``median_joint_mm`` (all), ``median_mm_by_joint`` and ``median_mm_by_group`` over frames and runs, and
    ``limb_lost_frames``: frames in which a wrist or ankle of some run is over 200 mm off.

    Values that nothing defines (no marker, no joint, no view) are ``None``.

    Raises:
        InputError: truth that shares no frame, or neither markers nor joints, with the result.
    """
    poser = Poser(result.subject.body, result.subject.root_base)
    joints = np.stack([poser.joint_transforms(run)[:, :, :3, 3] for run in result.pose]).astype(np.float64)
    series = {"cost": result.cost, "iou": _nanmean(result.iou, axis=2)}
    report = _overlap(result, series["iou"])
    report["jitter_mm"] = _jitter_mm(joints, result.frame_numbers)
    if truth is not None:
        mine, theirs = _common_frames(result, truth)
        report["truth_frames"] = len(mine)
        series["marker_error_mm"] = _spread(_marker_error_mm(result, truth, poser, mine, theirs), mine, result)
        report["marker_error_mm"] = _mean(_nanmean(series["marker_error_mm"], axis=1))
        report |= _joint_errors(joints, truth, mine, theirs, result, series)
    report["per_run"] = _per_run(result, series)
    report["series"] = {"frame": result.frame_numbers} | series
    return _jsonable(report)


def _overlap(result: TrackResult, iou: np.ndarray) -> dict[str, Any]:
    """What needs no truth; ``iou`` is (run, frame)."""
    worst = np.where(np.isfinite(iou), iou, np.inf).min(axis=0)
    total = int(result.evaluations.sum())
    return {
        "frames": len(result.frame_numbers),
        "runs": len(result.pose),
        "lost": int((result.status == STATUS.index("lost")).sum()),
        "partial": int((result.status == STATUS.index("partial")).sum()),
        "evaluations": total,
        "evaluations_per_second": total / result.seconds if result.seconds > 0 else None,
        "seconds": result.seconds,
        "mean_cost": _mean(_nanmean(result.cost, axis=1)),
        "mean_iou": _mean(_nanmean(iou, axis=1)),
        "worst_iou": worst.min(),
        "worst_iou_frame": int(result.frame_numbers[worst.argmin()]) if np.isfinite(worst).any() else None,
        "iou_by_camera": dict(zip(result.cameras.names, _nanmean(result.iou, axis=(0, 1)), strict=True)),
    }


def _jitter_mm(joints: np.ndarray, frame_numbers: np.ndarray) -> float:
    """Median length of the joints' second difference over consecutive frames; ``joints`` is (run, frame, joint, 3)."""
    step = np.diff(frame_numbers)
    consecutive = (step[1:] == step.min()) & (step[:-1] == step.min()) if len(step) > 1 else np.zeros(0, bool)
    second = np.diff(joints, n=2, axis=1)[:, consecutive]
    return _median(np.linalg.norm(second, axis=-1)) * _METRES_TO_MM


def _common_frames(result: TrackResult, truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """Positions in the result and in the truth of the frames that both have."""
    _, mine, theirs = np.intersect1d(result.frame_numbers, truth.frame_numbers, return_indices=True)
    if not len(mine):
        raise InputError(
            "truth",
            f"its frames {_span(truth.frame_numbers)} share none with the result's {_span(result.frame_numbers)}",
            "give the truth of this recording, numbered as its frames are",
        )
    if not truth.marker_names and not _judged(truth):
        raise InputError(
            "truth",
            f"no markers, and none of its joints {list(truth.joint_names)} is one of {_limb_joints()}",
            "name its joints as above",
        )
    return mine, theirs


def _marker_error_mm(
    result: TrackResult, truth: Truth, poser: Poser, mine: np.ndarray, theirs: np.ndarray
) -> np.ndarray:
    """Eq. 20: (run, common frame), mean over the markers seen in a frame."""
    seen = truth.markers[theirs]
    known = np.isfinite(seen).all(axis=2)
    ever = np.flatnonzero(known.any(axis=0))
    first = known.argmax(axis=0)
    error = np.full((len(result.pose), len(mine)), np.nan)
    for run, pose in enumerate(result.pose if len(ever) else ()):
        vertices = poser.vertices(pose[mine])
        distance = np.full(known.shape, np.nan)
        for start in np.unique(first[ever]):
            some = ever[first[ever] == start]
            riding = attach(seen[start, some], vertices[start], result.subject.body.skin.face)
            distance[:, some] = np.linalg.norm(seen[:, some] - riding.positions(vertices), axis=2)
        error[run] = _nanmean(distance, axis=1) * _METRES_TO_MM
    return error


def _joint_errors(
    joints: np.ndarray,
    truth: Truth,
    mine: np.ndarray,
    theirs: np.ndarray,
    result: TrackResult,
    series: dict[str, np.ndarray],
) -> dict[str, Any]:
    """Errors over the limb joints that the truth names; adds the per-frame errors to ``series``."""
    names = _judged(truth)
    tracked = joints[:, mine][:, :, [JOINTS.index(name) for name in names]]
    known = truth.joints[theirs][:, [truth.joint_names.index(name) for name in names]]
    distance = np.linalg.norm(tracked - known, axis=-1) * _METRES_TO_MM  # (run, common frame, joint)
    aligned = np.array([[_procrustes_error(*pair) for pair in zip(run, known, strict=True)] for run in tracked])
    series["mpjpe_mm"] = _spread(_nanmean(distance, axis=2), mine, result)
    series["pa_mpjpe_mm"] = _spread(aligned * _METRES_TO_MM, mine, result)
    ends = [i for i, name in enumerate(names) if name in LIMB_GROUPS["wrists"] + LIMB_GROUPS["ankles"]]
    lost = (distance[..., ends] > LOST_LIMB_MM).any(axis=(0, 2))

    def median_of(*wanted: str) -> float:
        return _median(distance[..., [i for i, name in enumerate(names) if name in wanted]])

    return {
        "mpjpe_mm": _mean(_nanmean(series["mpjpe_mm"], axis=1)),
        "pa_mpjpe_mm": _mean(_nanmean(series["pa_mpjpe_mm"], axis=1)),
        "median_joint_mm": median_of(*names),
        "median_mm_by_joint": {name: median_of(name) for name in names},
        "median_mm_by_group": {group: median_of(*pair) for group, pair in LIMB_GROUPS.items()},
        "limb_lost_frames": result.frame_numbers[mine[lost]],
    }


def _procrustes_error(points: np.ndarray, target: np.ndarray) -> float:
    """Mean distance (of one frame) after the similarity transform that brings ``points`` closest to ``target``."""
    known = np.isfinite(target).all(axis=1)
    if known.sum() < 3:  # a similarity is not determined
        return np.nan
    x, y = points[known], target[known]
    x, y = x - x.mean(0), y - y.mean(0)
    u, s, vt = np.linalg.svd(x.T @ y)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])  # a rotation, not a mirror
    scale = (s * sign).sum() / (x**2).sum()
    return float(np.linalg.norm(scale * x @ (u * sign) @ vt - y, axis=1).mean())


def _per_run(result: TrackResult, series: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """A line a run: what distinguishes the seeds."""
    seed = result.config.get("seed")
    return [
        {"run": run, "seed": None if seed is None else seed + run, "worst_iou": _min(series["iou"][run])}
        | {f"mean_{name}" if name in ("cost", "iou") else name: _mean(of[run]) for name, of in series.items()}
        for run in range(len(result.pose))
    ]


def _judged(truth: Truth) -> list[str]:
    return [name for name in _limb_joints() if name in truth.joint_names]


def _limb_joints() -> list[str]:
    return [name for pair in LIMB_GROUPS.values() for name in pair]


def _spread(values: np.ndarray, mine: np.ndarray, result: TrackResult) -> np.ndarray:
    """(run, common frame) to (run, frame) with NaN where there is no truth."""
    full = np.full((len(values), len(result.frame_numbers)), np.nan)
    full[:, mine] = values
    return full


def _span(numbers: np.ndarray) -> str:
    return f"{numbers[0]}-{numbers[-1]}" if len(numbers) else "(none)"


def _nanmean(values: np.ndarray, axis: int | tuple[int, ...]) -> np.ndarray:
    """Mean over what is defined, NaN where nothing is."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Mean of empty slice", RuntimeWarning)
        return np.nanmean(values, axis=axis)


def _mean(values: np.ndarray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else np.nan


def _median(values: np.ndarray) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else np.nan


def _min(values: np.ndarray) -> float:
    return float(np.nanmin(values)) if np.isfinite(values).any() else np.nan


def _jsonable(value: Any) -> Any:
    """Arrays become lists, and what JSON cannot say (NaN, infinity) becomes None."""
    if isinstance(value, dict):
        return {key: _jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _jsonable(value.tolist())
    if isinstance(value, list):
        return [_jsonable(item) for item in value]
    if isinstance(value, np.generic):
        return _jsonable(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
