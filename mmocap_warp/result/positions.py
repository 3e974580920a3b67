"""Where a subject's joints and skin are in many poses: posed in blocks, so that any number takes little memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mmocap_warp.body.model import SkinMesh, Subject
from mmocap_warp.body.posing import Poser

POSES_AT_ONCE = 4096  # a pose's joints are 1.4 KB on the way
_VERTICES_AT_ONCE = 1 << 20  # 12 MB


def joint_positions(subject: Subject, pose: np.ndarray) -> np.ndarray:
    """Joint centres in the world for full poses (n, coordinate): (n, joint, 3) float64 [m]."""
    poser = Poser(subject.body, subject.root_base)
    centres = np.empty((len(pose), len(subject.body.joint_rest), 3))
    for block in blocks(len(pose), POSES_AT_ONCE):
        centres[block] = poser.joint_transforms(pose[block])[:, :, :3, 3]
    return centres


def joint_transforms(subject: Subject, pose: np.ndarray) -> np.ndarray:
    """World transforms of the joints for full poses (n, coordinate): (n, joint, 4, 4) float32, for column vectors."""
    poser = Poser(subject.body, subject.root_base)
    transforms = np.empty((len(pose), len(subject.body.joint_rest), 4, 4), np.float32)
    for block in blocks(len(pose), POSES_AT_ONCE):
        transforms[block] = poser.joint_transforms(pose[block])
    return transforms


def skin_positions(subject: Subject, pose: np.ndarray, vertex: np.ndarray) -> np.ndarray:
    """Some of the skin's vertices (m,) int in the world for full poses (n, coordinate): (n, m, 3) float32 [m]."""
    skin = subject.body.skin
    some = SkinMesh(skin.rest[vertex], skin.face[:0], skin.joint[vertex], skin.weight[vertex])
    poser = Poser(replace(subject.body, skin=some), subject.root_base)
    positions = np.empty((len(pose), len(vertex), 3), np.float32)
    for block in blocks(len(pose), max(_VERTICES_AT_ONCE // max(len(vertex), 1), 1)):
        positions[block] = poser.vertices(pose[block])
    return positions


def blocks(count: int, size: int) -> Iterator[slice]:
    """``count`` things in slices of at most ``size``."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))
