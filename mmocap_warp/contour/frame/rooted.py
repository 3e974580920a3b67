"""Poses whose root is turned by a base of its own in each frame, so that its three angles stay at zero.

Euler angles lock where the middle one reaches a quarter turn, and a person who turns round gets there. Least squares
take small steps: they count the root's angles from where the root is now, fold each step into the base, and ask for
the angles of the usual kind when they have finished.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from mmocap_warp.body.rotations import transposed, turn, zyx_rotation
from mmocap_warp.body.skeleton import ROOT_ANGLES, Skeleton

_ROOM = 10.0  # width of the room that a place without limits is in [m]


class FrameArrays:
    """A frozen dataclass of arrays, or such dataclasses again, with one frame a row, and of what all frames share."""

    def __getitem__(self, frames: slice | np.ndarray) -> Self:
        values = vars(self).values()
        return type(self)(*(each[frames] if isinstance(each, np.ndarray | FrameArrays) else each for each in values))

    def where(self, taken: np.ndarray, other: Self) -> Self:
        """These where they are ``taken``, (frame,) bool or with the arrays' next axes too, and others elsewhere."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return type(self)(*(np.where(taken[(..., *[None] * (a.ndim - taken.ndim))], a, b) for a, b in pairs))

    def followed_by(self, *more: Self) -> Self:
        """These frames, then the others."""
        columns = zip(*(vars(each).values() for each in (self, *more)), strict=True)
        return type(self)(*(_joined(*column) for column in columns))


def _joined(first: Any, *rest: Any) -> Any:
    if isinstance(first, FrameArrays):
        return first.followed_by(*rest)
    return np.concatenate([first, *rest]) if isinstance(first, np.ndarray) else first


@dataclass(frozen=True, eq=False)
class RootedPoses(FrameArrays):
    """Poses with a root base for every frame."""

    base: np.ndarray  # (frame, 3, 3) float64, world from body axes at zero root rotation
    pose: np.ndarray  # (frame, coordinate) float64 [m, rad]; the root's angles count from the frame's base

    def __len__(self) -> int:
        return len(self.pose)

    def with_frames(self, frames: np.ndarray, other: Self) -> Self:
        """These, with others in some frames by their numbers."""
        base, pose = self.base.copy(), self.pose.copy()
        base[frames], pose[frames] = other.base, other.pose
        return type(self)(base, pose)

    def interpolated(self, known: np.ndarray) -> Self:
        """These poses, where those that are not ``known`` (frame,) are interpolated between the known ones around them.

        Before the first and after the last known frame its pose is repeated; where none is known nothing changes.
        """
        at = np.flatnonzero(known)
        if len(at) in (0, len(known)):
            return self
        from scipy.spatial.transform import Rotation, Slerp

        frames = np.clip(np.arange(len(known)), at[0], at[-1])
        pose = np.stack([np.interp(frames, at, values) for values in self.pose[at].T], axis=1)
        if len(at) == 1:
            return type(self)(np.repeat(self.base[at], len(known), axis=0), pose)
        base = Slerp(at, Rotation.from_matrix(self.base[at]))(frames).as_matrix()
        return type(self)(np.where(known[:, None, None], self.base, base), pose)


@dataclass(frozen=True, eq=False)
class Neighbours(FrameArrays):
    """The poses before and after some: they tell how the skin moves, for views that were taken at another time."""

    before: RootedPoses  # anything where there is none
    after: RootedPoses  # likewise
    sides: np.ndarray  # (pose,) int32, 1 for the pose before plus 2 for that after
    rate: float  # poses a second
    curved: bool = True  # whether the motion is a parabola through all three, or a straight line

    @classmethod
    def of(cls, course: RootedPoses, frames: np.ndarray, rate: float, *, curved: bool = True) -> Self:
        """Those of frames by their numbers in a course of poses, ``rate`` a second."""
        last = len(course) - 1
        sides = ((frames > 0) + 2 * (frames < last)).astype(np.int32)
        return cls(course[np.maximum(frames - 1, 0)], course[np.minimum(frames + 1, last)], sides, rate, curved)


