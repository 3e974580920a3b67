"""Points that ride on the joints: their accelerations measure how a body moves, in metres and for any skeleton."""

import numpy as np

from mmocap_warp.body.rotations import applied, transposed, turn, zyx_rotation
from mmocap_warp.body.skeleton import TRANSLATION, Skeleton
from mmocap_warp.contour.frame.rooted import RootedPoses

ARM = 0.1  # how far from its joint's centre a point lies that shows how the joint turns [m]
POINTS_A_JOINT = 4


class MotionPoints:
    """Each joint's centre, then a point on each of its axes; differentiated by ``searched`` (dof,) coordinates."""

    def __init__(self, skeleton: Skeleton, joint_rest: np.ndarray, searched: np.ndarray) -> None:
        self._parent, self._frame = skeleton.parent, skeleton.frame.astype(float)
        self.searched = [int(coordinate) for coordinate in searched]
        self.below, self.slides = skeleton.below, skeleton.slides  # (joint, joint) and (joint,) bool
        # How each joint is held by its parent, whose level is the one before: a level is posed at once.
        rest, parent, depth = np.asarray(joint_rest, float), np.array(skeleton.parent), skeleton.depth
        self._held, self._bone = self._frame.copy(), np.zeros((len(parent), 3))
        for joint, above in enumerate(skeleton.parent[1:], 1):
            into_parent = self._frame[above].T
            self._held[joint] = into_parent @ self._frame[joint]
            self._bone[joint] = into_parent @ (rest[joint] - rest[above])
        levels = (np.flatnonzero(depth == level) for level in range(1, depth.max() + 1))
        self._levels = [(joints, parent[joints]) for joints in levels]

    def at(self, rooted: RootedPoses) -> np.ndarray:
        """The points of each frame, (frame, point, 3) [m]; joint ``j`` has numbers ``4 j`` to ``4 j + 3``."""
        return self.with_axes(rooted)[0]

    def with_axes(self, rooted: RootedPoses) -> tuple[np.ndarray, np.ndarray]:
        """The points, and what each joint's angles turn about, or what it slides along, (frame, joint, axis, 3)."""
        world, centre, axes = self._joints(rooted)
        return _points(world, centre).reshape(len(rooted), -1, 3), axes

    def apart(self, one: RootedPoses, other: RootedPoses) -> np.ndarray:
        """(frame,) how far the joint is that lies farthest from where it lies in another pose [m]."""
        return np.asarray(np.linalg.norm(self._centres(one) - self._centres(other), axis=2).max(axis=1))

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
            below, moved = self.below[joint], axes[:, joint, axis, None, None]
            if not self.slides[joint]:
                moved = np.cross(moved, points[:, below] - centre[:, joint, None, None])
            derivative[:, number, below] = moved
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

    def _centres(self, rooted: RootedPoses) -> np.ndarray:
        """The second of what ``_joints`` gives, but for rounding, in a third of the time."""
        angles = rooted.pose[:, TRANSLATION:].reshape(len(rooted), -1, 3)
        slides = self.slides[:, None]
        turned = self._held @ np.where(slides[..., None], np.eye(3), zyx_rotation(angles))
        bone = self._bone + applied(self._held, angles * slides)
        world, centre = turned, np.empty_like(angles)
        world[:, 0], centre[:, 0] = rooted.base @ turned[:, 0], rooted.pose[:, :TRANSLATION]
        for joints, parent in self._levels:
            above = world[:, parent]
            centre[:, joints] = centre[:, parent] + applied(above, bone[:, joints])
            world[:, joints] = above @ turned[:, joints]
        return centre

    def _joints(self, rooted: RootedPoses) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """World rotations (frame, joint, 3, 3), centres (frame, joint, 3), axes turned about (frame, joint, axis, 3).

        Of a joint that slides, the axes that it slides along.

        ``Rx`` turns about an axis that ``Ry`` and ``Rz`` have moved, ``Ry`` about one that ``Rz`` has, in the world.
        """
        frames, count = len(rooted), len(self._parent)
        angles = rooted.pose[:, TRANSLATION:].reshape(frames, count, 3)
        about_x, about_y, about_z = (turn(axis, angles[..., i]) for i, axis in enumerate("xyz"))
        world, axes = np.zeros((2, frames, count, 3, 3))
        centre = np.zeros((frames, count, 3))
        held = (rooted.base @ self._held[0])[:, None]
        centre[:, 0] = rooted.pose[:, :TRANSLATION]
        for joints, parent in [(np.zeros(1, int), None), *self._levels]:
            if parent is not None:
                held = world[:, parent] @ self._held[joints]
                centre[:, joints] = centre[:, parent] + applied(world[:, parent], self._bone[joints])
            turned_z = held @ about_z[:, joints]
            turned_y = turned_z @ about_y[:, joints]
            axes[:, joints] = np.stack([turned_y[..., 0], turned_z[..., 1], held[..., 2]], axis=2)
            world[:, joints] = turned_y @ about_x[:, joints]
            if (slides := self.slides[joints]).any():
                sliding, held = joints[slides], held[:, slides]
                centre[:, sliding] += applied(held, angles[:, sliding])
                world[:, sliding], axes[:, sliding] = held, transposed(held)
        return world, centre, axes


def _points(world: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(frame, joint, 4, 3)."""
    at_centre = centre[:, :, None]
    return np.concatenate([at_centre, at_centre + ARM * transposed(world)], axis=2)
