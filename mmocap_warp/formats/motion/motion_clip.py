"""A motion clip: a skeleton of any make that moves, as the readers of ``.bvh`` and ``.amc`` files give it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class MotionClip:
    """A skeleton in motion, in its file's own axes and unit of length.

    Attributes:
        fps: frames per second.
        joint_names: one per joint, as in the file; a joint stands where its bone begins.
        rest: (joint, 3), places in the rest pose.
        place: (frame, joint, 3).
        rotation: (frame, joint, 3, 3), of each bone in the world, the identity in the rest pose.
        marker_names: of markers that were seen on the actor; may be empty.
        markers: (frame, marker, 3), NaN where one was unseen; None where there are none.
    """

    fps: float
    joint_names: tuple[str, ...]
    rest: np.ndarray
    place: np.ndarray
    rotation: np.ndarray
    marker_names: tuple[str, ...] = ()
    markers: np.ndarray | None = None

    def at_rate(self, fps: float) -> MotionClip:
        """The clip resampled: places linearly, rotations by the rotation nearest to the mean of their neighbours'."""
        last = len(self.place) - 1
        when = np.arange(int(last * fps / self.fps) + 1) * self.fps / fps
        before = np.minimum(when.astype(int), max(last - 1, 0))
        after = np.minimum(before + 1, last)
        share = (when - before)[:, None, None]
        place = (1 - share) * self.place[before] + share * self.place[after]
        markers = None if self.markers is None else (1 - share) * self.markers[before] + share * self.markers[after]
        share = share[..., None]
        mixed = (1 - share) * self.rotation[before] + share * self.rotation[after]
        u, _, vt = np.linalg.svd(mixed)
        return replace(self, fps=fps, place=place, rotation=u @ vt, markers=markers)