class Rooting:
    """Turns poses into rooted ones, moves them and turns them back.

    Steps are taken in the ``searched`` (dof,) coordinates, within ``limits`` (coordinate, 2), or the joints' own. If a
    model does not search all three angles of the root, all frames keep the one base (3, 3): from another base, the
    angles that are held would be others.
    """

    def __init__(
        self, skeleton: Skeleton, root_base: np.ndarray, searched: np.ndarray, limits: np.ndarray | None = None
    ) -> None:
        self.searched = np.asarray(searched)
        self.root_base = np.asarray(root_base, float)
        self.folds = bool(np.isin(np.arange(ROOT_ANGLES.start, ROOT_ANGLES.stop), self.searched).all())
        self.none = RootedPoses(np.zeros((0, 3, 3)), np.zeros((0, skeleton.coordinates)))
        self.is_length = skeleton.is_length[self.searched]
        self._frame = skeleton.frame[0].astype(float)
        self._into_frame = np.linalg.inv(self._frame)  # of rounded numbers: its transpose would turn the root a little
        limits = (skeleton.coordinate_limits if limits is None else limits).copy()
        if self.folds:
            limits[ROOT_ANGLES] = -np.inf, np.inf
        self._limits = limits[self.searched]

    @property
    def anywhere(self) -> np.ndarray:
        """(dof,) standard deviation of each searched coordinate if all that is known of it is its limits [m, rad].

        A free angle is anywhere in a turn, a place without limits within some ten metres.
        """
        turns = np.where(np.isfinite(self._limits), self._limits, (-np.pi, np.pi))
        widest = turns[:, 1] - turns[:, 0]
        free_place = self.is_length & ~np.isfinite(self._limits).all(axis=1)
        return np.where(free_place, _ROOM, np.maximum(widest, 1e-3) / np.sqrt(12))

    def enter(self, pose: np.ndarray) -> RootedPoses:
        """Rooted poses of poses (frame, coordinate)."""
        base = np.tile(self.root_base, (len(pose), 1, 1))
        return self.refold(RootedPoses(base, np.array(pose, float)))

    def refold(self, rooted: RootedPoses) -> RootedPoses:
        """The same poses, with the root's angles in the base."""
        if not self.folds:
            return rooted
        pose = rooted.pose.copy()
        pose[:, ROOT_ANGLES] = 0.0
        turned = self._frame @ zyx_rotation(rooted.pose[:, ROOT_ANGLES]) @ self._into_frame
        return RootedPoses(rooted.base @ turned, pose)

    def stepped(self, rooted: RootedPoses, step: np.ndarray) -> RootedPoses:
        """Rooted poses after steps (frame, dof) of the searched coordinates, which stop at the joints' limits."""
        pose = rooted.pose.copy()
        pose[:, self.searched] = np.clip(pose[:, self.searched] + step, self._limits[:, 0], self._limits[:, 1])
        return self.refold(RootedPoses(rooted.base, pose))

    def root_axes(self, rooted: RootedPoses) -> np.ndarray:
        """(frame, 3, 3) in the columns: the axes in the world that the root's angles turn about where they are zero."""
        return np.asarray(rooted.base @ self._frame)

    def leave(self, rooted: RootedPoses, near: np.ndarray) -> np.ndarray:
        """Poses (frame, coordinate) float64 that count from the one base again.

        Of the triples of angles that mean the same rotation each frame takes the nearest to the frame before, the
        first the nearest to ``near`` (3,) [rad]: the root's angles of the pose before, or of the pose it came from.
        """
        pose = rooted.pose.copy()
        if not self.folds:
            return pose
        angles = self._left_angles(rooted)
        other = angles * (1, -1, 1) + np.pi  # Rx + pi, pi - Ry, Rz + pi is the same rotation
        last = np.asarray(near, float)
        for frame, triples in enumerate(np.stack([angles, other], axis=1)):
            nearest = triples - 2 * np.pi * np.round((triples - last) / (2 * np.pi))
            last = pose[frame, ROOT_ANGLES] = nearest[np.argmin(((nearest - last) ** 2).sum(axis=1))]
        return pose

    def leaving(self, rooted: RootedPoses) -> np.ndarray:
        """(frame, dof, dof) derivative of the searched coordinates as they leave by the rooted ones.

        It is the identity but for the root's angles, which grow without bounds where their middle one nears a quarter
        turn.
        """
        derivative = np.tile(np.eye(len(self.searched)), (len(rooted), 1, 1))
        if not self.folds:
            return derivative
        angles = self._left_angles(rooted)
        (sin_x, sin_y, _), (cos_x, cos_y, _) = np.sin(angles).T, np.cos(angles).T
        away = np.copysign(np.maximum(np.abs(cos_y), 1e-6), cos_y)
        zero, one = np.zeros_like(sin_x), np.ones_like(sin_x)
        by_z = np.stack([zero, sin_x / away, cos_x / away], axis=1)
        by_x = np.stack([one, zero, zero], axis=1) + sin_y[:, None] * by_z
        rows = by_x, np.stack([zero, cos_x, -sin_x], axis=1), by_z
        root = np.searchsorted(self.searched, ROOT_ANGLES.start)
        derivative[:, root : root + 3, root : root + 3] = np.stack(rows, axis=1)
        return derivative

    def _left_angles(self, rooted: RootedPoses) -> np.ndarray:
        """(frame, 3) the root's angles from the one base, between minus and plus half a turn."""
        turned = self._into_frame @ transposed(self.root_base) @ rooted.base @ self._frame
        rotation = turned @ zyx_rotation(rooted.pose[:, ROOT_ANGLES])
        # Angles of Rz @ Ry @ Rx, which give the rotation back at a quarter turn too.
        z = np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])
        rest = transposed(turn("z", z)) @ rotation  # Ry @ Rx, whose second row is (0, cos x, -sin x)
        x = np.arctan2(-rest[..., 1, 2], rest[..., 1, 1])
        y = np.arctan2(-rest[..., 2, 0], rest[..., 0, 0])
        return np.stack([x, y, z], axis=-1)
