"""Who is in front of whom, of several people before the same cameras."""

import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.visual_hull import meeting_point

_SURE = 0.15  # by how much nearer to a camera somebody must be who is surely in front [m]: half a trunk's depth


def in_front_of(rig: CameraRig, masks: list[np.ndarray], others: list[list[np.ndarray]]) -> list[np.ndarray]:
    """What may be in front of a person in each view: things and other people, but who is surely behind.

    A person is where the rays through the masks' centroids meet, which needs no pose.

    Args:
        rig: undistorted pinholes, as the masks.
        masks: the person's, per camera (height, width) bool.
        others: per camera what has no known depth, then each of the other people: (height, width) bool.

    Returns:
        Per camera (height, width) bool.
    """
    place = _place(rig, masks)
    hides, *people = zip(*others, strict=True)
    for theirs in people:
        behind = rig.R[:, 2] @ (_place(rig, theirs) - place) > _SURE  # (camera,), of an unknown place nowhere
        hides = [one if far else one | mask for one, mask, far in zip(hides, theirs, behind, strict=True)]
    return [*hides]


def _place(rig: CameraRig, masks: list[np.ndarray] | tuple[np.ndarray, ...]) -> np.ndarray:
    """(3,) [m], NaN where fewer than two views show anything."""
    return meeting_point(rig, [*masks]) if sum(mask.any() for mask in masks) > 1 else np.full(3, np.nan)
