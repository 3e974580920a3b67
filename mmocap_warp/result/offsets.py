"""Distances without constant offsets: two sources may put a joint at different places of the same body."""

from __future__ import annotations

import numpy as np

from mmocap_warp.body.posing import Poser
from mmocap_warp.result.positions import POSES_AT_ONCE, blocks
from mmocap_warp.result.result import Result


def offset_free_distance(result: Result, mine: np.ndarray, names: list[str], known: np.ndarray) -> np.ndarray:
    """Distances once each joint's median offset over the frames, in the axes of its parent, is taken out.

    Args:
        result: what was tracked; every run has offsets of its own.
        mine: positions of the frames to judge.
        names: joints of the body to judge.
        known: (len(mine), joint, 3), where these really were [m], NaN where that is unknown.

    Returns:
        (run, len(mine), joint) [m]; NaN where a joint is unknown.
    """
    skeleton = result.subject.body.skeleton
    joint = np.array([skeleton.index(name) for name in names], int)
    axes = np.maximum(np.array(skeleton.parent)[joint], 0)  # the root's own where it has no parent
    poser = Poser(result.subject.body, result.subject.root_base)
    distance = np.full((len(result.pose), *known.shape[:2]), np.nan)
    for run, pose in enumerate(result.pose[:, mine]):
        local = np.empty(known.shape)
        for block in blocks(len(pose), POSES_AT_ONCE):
            place = poser.joint_transforms(pose[block]).astype(np.float64)
            away = known[block] - place[:, joint][..., :3, 3]
            local[block] = np.einsum("fjba,fjb->fja", place[:, axes][..., :3, :3], away)
        seen = np.isfinite(local).any(axis=(0, 2))
        offset = np.nanmedian(local[:, seen], axis=0)
        distance[run][:, seen] = np.linalg.norm(local[:, seen] - offset, axis=-1)
    return distance
