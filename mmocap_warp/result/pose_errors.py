"""Distances between tracked joints and what is known of the real ones: whole arrays in, whole arrays out."""

import warnings
from collections.abc import Sequence

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import POSES_AT_ONCE, Poser, blocks
from mmocap_warp.errors import InputError
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth

HEAD_TOP = "HeadTop"
"""The truth's name for the top of the head, which is no joint of the body: its highest vertex in the bind pose."""

LOST_LIMB = 0.2
"""A limb is lost in a frame where its end, such as a wrist or ankle, is farther off than this [m]."""

NEAR = 0.05
"""A pose is near the truth where the root and all limbs' ends are within this [m]."""


def head_top(body: BodyModel) -> int:
    """The highest vertex of the body's own skin in the bind pose."""
    return int(np.where(body.own_vertex, body.skin.rest[:, 1], -np.inf).argmax())


def common_frames(result: Result, truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """Positions in each of the frames that both have; an InputError for none, or a truth without evaluated points."""
    _, mine, theirs = np.intersect1d(result.frame_numbers, truth.frame_numbers, return_indices=True)
    if not len(mine):
        frames, known = _span(result.frame_numbers), _span(truth.frame_numbers)
        remedy = "give the truth of this recording, numbered as its frames are"
        raise InputError("truth", f"has frames {known}, of which the result, with {frames}, has none", remedy)
    evaluated = [name for group in result.subject.body.skeleton.evaluation_groups.values() for name in group]
    if not truth.marker_names and not set(evaluated) & set(truth.joint_names):
        problem = f"none of its joints ({_some(truth.joint_names)}) is evaluated ({_some(evaluated)} are)"
        remedy = "give the truth of the body that was tracked, its joints named as the body's"
        raise InputError("truth", f"no markers, and {problem}", remedy)
    return mine, theirs


def _some(names: Sequence[str]) -> str:
    return ", ".join([*names[:4], *(["..."] if len(names) > 4 else [])]) or "none at all"


def aligned_error(points: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Mean distance after the similarity transform, mirrors excluded, that brings ``points`` closest to ``target``.

    Of points (..., frame, joint, 3) and target (frame, joint, 3) it is (..., frame). A joint with a NaN in the target
    is left out of its frame; where fewer than three are known it is NaN.
    """
    known = np.isfinite(target).all(axis=2)
    enough = known.sum(axis=1) >= 3  # else a similarity is not determined
    weight = (known / np.maximum(known.sum(axis=1, keepdims=True), 1))[..., None]
    target = np.where(known[..., None], target, 0.0)
    y = np.where(known[..., None], target - (weight * target).sum(axis=1, keepdims=True), 0.0)
    x = np.where(known[..., None], points - (weight * points).sum(axis=-2, keepdims=True), 0.0)
    u, s, vt = np.linalg.svd(np.einsum("...ja,...jb->...ab", x, np.broadcast_to(y, x.shape)))
    sign = np.ones_like(s)
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))  # a rotation, not a mirror
    size = np.maximum((x**2).sum(axis=(-2, -1)), np.finfo(float).tiny)
    scale = (s * sign).sum(axis=-1) / size
    fitted = scale[..., None, None] * (x @ (u * sign[..., None, :]) @ vt)
    distance = np.linalg.norm(fitted - y, axis=-1)
    return np.where(enough, (weight[..., 0] * distance).sum(axis=-1), np.nan)


def farthest(result: Result, truth: Truth, mine: np.ndarray, theirs: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """How far the root or a limb's end is off, whichever is more: (run, common frame) [m], NaN where none is known.

    The result's ``joints`` are (run, frame, joint, 3) [m]; ``mine`` and ``theirs`` are the common frames' positions in
    result and truth.
    """
    skeleton = result.subject.body.skeleton
    names = [name for name in dict.fromkeys((skeleton.joints[0], *skeleton.ends)) if name in truth.joint_names]
    tracked = joints[:, mine][:, :, [skeleton.index(name) for name in names]]
    known = truth.joints[theirs][:, [truth.joint_names.index(name) for name in names]]
    distance = np.linalg.norm(tracked - known, axis=-1)
    most = np.where(np.isnan(distance), -np.inf, distance).max(axis=2, initial=-np.inf)
    return np.where(np.isfinite(most), most, np.nan)


def nanmean(values: np.ndarray, axis: int | tuple[int, ...]) -> np.ndarray:
    """Mean over what is defined, NaN where nothing is."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Mean of empty slice", RuntimeWarning)
        return np.nanmean(values, axis=axis)


def nanmedian(values: np.ndarray) -> np.ndarray:
    """Median over the first axis of what is defined, NaN where nothing is."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice encountered", RuntimeWarning)
        return np.nanmedian(values, axis=0)


def on_all_frames(values: np.ndarray, mine: np.ndarray, result: Result) -> np.ndarray:
    """(run, common frame) to (run, frame) with NaN where there is no truth."""
    full = np.full((len(values), len(result.frame_numbers)), np.nan)
    full[:, mine] = values
    return full


def _span(numbers: np.ndarray) -> str:
    return f"{numbers[0]}-{numbers[-1]}" if len(numbers) else "(none)"


def offset_free_distance(
    result: Result, mine: np.ndarray, tracked: np.ndarray, axes: Sequence[int] | np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances once each point's median offset over the frames, in the axes of a joint, is taken out.

    Args:
        result: what was tracked; every run has offsets of its own.
        mine: positions of the frames to evaluate.
        tracked: (run, len(mine), point, 3), the points in the result [m].
        axes: (point,), the body's joint in whose axes each point's offset is constant.
        known: (len(mine), point, 3), where these really were [m], NaN where that is unknown.

    Returns:
        (run, len(mine), point) [m], and the lengths of the offsets (run, point) [m]; NaN where a point is unknown.
    """
    poser = Poser(result.subject.body, result.subject.root_base)
    distance = np.full((len(result.pose), *known.shape[:2]), np.nan)
    offset_length = np.full((len(result.pose), known.shape[1]), np.nan)
    for run, pose in enumerate(result.pose[:, mine]):
        local = np.empty(known.shape)
        for block in blocks(len(pose), POSES_AT_ONCE):
            place = poser.joint_transforms(pose[block]).astype(np.float64)
            away = known[block] - tracked[run, block]
            local[block] = np.einsum("fjba,fjb->fja", place[:, axes][..., :3, :3], away)
        seen = np.isfinite(local).any(axis=(0, 2))
        offset = np.nanmedian(local[:, seen], axis=0)
        distance[run][:, seen] = np.linalg.norm(local[:, seen] - offset, axis=-1)
        offset_length[run, seen] = np.linalg.norm(offset, axis=-1)
    return distance, offset_length


_SHAKE_RATE = 60.0  # frames a second as at which shake is given: a smooth motion's is the same at any rate


def second_differences(joints: np.ndarray, frame_numbers: np.ndarray, fps: float) -> np.ndarray:
    """Lengths of the second differences of the joints' paths, as at 60 Hz: (run, three frames in a row, joint) [m].

    Where frames are missing between two of the ``frame_numbers``, no difference reaches across.
    """
    step = np.diff(frame_numbers)
    consecutive = (step[1:] == step.min()) & (step[:-1] == step.min()) if len(step) > 1 else np.zeros(0, bool)
    second = np.diff(joints, n=2, axis=1)[:, consecutive]
    rate = fps / step.min() if len(step) else fps
    return np.linalg.norm(second, axis=-1) * (rate / _SHAKE_RATE) ** 2


def growth(error: np.ndarray) -> np.ndarray:
    """Mean error of the last third over that of the first third, (run,), of errors (run, frame) that may be NaN.

    It is NaN with fewer than three frames; the frames are those that have a truth.
    """
    third = error.shape[1] // 3
    if not third:
        return np.full(len(error), np.nan)
    first, last = nanmean(error[:, :third], axis=1), nanmean(error[:, -third:], axis=1)
    return np.divide(last, first, out=np.full(len(error), np.nan), where=first > 0)
