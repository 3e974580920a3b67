"""Metres, the floor and the vertical for cameras whose relative poses are known, from a person of known height.

Where a plane through two cameras touches the head, or a foot, is a point of the body itself. The heads of all frames
lie in a plane, apart from the bobbing of the gait, and the feet on the floor lie in another.
"""

from dataclasses import replace

import numpy as np

from mmocap_warp.calibration.solve import UnsolvableError
from mmocap_warp.calibration.solve.person_axis import PersonInViews
from mmocap_warp.calibration.solve.tangents import MAX_MISS, Pinholes, find_tangents, residuals

_END_SHARE = 0.07  # share of the person's length in a view at either end that belongs to the head or to a foot
_MIN_SINE = 0.2  # sine of the angle between two rays that meet in a definite point, at least
_SOLE = 0.010  # metres over the floor of the foot's point that a plane touches: soles are round, and roll
_OUTLIER = 0.02  # share of the person's height: points that lie farther from their plane begin to count less
_AXIS = 0.05  # share of the person's height: the body's axis weighs as much as points at this distance from the middle
_REWEIGHTINGS = 30
_MIN_POINTS = 20  # points of heads, and of feet


def level_world(cameras: Pinholes, person: PersonInViews, stature: float | None) -> Pinholes:
    """The cameras in a world in metres, whose floor is at z = 0 and whose z points up; its origin is below the heads.

    The world that they are in points its z up within a few degrees. The ``stature`` is the height of the top of the
    head over the floor that is usual in the recording [m]; None where the cameras are in metres already. Raises an
    UnsolvableError for too few points of heads or of feet.
    """
    heads, head_frame, feet, foot_frame = head_and_foot_points(cameras, person)
    if min(len(heads), len(feet)) < _MIN_POINTS:
        raise UnsolvableError(
            f"only {len(heads)} points of the head and {len(feet)} of the feet are seen by two cameras that agree, and "
            f"{_MIN_POINTS} of each are needed for the floor; record more steps, or check that the cameras are "
            "synchronous"
        )
    # The person's axis from feet to head, the median over frames that show both; upwards where none does.
    both = np.intersect1d(head_frame, foot_frame)
    axes = [heads[head_frame == frame].mean(axis=0) - feet[foot_frame == frame].mean(axis=0) for frame in both]
    upright = np.median(axes, axis=0) if axes else np.array([0.0, 0.0, 1.0])
    # The rotation that makes both planes level, and the scale that puts the heads at their height over the floor.
    turn, feet_height, top = _fit_two_planes(heads, feet, upright)
    scale = 1.0 if stature is None else (stature - _SOLE) / (top - feet_height)
    middle = np.append(np.median((heads @ turn.T)[:, :2], axis=0), feet_height - _SOLE / scale)
    return replace(cameras, R=cameras.R @ turn.T, centre=scale * (cameras.centre @ turn.T - middle))


def head_and_foot_points(cameras: Pinholes, person: PersonInViews) -> tuple[np.ndarray, ...]:
    """Points of the head (n, 3) that two views agree on, their frames (n,), and the same of the feet."""
    tangents = find_tangents(cameras, person.hull)
    # The middle between the two rays of each tangent.
    a, b = cameras.rays(tangents.camera, tangents.pixel)
    from_a, from_b = cameras.centre[tangents.camera]
    line = from_b - from_a
    cosine, on_a, on_b = (np.einsum("ni,ni->n", *pair) for pair in ((a, b), (line, a), (line, b)))
    sine = np.maximum(1 - cosine**2, 1e-12)
    far_a, far_b = (on_a - cosine * on_b) / sine, (cosine * on_a - on_b) / sine
    middle = 0.5 * (from_a + far_a[:, None] * a + from_b + far_b[:, None] * b)
    # Rays must meet before both cameras, and at an angle that is not too small.
    meet = (sine > _MIN_SINE**2) & (far_a > 0) & (far_b > 0) & (np.abs(residuals(cameras, tangents)) < MAX_MISS)
    # Where between foot and head both views' points lie: 0 at the foot's height, 1 at the head's.
    bottom = person.foot[tangents.camera, tangents.frame]
    upwards = person.head[tangents.camera, tangents.frame] - bottom
    share = ((tangents.pixel - bottom) * upwards).sum(axis=-1) / (upwards**2).sum(axis=-1)  # (view, n)
    at_head, at_foot = (meet & np.all(end, axis=0) for end in (share > 1 - _END_SHARE, share < _END_SHARE))
    return middle[at_head], tangents.frame[at_head], middle[at_foot], tangents.frame[at_foot]


def _fit_two_planes(heads: np.ndarray, feet: np.ndarray, upright: np.ndarray) -> tuple[np.ndarray, float, float]:
    """The rotation (3, 3) that makes both planes level, and the heights of the feet's plane and of the heads'.

    A walk along a line does not determine the planes' tilt across it; there the person's own axis decides.
    """
    from scipy.spatial.transform import Rotation

    turn = np.eye(3)
    points = np.concatenate([heads, feet])
    is_head, middle = np.arange(len(points)) < len(heads), points.mean(axis=0)
    top, floor = np.median(heads[:, 2]), np.median(feet[:, 2])
    for _ in range(_REWEIGHTINGS):
        # Each point's distance from its plane gives its weight; heads and feet weigh alike in sum.
        x, y, z = ((points - middle) @ turn.T + middle).T
        outlier = _OUTLIER * (top - floor)
        missed = z - np.where(is_head, top, floor)
        weight = 1 / (1 + (missed / outlier) ** 2) / np.where(is_head, len(heads), len(feet)) * len(points)
        # Normal equations for two tilts and two heights, with the person's axis as a prior of the tilts.
        rows = np.stack([y - middle[1], middle[0] - x, is_head - 0.0, 1.0 - is_head], axis=1)
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
