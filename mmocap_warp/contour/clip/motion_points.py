"""Points that ride on the joints: their accelerations measure how a body moves, in metres and for any skeleton."""

import numpy as np

from mmocap_warp.body.rotations import applied, transposed, turn
from mmocap_warp.body.skeleton import TRANSLATION, Skeleton
from mmocap_warp.contour.frame.rooted import RootedPoses

ARM = 0.1
"""How far from its joint's centre a point lies that shows how the joint turns [m]."""
POINTS_A_JOINT = 4


class MotionPoints:
    """Each joint's centre, then a point on each of its axes; differentiated by ``searched`` (dof,) coordinates."""

    def __init__(self, skeleton: Skeleton, joint_rest: np.ndarray, searched: np.ndarray) -> None:
        self._parent = skeleton.parent
        self._frame = skeleton.frame.astype(float)
        self._rest = np.asarray(joint_rest, float)
        self.searched = [int(coordinate) for coordinate in searched]
        self.below, self.slides = skeleton.below, skeleton.slides  # (joint, joint) and (joint,) bool

    def at(self, rooted: RootedPoses) -> np.ndarray:
        """The points of each frame, (frame, point, 3) [m]; joint ``j`` has numbers ``4 j`` to ``4 j + 3``."""
        return self.with_axes(rooted)[0]

    def with_axes(self, rooted: RootedPoses) -> tuple[np.ndarray, np.ndarray]:
        """The points, and what each joint's angles turn about, or what it slides along, (frame, joint, axis, 3)."""
        world, centre, axes = self._joints(rooted)
        return _points(world, centre).reshape(len(rooted), -1, 3), axes

    def linearised(self, rooted: RootedPoses) -> tuple[np.ndarray, np.ndarray]:
        """The points, and their derivatives by the searched coordinates, (frame, point, 3, dof) [m, m/rad]."""
        world, centre, axes = self._joints(rooted)
        points = _points(world, centre)  # (frame, joint, 4, 3)
        frames, joints = centre.shape[:2]
        derivative = np.zeros((frames, len(self.searched), joints, POINTS_A_JOINT, 3))
        for number, coordinate in enumerate(self.searched):
            if coordinate < TRANSLATION:
                derivative[:, number, ..., coordinate] = 1.0
                continue
            joint, axis = divmod(coordinate - TRANSLATION, 3)
            below = self.below[joint]
            if self.slides[joint]:
                derivative[:, number, below] = axes[:, joint, axis, None, None]
                continue
            arm = points[:, below] - centre[:, joint, None, None]
            derivative[:, number, below] = np.cross(axes[:, joint, axis, None, None], arm)
        by_point = derivative.reshape(frames, len(self.searched), joints * POINTS_A_JOINT, 3)
        return points.reshape(frames, -1, 3), np.moveaxis(by_point, 1, -1)

    def centres_by_rest(self, rooted: RootedPoses, change: np.ndarray) -> np.ndarray:
        """Derivatives of the joints' centres, (frame, joint, 3, parameter).

        ``change`` (parameter, joint, 3) has those of the centres in the bind pose.
        """
        world, centre, _ = self._joints(rooted)
        derivative = np.zeros((*centre.shape, len(change)))
        for joint, parent in enumerate(self._parent):
            if parent >= 0:
                bone = (change[:, joint] - change[:, parent]) @ self._frame[parent]
                derivative[:, joint] = derivative[:, parent] + world[:, parent] @ bone.T
        return derivative

    def _joints(self, rooted: RootedPoses) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """World rotations (frame, joint, 3, 3), centres (frame, joint, 3), axes turned about (frame, joint, axis, 3).

        Of a joint that slides, the axes that it slides along.

        ``Rx`` turns about an axis that ``Ry`` and ``Rz`` have moved, ``Ry`` about one that ``Rz`` has, in the world.
        """
        frames, joints = len(rooted), len(self._parent)
        angles = rooted.pose[:, TRANSLATION:].reshape(frames, joints, 3)
        about_x, about_y, about_z = (turn(axis, angles[..., i]) for i, axis in enumerate("xyz"))
        world, axes = np.zeros((2, frames, joints, 3, 3))
        centre = np.zeros((frames, joints, 3))
        for joint, parent in enumerate(self._parent):
            if parent < 0:
                held = rooted.base @ self._frame[joint]
                centre[:, joint] = rooted.pose[:, :TRANSLATION]
            else:
                into_parent = self._frame[parent].T
                held = world[:, parent] @ (into_parent @ self._frame[joint])
                bone = into_parent @ (self._rest[joint] - self._rest[parent])
                centre[:, joint] = centre[:, parent] + applied(world[:, parent], bone)
            if self.slides[joint]:
                centre[:, joint] += applied(held, angles[:, joint])
                world[:, joint], axes[:, joint] = held, transposed(held)
                continue
            turned_z = held @ about_z[:, joint]
            turned_y = turned_z @ about_y[:, joint]
            axes[:, joint] = np.stack([turned_y[..., 0], turned_z[..., 1], held[..., 2]], axis=1)
            world[:, joint] = turned_y @ about_x[:, joint]
        return world, centre, axes


def _points(world: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(frame, joint, 4, 3)."""
    at_centre = centre[:, :, None]
    return np.concatenate([at_centre, at_centre + ARM * transposed(world)], axis=2)
