"""Cameras over one floor: the same walk, seen by each in floor axes of its own, says how these lie to each other.

Two upright views of a walk differ by a turn about the vertical and a shift on the floor, and by no mirror image: both
look down on the same side of it. A straight walk therefore is enough.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mmocap_warp.calibration.solve.single_view import FEWEST_FRAMES, StandingView
from mmocap_warp.calibration.solve.unsolvable import UnsolvableError

_OUTLIER = 0.1  # [m], where places begin to count for less
_REWEIGHTINGS = 20


def placed_on_floor(names: Sequence[str], views: Sequence[StandingView]) -> tuple[np.ndarray, np.ndarray]:
    """R (camera, 3, 3) and t (camera, 3), world to camera, of cameras over a floor at z = 0.

    The first is the view with most frames, which stands over the origin and looks along +y; then the view that shares
    most frames with those that stand already.

    Args:
        names: of the cameras, for errors.
        views: each over its own floor.

    Raises:
        UnsolvableError: a view that shares too few frames with the others.
    """
    tracks = np.stack([view.track for view in views])  # (camera, frame, 2)
    seen = np.isfinite(tracks[..., 0])
    turn, shift = np.zeros((len(views), 2, 2)), np.zeros((len(views), 2))
    first = int(seen.sum(axis=1).argmax())
    turn[first] = np.eye(2)
    placed = [first]
    while len(placed) < len(views):
        known = seen[placed].any(axis=0)
        shared = np.where(np.isin(np.arange(len(views)), placed), -1, (seen & known).sum(axis=1))
        k = int(shared.argmax())
        if shared[k] < FEWEST_FRAMES:
            raise UnsolvableError(
                f"camera '{names[k]}' shows the whole person together with another in {shared[k]} frames; at least "
                f"{FEWEST_FRAMES} are needed"
            )
        common = seen[k] & known
        there = np.nanmean(
            [tracks[j][common] @ turn[j].T + shift[j] for j in placed], axis=0
        )  # each was seen by one of them at least
        turn[k], shift[k] = rigid_motion(tracks[k][common], there)
        placed.append(k)
    R, t = np.zeros((len(views), 3, 3)), np.zeros((len(views), 3))
    for k, view in enumerate(views):
        own = np.eye(3)
        own[:2, :2] = turn[k].T
        R[k] = view.R @ own
        t[k] = -R[k] @ [*shift[k], view.height]
    return R, t


def rigid_motion(here: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The turn (2, 2) and shift (2,) that take places to others, least squares reweighted by Cauchy's weights.

    Args:
        here: (n, 2), places [m].
        there: (n, 2), the same places [m].
    """
    weight = np.ones(len(here))
    for _ in range(_REWEIGHTINGS):
        a, b = np.average(here, axis=0, weights=weight), np.average(there, axis=0, weights=weight)
        moment = ((here - a) * weight[:, None]).T @ (there - b)
        angle = np.arctan2(moment[0, 1] - moment[1, 0], moment[0, 0] + moment[1, 1])
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        shift = b - turn @ a
        weight = 1 / (1 + (np.linalg.norm(here @ turn.T + shift - there, axis=1) / _OUTLIER) ** 2)
    return turn, shift
