"""Poses in which two limbs have each other's place.

Two arms that each explain the other's mask are left neither by one of them alone nor by exchanging their angles:
mirrored, crossed arms are crossed. Where each goes to the other's place, they are not.
"""

from __future__ import annotations

import numpy as np

from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.contour.clip.motion_points import POINTS_A_JOINT, MotionPoints
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting

_STEPS = 12
_LARGEST = 0.5  # [rad] that a step turns a joint at most
_DAMPING = 1e-4  # [m^2/rad^2]: 10 mm at a joint is worth a radian


def places_exchanged(
    rooted: RootedPoses, pair: tuple[np.ndarray, np.ndarray], points: MotionPoints, rooting: Rooting
) -> RootedPoses:
    """Poses whose limbs' joints lie, as near as they can, where those of the other limb lay; all else stays.

    Args:
        rooted: poses (frame).
        pair: the coordinates (coordinate,) of each limb, joint by joint from the trunk on.
        points: of the body.
        rooting: moves poses, within their limits.
    """
    one, other = (np.unique((limb - TRANSLATION) // 3) for limb in pair)
    joints = np.concatenate([one, other])
    lay = points.at(rooted)[:, ::POINTS_A_JOINT]
    wanted = lay[:, np.concatenate([other, one])]
    moved = np.flatnonzero(np.isin(rooting.searched, np.concatenate(pair)))
    pose = rooted.pose.copy()
    pose[:, rooting.searched[moved]] = 0.0  # from rest: a crossed arm would have to pass through the trunk
    found = rooting.stepped(RootedPoses(rooted.base, pose), np.zeros((len(pose), len(rooting.searched))))
    for _ in range(_STEPS):
        place, derivative = points.linearised(found)
        away = (wanted - place[:, ::POINTS_A_JOINT][:, joints]).reshape(len(pose), -1, 1)
        by_angle = derivative[:, ::POINTS_A_JOINT][:, joints][..., moved].reshape(len(pose), -1, len(moved))
        across = np.swapaxes(by_angle, 1, 2)
        turned = np.linalg.solve(across @ by_angle + _DAMPING * np.eye(len(moved)), across @ away)[..., 0]
        step = np.zeros((len(pose), len(rooting.searched)))
        step[:, moved] = np.clip(turned, -_LARGEST, _LARGEST)
        found = rooting.stepped(found, step)
    return found
