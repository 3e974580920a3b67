"""The person before the cameras: the frames that show them, the pose at any time, and how fast the pose changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.rotations import between, transposed
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting
from mmocap_warp.masks.observation import Observation

MIN_FRAMES = 4
"""Frames that cameras are solved from, and frames that judge them, at least."""


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
        """The poses at frames (n,), which may be fractions; beyond the clip's ends the person stands still."""
        last = len(self.rooted) - 1
        at = np.clip(frame, 0, last)
        before = np.clip(np.floor(at).astype(int), 0, max(last - 1, 0))
        after = np.minimum(before + 1, last)
        share = at - before
        one, other = self.rooted[before], self.rooted[after]
        return RootedPoses(between(one.base, other.base, share), one.pose + share[:, None] * (other.pose - one.pose))

    def velocity(self, frames: np.ndarray) -> np.ndarray:
        """(n, dof) how fast the searched coordinates change in whole frames (n,) [m/s, rad/s]."""
        from scipy.spatial.transform import Rotation

        # Central differences of the pose.
        last = len(self.rooted) - 1
        before, after = self.rooted[np.maximum(frames - 1, 0)], self.rooted[np.minimum(frames + 1, last)]
        seconds = np.maximum(np.minimum(frames + 1, last) - np.maximum(frames - 1, 0), 1)[:, None] / self.fps
        velocity: np.ndarray = (after.pose - before.pose)[:, self.rooting.searched] / seconds
        # The root's base turns too, which counts as a change of the root's angles.
        turned = Rotation.from_matrix(after.base @ transposed(before.base)).as_rotvec() / seconds
        root = np.searchsorted(self.rooting.searched, ROOT_ANGLES.start)
        axes = self.rooting.root_axes(self.rooted[frames])
        velocity[:, root : root + 3] += np.linalg.solve(axes, turned[..., None])[..., 0]
        return velocity


@dataclass(frozen=True, eq=False)
class Person:
    """The person as tracked by cameras.

    Attributes:
        subject: the body, with the pose of the first frame.
        observations: the frames' masks, each camera's shifted by whole frames.
        motion: the poses.
        found: (frame,) int, the frames in which the person was found.
    """

    subject: Subject
    observations: list[Observation]
    motion: Motion
    found: np.ndarray

    def spread(self, count: int) -> np.ndarray:
        """At most ``count`` frames that show the person, evenly spread, with the first and the last.

        Where there are few, enough are left out to judge by.
        """
        at = np.linspace(0, len(self.found) - 1, min(count, len(self.found) - MIN_FRAMES))
        frames: np.ndarray = self.found[at.round().astype(int)]
        return frames

    def between(self, count: int, taken: np.ndarray) -> np.ndarray:
        """At most ``count`` frames other than those ``taken``, evenly spread, none at the ends."""
        others = np.setdiff1d(self.found, taken)
        at = (np.arange(min(count, len(others))) + 0.5) * len(others) / max(min(count, len(others)), 1)
        frames: np.ndarray = others[at.astype(int)]
        return frames
