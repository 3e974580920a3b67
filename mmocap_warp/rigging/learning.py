"""Limits and spreads of a body's joints, learnt from what it was seen to do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mmocap_warp.body.skeleton import TRANSLATION, Skeleton

_OUTLIERS = 0.005  # share of frames at either end that may be wrong
_LEAST_SPREAD = 0.05  # [rad]
_LEAST_SHIFT = 0.001  # [m]
_SHIFT_MARGIN = 0.1  # of the travel seen, at either end


def learnt(skeleton: Skeleton, poses: np.ndarray, margin: float) -> Skeleton:
    """The skeleton with limits and spreads of the angles that it searches, but the root's, as poses have them.

    Limits leave out the most extreme frames, half a percent at either end. A joint's spread is the root mean square of
    the angle that strays most from the zero pose. Joints that slide likewise, a tenth of the travel seen beyond it and
    never beyond the limits that they had: those are where the hardware stops. What is attached stays as it is.

    Args:
        skeleton: the joints.
        poses: (frame, coordinate).
        margin: that limits of angles are wider than what was seen, at either end [rad].
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
    seen[:] = _LEAST_SHIFT
    for coordinate in skeleton.searched_shifts():
        joint, axis = divmod(int(coordinate) - TRANSLATION, 3)
        shift = poses[:, coordinate]
        low, high = np.quantile(shift, [_OUTLIERS, 1 - _OUTLIERS])
        wider = _SHIFT_MARGIN * (high - low)
        limits[joint, axis] = np.clip([low - wider, high + wider], *skeleton.limits[joint, axis])
        seen[joint] = max(seen[joint], float(np.sqrt(np.mean(shift**2))))
        spread[joint] = seen[joint]
    return replace(skeleton, limits=limits, spread=spread)
