"""Posing a body in double precision with NumPy: the same to the last pixel on any machine, and without the tracker."""

from __future__ import annotations

import numpy as np

from mmocap_warp.bodies.human import JOINTS, PARENT
from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import turn


def joint_transforms(body: BodyModel, root_base: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """World transforms of the joints' frames.

    Args:
        body: the body.
        root_base: (3, 3), world from body axes at zero root rotation.
        poses: (frame, 51) full pose vectors.

    Returns:
        (frame, joint, 3, 4) float64: axes, and the place in the last column [m].
    """
    angles = poses[:, 3:].reshape(len(poses), len(JOINTS), 3)
    own = turn("z", angles[..., 2]) @ turn("y", angles[..., 1]) @ turn("x", angles[..., 0])
    rest, frame = body.joint_rest.astype(np.float64), body.skeleton.frame.astype(np.float64)
    world = np.zeros((len(poses), len(JOINTS), 3, 4))
    for j, parent in enumerate(PARENT):
        if parent < 0:
            world[:, j, :, :3] = root_base @ frame[j] @ own[:, j]
            world[:, j, :, 3] = poses[:, :3]
            continue
        into_parent = frame[parent].T
        axes = world[:, parent, :, :3]
        world[:, j, :, :3] = axes @ (into_parent @ frame[j]) @ own[:, j]
        world[:, j, :, 3] = world[:, parent, :, 3] + axes @ (into_parent @ (rest[j] - rest[parent]))
    return world


class SkinnedBody:
    """A body's full mesh, ready to follow its joints."""

    def __init__(self, body: BodyModel) -> None:
        skin, frame = body.skin, body.skeleton.frame.astype(np.float64)
        self._weight = np.zeros((len(skin.rest), len(JOINTS)))
        np.add.at(self._weight, (np.arange(len(skin.rest))[:, None], skin.joint), skin.weight.astype(np.float64))
        self._weight /= self._weight.sum(axis=1, keepdims=True)
        self._rest = skin.rest.astype(np.float64)
        self._from_bind = np.concatenate(
            [frame.transpose(0, 2, 1), -np.einsum("jba,jb->ja", frame, body.joint_rest.astype(np.float64))[..., None]],
            axis=2,
        )

    def vertices(self, transforms: np.ndarray) -> np.ndarray:
        """(vertex, 3) float64 in the world [m], from one frame's joint transforms (joint, 3, 4)."""
        moved = transforms[:, :, :3] @ self._from_bind
        moved[:, :, 3] += transforms[:, :, 3]
        blended = (self._weight @ moved.reshape(len(JOINTS), 12)).reshape(-1, 3, 4)
        return np.einsum("vab,vb->va", blended[:, :, :3], self._rest) + blended[:, :, 3]
