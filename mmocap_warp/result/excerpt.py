"""A part of a result, or the same at another rate: what to export is chosen here."""

from dataclasses import replace
from typing import Any

import numpy as np

from mmocap_warp.body.rotations import between, near_zyx_angles, quarter_turn, zyx_rotation
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.result.result import Result

_MOST_RATE = 100  # times the result's own rate, at which a minute has a few hundred thousand frames
_SAME_TIME = 1e-6  # frames: a time that lies outside the result by less is its first or last frame


def of_run(result: Result, run: int) -> Result:
    """A result of one of the runs."""
    return replace(result, **{name: array[run : run + 1] for name, array in result.arrays.items()})


def before_smoothing(result: Result) -> Result:
    """The track before it was smoothed, a ValueError if it was not. Cost, overlap and status are the smoothed one's."""
    if result.raw_pose is None:
        raise ValueError("the track was not smoothed, so it has no other")
    unknown: dict[str, Any] = dict.fromkeys(("raw_pose", "angle_sigma", "joint_sigma", "view_shift"))
    return replace(result, pose=result.raw_pose, **unknown)


def at_rate(result: Result, fps: float) -> Result:
    """The result at ``fps`` frames per second: frame ``n`` is what was at ``n / fps`` seconds of the recording.

    Between two frames the root goes straight and every joint turns the shortest way; costs, overlaps and statuses are
    the nearest frame's. Standard deviations are dropped. The frames lie within the result's own. Raises a ValueError
    for a rate that is not positive, or so low that the result has no frame of it.
    """
    if not 0 < fps <= _MOST_RATE * result.fps:
        raise ValueError(f"fps must be positive and at most {_MOST_RATE * result.fps:g}, got {fps:g}")
    # The new frames lie within the result's own, but for rounding.
    known, slack = result.frame_numbers / result.fps, _SAME_TIME / result.fps
    numbers = np.arange(np.ceil((known[0] - slack) * fps), np.floor((known[-1] + slack) * fps) + 1).astype(int)
    if not len(numbers):
        raise ValueError(f"fps = {fps:g} has no frame in the {known[-1] - known[0]:.3g} s of the result")
    return _at(result, numbers, float(fps))


def _at(result: Result, numbers: np.ndarray, fps: float) -> Result:
    """The result at frames of these numbers (frame,) at ``fps``, as :func:`at_rate` has them."""
    # Where they lie among the result's frames: poses are interpolated, the rest is the nearest frame's.
    known = result.frame_numbers / result.fps
    place = np.interp(numbers / fps, known, np.arange(len(known)))
    nearest = np.round(place).astype(int)
    is_length = result.subject.body.skeleton.is_length
    arrays = {name: array[:, nearest] for name, array in result.arrays.items()}
    for name, track in _tracks(result).items():
        arrays[name] = np.stack([_poses_at(run, place, is_length) for run in track])
    arrays |= dict.fromkeys(("angle_sigma", "joint_sigma"))
    return replace(result, fps=fps, frame_numbers=numbers, **arrays)


def _tracks(result: Result) -> dict[str, Any]:
    """The poses (run, frame, coordinate), and those before smoothing where there are any, by name."""
    return {name: array for name, array in result.arrays.items() if name in ("pose", "raw_pose")}


def evenly(result: Result) -> Result:
    """The result with its frames at equal times; the result itself where they are already."""
    if len(set(np.diff(result.frame_numbers).tolist())) <= 1:
        return result
    first, last = result.frame_numbers[[0, -1]].tolist()
    return _at(result, np.arange(first, last + 1, result.stride), result.fps)


def _poses_at(pose: np.ndarray, place: np.ndarray, is_length: np.ndarray) -> np.ndarray:
    """Poses (n, coordinate) at fractional positions (n,) among poses (frame, coordinate).

    Angles go along rotations, coordinates that are lengths (coordinate,) bool along straight lines.
    """
    before = np.minimum(place.astype(int), max(len(pose) - 2, 0))
    after, share = np.minimum(before + 1, len(pose) - 1), (place - before)[:, None]
    straight = (1 - share) * pose[before] + share * pose[after]
    near = straight[:, TRANSLATION:].reshape(len(place), -1, 3)
    first, second = (zyx_rotation(pose[frame, TRANSLATION:].reshape(near.shape)) for frame in (before, after))
    angles = near_zyx_angles(between(first, second, share), near)
    turned = np.concatenate([straight[:, :TRANSLATION], angles.reshape(len(place), -1)], axis=1)
    return np.where(is_length, straight, turned)


def stood_up(result: Result, up: str) -> Result:
    """The same motion before the same cameras, in a world whose up axis is ``up``, such as ``"+y"``.

    The world is turned about the axis that is neither its vertical nor the new one, or about x (z where x is the
    vertical) where it is to stand on its head: from +z to +y, (x, y, z) becomes (x, z, -y). Heights stay; the joints'
    standard deviations, which are along the axes of the world as it was, are dropped.
    """
    if up == result.cameras.up:
        return result
    turn = quarter_turn(result.cameras.up, up)

    def turned(pose: np.ndarray) -> np.ndarray:
        """Poses (..., coordinate): the root's place is in the world's axes, its angles are in the body's."""
        return np.concatenate([pose[..., :3] @ turn.T, pose[..., 3:]], axis=-1)

    subject = replace(result.subject, root_base=turn @ result.subject.root_base, pose=turned(result.subject.pose))
    cameras = replace(result.cameras, R=result.cameras.R @ turn.T, up=up)
    poses: dict[str, Any] = {name: turned(track) for name, track in _tracks(result).items()}
    return replace(result, subject=subject, cameras=cameras, joint_sigma=None, **poses)
