"""Posing a body in double precision with NumPy: the same to the last pixel on any machine, and without the tracker."""

from functools import cached_property

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import applied, zyx_rotation


class ExactPoser:
    """Poses a body in the world; it takes and gives what :class:`mmocap_warp.body.posing.Poser` does."""

    def __init__(self, body: BodyModel, root_base: np.ndarray) -> None:
        self._body, self._root_base = body, root_base
        self._frame = body.skeleton.frame.astype(np.float64)
        self._joint_rest = body.joint_rest.astype(np.float64)
        self._rest = body.skin.rest.astype(np.float64)
        # (joint, 3, 4), into the joints' frames from the bind pose
        place = -np.einsum("jba,jb->ja", self._frame, self._joint_rest)
        self._from_bind = np.concatenate([self._frame.transpose(0, 2, 1), place[..., None]], axis=2)

    def joint_transforms(self, poses: np.ndarray) -> np.ndarray:
        """World transforms of the joints' frames for full poses (n, 51): (n, joint, 4, 4) float64, column vectors."""
        rest, frame = self._joint_rest, self._frame
        own = zyx_rotation(poses[:, 3:].reshape(len(poses), len(rest), 3))
        world = np.zeros((len(poses), len(rest), 4, 4))
        world[..., 3, 3] = 1.0
        for j, parent in enumerate(self._body.skeleton.parent):
            if parent < 0:
                world[:, j, :3, :3] = self._root_base @ frame[j] @ own[:, j]
                world[:, j, :3, 3] = poses[:, :3]
                continue
            into_parent, axes = frame[parent].T, world[:, parent, :3, :3]
            held, slides = axes @ (into_parent @ frame[j]), self._body.skeleton.slides[j]
            world[:, j, :3, :3] = held if slides else held @ own[:, j]
            world[:, j, :3, 3] = world[:, parent, :3, 3] + axes @ (into_parent @ (rest[j] - rest[parent]))
            if slides:
                world[:, j, :3, 3] += applied(held, poses[:, 3 + 3 * j : 6 + 3 * j])
        return world

    def vertices(self, poses: np.ndarray) -> np.ndarray:
        """The full mesh's vertices in the world for full poses (n, 51): (n, vertex, 3) float64 [m]."""
        vertices = []
        for transforms in self.joint_transforms(poses)[:, :, :3]:  # (joint, 3, 4) of a frame
            moved = transforms[:, :, :3] @ self._from_bind
            moved[:, :, 3] += transforms[:, :, 3]
            blended = (self._weight @ moved.reshape(-1, 12)).reshape(-1, 3, 4)
            vertices.append(np.einsum("vab,vb->va", blended[:, :, :3], self._rest) + blended[:, :, 3])
        return np.stack(vertices)

    def moving(self, poses: np.ndarray, frame: int, fps: float) -> np.ndarray:
        """The full mesh's vertices in a frame of a motion (frame, 51), so many a second: (vertex, 3) float64 [m]."""
        return self.vertices(poses[frame : frame + 1])[0]

    @cached_property
    def _weight(self) -> np.ndarray:
        """(vertex, joint), rows sum to one."""
        skin = self._body.skin
        weight = np.zeros((len(skin.rest), len(self._joint_rest)))
        np.add.at(weight, (np.arange(len(skin.rest))[:, None], skin.joint), skin.weight.astype(np.float64))
        return weight / weight.sum(axis=1, keepdims=True)


def led_by(body: BodyModel, *joints: str) -> np.ndarray:
    """(vertex,) bool: the full mesh's vertices on which one of these joints has the most weight."""
    return np.isin(body.skin.heaviest_joint, [body.skeleton.index(name) for name in joints])
