"""Metres, the floor and the vertical for cameras that know how they stand to each other, from a person of known height.

Where a plane through two cameras touches the head, or a foot, is a point of the body itself. Heads that walk about lie
in a plane, but for the bobbing of the gait, and feet on the floor in another.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mmocap_warp.calibration.solve.person_axis import PersonInView
from mmocap_warp.calibration.solve.tangents import Pinholes, Tangents
from mmocap_warp.calibration.solve.unsolvable import UnsolvableError

_END = 0.07  # of the person's length in a view, within which a point belongs to the head or to a foot
_AGREED = 3.0  # [px], of a tangent that both views agree on
_STEEP = 0.2  # sine of the angle between two rays that say where they meet
_SOLE = 0.010  # [m], height over the floor of a foot's point that such a plane touches: soles are round, and roll
_OUTLIER = 0.02  # of the person's height: where heights begin to count for less
_AXIS = 0.05  # of the person's height: the body's axis tells the vertical as points do that lie so far about the middle
_REWEIGHTINGS = 30
_FEWEST = 20  # points of heads, and of feet


def levelled(
    cameras: Pinholes, tangents: Tangents, missed: np.ndarray, people: list[PersonInView], stature: float
) -> Pinholes:
    """The cameras in a world in metres, whose floor is at z = 0 and whose z points up; its origin is below the heads.

    Args:
        cameras: in a world whose z points up within a few degrees.
        tangents: of their views.
        missed: (n,), the tangents' residuals [px].
        people: the person in each view.
        stature: height of the top of the head over the floor that is usual in the recording [m].

    Raises:
        UnsolvableError: too few points of heads or of feet.
    """
    heads, head_frame = head_points(cameras, tangents, missed, people)
    feet, foot_frame = _points(cameras, tangents, missed, np.all(_along(tangents, people) < _END, axis=0))
    if min(len(heads), len(feet)) < _FEWEST:
        raise UnsolvableError(
            f"only {len(heads)} points of the head and {len(feet)} of the feet are seen by two cameras that agree, and "
            f"{_FEWEST} of each are needed for the floor; record more steps, or check that the cameras are synchronous"
        )
    upright = _upright(heads, head_frame, feet, foot_frame)
    turn, feet_height, top = _two_planes(heads, feet, upright)
    scale = (stature - _SOLE) / (top - feet_height)
    floor = feet_height - _SOLE / scale
    middle = np.append(np.median((heads @ turn.T)[:, :2], axis=0), floor)
    return replace(cameras, R=cameras.R @ turn.T, centre=scale * (cameras.centre @ turn.T - middle))


def head_points(
    cameras: Pinholes, tangents: Tangents, missed: np.ndarray, people: list[PersonInView]
) -> tuple[np.ndarray, np.ndarray]:
    """Points of the head that two views agree on, (n, 3) in the cameras' world, and their frames (n,); as above."""
    return _points(cameras, tangents, missed, np.all(_along(tangents, people) > 1 - _END, axis=0))


def _points(
    cameras: Pinholes, tangents: Tangents, missed: np.ndarray, wanted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    points, meet = _meeting(cameras, tangents)
    use = wanted & meet & (np.abs(missed) < _AGREED)
    return points[use], tangents.frame[use]


def _meeting(cameras: Pinholes, tangents: Tangents) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3), the middle between the two rays of each tangent; (n,) bool, whether they say where they meet."""
    a, b = cameras.rays(tangents.first, tangents.pixel[0]), cameras.rays(tangents.second, tangents.pixel[1])
    from_a, from_b = cameras.centre[tangents.first], cameras.centre[tangents.second]
    line = from_b - from_a
    cosine, on_a, on_b = (np.einsum("ni,ni->n", *pair) for pair in ((a, b), (line, a), (line, b)))
    sine = np.maximum(1 - cosine**2, 1e-12)
    far_a, far_b = (on_a - cosine * on_b) / sine, (cosine * on_a - on_b) / sine
    middle = 0.5 * (from_a + far_a[:, None] * a + from_b + far_b[:, None] * b)
    return middle, (sine > _STEEP**2) & (far_a > 0) & (far_b > 0)


def _along(tangents: Tangents, people: list[PersonInView]) -> np.ndarray:
    """(2, n), where on the way from foot to head each view's point lies: 0 at the foot's height, 1 at the head's."""
    head, foot = (np.stack([getattr(each, end) for each in people]) for end in ("head", "foot"))
    found = []
    for pixel, camera in zip(tangents.pixel, (tangents.first, tangents.second), strict=True):
        top, bottom = head[camera, tangents.frame], foot[camera, tangents.frame]
        length = ((top - bottom) ** 2).sum(axis=1)
        found.append(((pixel - bottom) * (top - bottom)).sum(axis=1) / length)
    return np.stack(found)


def _upright(heads: np.ndarray, head_frame: np.ndarray, feet: np.ndarray, foot_frame: np.ndarray) -> np.ndarray:
    """(3,), from feet to head in the mean over frames that show both; upwards where none does."""
    both = np.intersect1d(head_frame, foot_frame)
    if not len(both):
        return np.array([0.0, 0.0, 1.0])
    axes = [heads[head_frame == frame].mean(axis=0) - feet[foot_frame == frame].mean(axis=0) for frame in both]
    axis: np.ndarray = np.median(axes, axis=0)
    return axis


def _two_planes(heads: np.ndarray, feet: np.ndarray, upright: np.ndarray) -> tuple[np.ndarray, float, float]:
    """The rotation (3, 3) that makes both planes level, and the heights of the feet's and of the heads'.

    A walk along a line does not say how the planes lie across it: there the person's own axis counts.
    """
    from scipy.spatial.transform import Rotation

    turn = np.eye(3)
    points = np.concatenate([heads, feet])
    is_head = np.arange(len(points)) < len(heads)
    middle = points.mean(axis=0)
    top, floor = np.median(heads[:, 2]), np.median(feet[:, 2])
    for _ in range(_REWEIGHTINGS):
        x, y, z = ((points - middle) @ turn.T + middle).T
        outlier = _OUTLIER * (top - floor)
        missed = z - np.where(is_head, top, floor)
        weight = 1 / (1 + (missed / outlier) ** 2) / np.where(is_head, len(heads), len(feet)) * len(points)
        rows = np.stack([y - middle[1], middle[0] - x, is_head - 0.0, 1.0 - is_head], axis=1)  # tilts and heights
        trust = (_AXIS * (top - floor)) ** 2 * weight.sum()
        lean_x, lean_y, length = turn @ upright
        matrix = rows.T @ (weight[:, None] * rows)
        matrix[:2, :2] += trust * np.eye(2)
        target = rows.T @ (weight * z)
        target[:2] += trust * np.array([-lean_y, lean_x]) / length
        change = np.linalg.solve(matrix, target)
        turn = Rotation.from_rotvec([-change[0], -change[1], 0.0]).as_matrix() @ turn
        top, floor = change[2], change[3]
    return turn, float(floor - middle[2] + (turn @ middle)[2]), float(top - middle[2] + (turn @ middle)[2])
