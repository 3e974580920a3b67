"""What the contour tracker knows from frame to frame, and how it tells from that whether an answer is good enough."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.contour.frame.rooted import FrameArrays
from mmocap_warp.tracking.tracker import TrackState

LEVEL_FRAMES = 20
"""Frames that the usual overlap is taken over."""
_LEAST_FRAMES = 4  # the usual overlap is known after so many frames


@dataclass(frozen=True, eq=False)
class Candidates(FrameArrays):
    """Poses and how well they explain the masks.

    Attributes:
        pose: (n, coordinate) float32.
        iou: (n, camera), NaN for a lost view.
        exposed: (n,) outline deep outside of the masks [m], in the view where it is second longest: one view may be
            spoilt.
        cost: (n,) float32.
    """

    pose: np.ndarray
    iou: np.ndarray
    exposed: np.ndarray
    cost: np.ndarray

    @property
    def overlap(self) -> np.ndarray:
        """(n,) mean over the views that see anything: the better of two candidates has the larger one."""
        mean: np.ndarray = np.nanmean(self.iou, axis=1)
        return mean


@dataclass(frozen=True, eq=False, kw_only=True)
class ContourState(TrackState):
    """All that the contour tracker's next frame depends on.

    Attributes:
        previous_pose: (run, coordinate) float32, the poses before the last ones.
        overlap_levels: (run, frame) float32, the overlaps of the last frames that were not lost; 0 where there were
            fewer.
        exposed_outlines: (run, frame) float32, the exposed outlines of the same frames [m].
        lost_count: (run,) int32, how many frames in a row are lost.
    """

    previous_pose: np.ndarray
    overlap_levels: np.ndarray
    exposed_outlines: np.ndarray
    lost_count: np.ndarray

    @classmethod
    def at(cls, pose: np.ndarray) -> ContourState:
        """Before the first frame, at poses (run, coordinate)."""
        runs, nothing = len(pose), np.zeros((len(pose), LEVEL_FRAMES), np.float32)
        counts = np.zeros(runs, np.int32)
        return cls(
            pose, counts, previous_pose=pose, overlap_levels=nothing, exposed_outlines=nothing, lost_count=counts
        )

    @property
    def level_known(self) -> np.ndarray:
        """(run,) bool: whether there were frames enough to know the usual overlap."""
        known: np.ndarray = (self.overlap_levels > 0).sum(axis=1) >= _LEAST_FRAMES
        return known

    @property
    def _usual_overlap(self) -> np.ndarray:
        """(run,) float32 median of the remembered overlaps, of all runs at once; infinite where none is remembered."""
        levels = self.overlap_levels
        ordered = np.sort(np.where(levels > 0, levels, np.float32(np.inf)), axis=1)
        count = (levels > 0).sum(axis=1)
        run = np.arange(len(levels))
        lower = ordered[run, np.maximum(count - 1, 0) // 2]
        upper = ordered[run, np.minimum(count // 2, LEVEL_FRAMES - 1)]
        median: np.ndarray = (lower + upper) / np.float32(2)
        return median

    def falls_short(self, answer: Candidates, fall: float, exposed: float) -> np.ndarray:
        """(run,) bool: whether an answer overlaps less than usual, or has limbs where nobody is seen.

        Until the usual overlap is known every answer falls short.

        Args:
            answer: a pose for each run.
            fall: how far the overlap may be below the usual one.
            exposed: outline of such limbs that is too long [m]. What every remembered frame has of it comes on top: a
                wrong calibration exposes the whole body in all frames.
        """
        level = np.where(self.level_known, self._usual_overlap, np.float32(np.inf))
        always = np.where(self.overlap_levels > 0, self.exposed_outlines, np.float32(np.inf)).min(axis=1)
        always = np.where(self.level_known, always, np.float32(0.0))
        short: np.ndarray = (answer.overlap < level - fall) | (answer.exposed > exposed + always)
        return short

    def followed_by(self, answer: Candidates, lost: np.ndarray) -> ContourState:
        """The state after a frame's answer, where ``lost`` (run,) bool says which runs are lost.

        A lost frame's pose is a guess: no motion is taken from it, and it teaches nothing about the usual overlap. But
        if frames stay lost for very long, what is seen has changed for good, and they count again.
        """
        changed_for_good = self.lost_count >= 2 * LEVEL_FRAMES
        not_counted = (lost & ~changed_for_good)[:, None]
        overlaps = np.concatenate([self.overlap_levels[:, 1:], answer.overlap[:, None]], axis=1).astype(np.float32)
        outlines = np.concatenate([self.exposed_outlines[:, 1:], answer.exposed[:, None]], axis=1).astype(np.float32)
        return replace(
            self,
            pose=answer.pose.copy(),
            previous_pose=np.where(lost[:, None], answer.pose, self.pose),
            overlap_levels=np.where(not_counted, self.overlap_levels, overlaps),
            exposed_outlines=np.where(not_counted, self.exposed_outlines, outlines),
            lost_count=np.where(lost, self.lost_count + 1, 0).astype(np.int32),
        )
