"""What else stands or moves before cameras: a person who walks by, and a piece of furniture; as perfect silhouettes."""

from dataclasses import replace

import numpy as np

from mmocap_warp.body.shape_space import heading_rotation, upright_base
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.footage.outlines import Surface, draw_outlines
from mmocap_warp.synthesis.motion.stored_poses import PASSER_BY_RATE, stored_poses
from mmocap_warp.synthesis.walkers import PEOPLE

_NEAREST = 0.3  # a camera does not see what is nearer to its plane [m]
_HEADING = 0.7  # direction of the passer-by [rad]
_HALF_WAY = 2.6  # the passer-by is seen this far before and after the middle of the way [m]
_SIZE = (0.7, 0.75, 0.45)  # width, height and depth of the furniture [m]
_BEARING = 2.0  # direction of the furniture from the middle of the room [rad]
_BOX = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])  # faces


class PasserBy:
    """Somebody who walks by in a straight line, at time zero nearest to ``middle``, and ``aside`` of it [m].

    The cameras are undistorted; the floor, with ``middle`` (3,) on it, is at zero along their up axis.
    """

    def __init__(self, rig: CameraRig, middle: np.ndarray, aside: float) -> None:
        body = PEOPLE["S3"].true_body()
        self._rig, self._middle, self._aside = rig, middle, aside
        self._base = upright_base(rig.up) @ heading_rotation(_HEADING)
        self._poser = ExactPoser(replace(body, skin=body.tracking), self._base)
        self._surface = Surface.of(body.tracking.face)
        self._way = stored_poses("passer-by")

    def silhouettes(self, time: float) -> list[np.ndarray]:
        """Per camera (height, width) bool, at a time [s]; empty where the person is not near."""
        pose = self._pose(time)
        if abs(pose[2]) > _HALF_WAY:
            return [np.zeros((height, width), bool) for width, height in self._rig.size]
        pose[:3] = self._placed(pose)
        return _silhouettes_before(self._rig, self._poser.vertices(pose[None])[0], self._surface)

    def place(self, time: float) -> np.ndarray:
        """(3,) where the person's root is, at a time [s]."""
        return self._placed(self._pose(time))

    def _pose(self, time: float) -> np.ndarray:
        """(coordinate,) on the line between two stored poses."""
        at = round(PASSER_BY_RATE * time, 9) + len(self._way) // 2
        before = min(max(int(at), 0), len(self._way) - 2)
        pose, after = self._way[before : before + 2]
        return np.asarray(pose + (at - before) * (after - pose))

    def _placed(self, pose: np.ndarray) -> np.ndarray:
        return np.asarray((pose[:3] + np.array([self._aside, 0.0, 0.0])) @ self._base.T + self._middle)


def furniture(rig: CameraRig, middle: np.ndarray, aside: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Silhouettes of a chest ``aside`` of ``middle`` [m], per camera (height, width) bool; and (3,) where it stands."""
    turned = upright_base(rig.up) @ heading_rotation(_BEARING)
    # Corners on the floor about the origin, in the order of their numbers' binary digits.
    digits = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)])
    corners = ((digits - (0.5, 0.0, 0.5)) * _SIZE + np.array([0.0, 0.0, aside])) @ turned.T + middle
    return _silhouettes_before(rig, corners, Surface.of(_BOX)), middle + aside * turned[:, 2]


def _silhouettes_before(rig: CameraRig, vertices: np.ndarray, surface: Surface) -> list[np.ndarray]:
    """Silhouettes in each camera; a camera sees nothing if the surface is not wholly in front of it."""
    depth = (np.einsum("kj,vj->kv", rig.R[:, 2], vertices) + rig.t[:, 2:]).min(axis=1)
    masks = [np.zeros((height, width), bool) for width, height in rig.size]
    for k in np.flatnonzero(depth > _NEAREST):
        masks[k] = draw_outlines(rig.select((rig.names[k],)), vertices, surface)[0]
    return masks
