"""Limits and spreads of a body's angles, learnt from what it was seen to do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mmocap_warp.body.skeleton import TRANSLATION, Skeleton

_OUTLIERS = 0.005  # share of frames at either end that may be wrong
_LEAST_SPREAD = 0.05  # [rad]


def learnt(skeleton: Skeleton, poses: np.ndarray, margin: float) -> Skeleton:
    """The skeleton with limits and spreads of the angles that it searches, but the root's, as poses have them.

    Limits leave out the most extreme frames, half a percent at either end. A joint's spread is the root mean square of
    the angle that strays most from the zero pose. What slides stays as it is.

    Args:
        skeleton: the joints.
        poses: (frame, coordinate).
        margin: that limits are wider than the angles seen, at either end [rad].
    """
    limits, spread = skeleton.limits.copy(), skeleton.spread.copy()
    seen = np.full(len(skeleton.joints), _LEAST_SPREAD)
    for coordinate in skeleton.searched_angles():
        joint, axis = divmod(int(coordinate) - TRANSLATION, 3)
        angle = poses[:, coordinate]
        low, high = np.quantile(angle, [_OUTLIERS, 1 - _OUTLIERS])
        limits[joint, axis] = low - margin, high + margin
        seen[joint] = max(seen[joint], float(np.sqrt(np.mean(angle**2))))
        spread[joint] = seen[joint]
    return replace(skeleton, limits=limits, spread=spread)
