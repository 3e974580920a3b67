"""A tracked person between frames: at any time, and how fast the pose changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.rotations import between, transposed
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of consecutive frames.

    Attributes:
        rooting: moves poses; it searches all of the root's angles.
        rooted: the poses.
        fps: of the frames.
    """

    rooting: Rooting
    rooted: RootedPoses
    fps: float

    def at(self, frame: np.ndarray) -> RootedPoses:
        """The poses at frames (n,) and between them, by whole numbers and fractions; the ends stand still."""
        last = len(self.rooted) - 1
        at = np.clip(frame, 0, last)
        before = np.clip(np.floor(at).astype(int), 0, max(last - 1, 0))
        after = np.minimum(before + 1, last)
        share = at - before
        one, other = self.rooted[before], self.rooted[after]
        return RootedPoses(between(one.base, other.base, share), one.pose + share[:, None] * (other.pose - one.pose))

    def velocity(self, frames: np.ndarray) -> np.ndarray:
        """(n, dof) how fast the searched coordinates change in frames (n,), by whole numbers [m/s, rad/s]."""
        from scipy.spatial.transform import Rotation

        last = len(self.rooted) - 1
        before, after = self.rooted[np.maximum(frames - 1, 0)], self.rooted[np.minimum(frames + 1, last)]
        seconds = np.maximum(np.minimum(frames + 1, last) - np.maximum(frames - 1, 0), 1)[:, None] / self.fps
        velocity: np.ndarray = (after.pose - before.pose)[:, self.rooting.searched] / seconds
        turned = Rotation.from_matrix(after.base @ transposed(before.base)).as_rotvec() / seconds
        root = np.searchsorted(self.rooting.searched, ROOT_ANGLES.start)
        axes = self.rooting.root_axes(self.rooted[frames])
        velocity[:, root : root + 3] += np.linalg.solve(axes, turned[..., None])[..., 0]
        return velocity
