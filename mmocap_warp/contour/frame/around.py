"""The poses around some frames, from which the skin's motion is known to views that were taken at another time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.contour.frame.rooted import RootedPoses


@dataclass(frozen=True, eq=False)
class Around:
    """What comes before and after each of some poses.

    Attributes:
        before, after: the poses; anything where there is none.
        sides: (pose,) int32, 1 for the pose before plus 2 for that after.
        rate: poses a second.
        curved: whether the motion is a parabola through all three, or a straight line.
    """

    before: RootedPoses
    after: RootedPoses
    sides: np.ndarray
    rate: float
    curved: bool = True

    @classmethod
    def of(cls, course: RootedPoses, frames: np.ndarray, rate: float, *, curved: bool = True) -> Around:
        """Around frames by their numbers in a course of poses, ``rate`` a second."""
        last = len(course) - 1
        sides = ((frames > 0) + 2 * (frames < last)).astype(np.int32)
        return cls(course[np.maximum(frames - 1, 0)], course[np.minimum(frames + 1, last)], sides, rate, curved)

    def __getitem__(self, poses: slice | np.ndarray) -> Around:
        return replace(self, before=self.before[poses], after=self.after[poses], sides=self.sides[poses])
