"""What the contour tracker knows from frame to frame, and how it tells from that whether an answer is good enough."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from mmocap_warp.contour.frame.rooted import FrameArrays
from mmocap_warp.tracking.tracker import TrackState
from mmocap_warp.tracking.uncovered import is_usual

LEVEL_FRAMES = 20  # frames that the usual overlap is taken over
_LEAST_FRAMES = 4  # the usual overlap is known after so many frames
_LEVEL_SHARE = 0.3  # share of a look's uncovered area in its new level
_RAREST_LOOK = 4  # looks for a limb that was not found become so many times rarer at most


@dataclass(frozen=True, eq=False)
class Candidates(FrameArrays):
    """Poses and how well they explain the masks."""

    pose: np.ndarray  # (n, coordinate) float32
    iou: np.ndarray  # (n, camera), NaN for a lost view
    # (n,) outline deep outside of the masks [m], in the view where it is second longest: one view may be spoilt
    exposed: np.ndarray
    cost: np.ndarray  # (n,) float32
    overlap: np.ndarray  # (n,) mean of iou over the views that see anything: the better of two has the larger one
    own_overlap: np.ndarray  # (n,) the same without what is others', nor a view that shows another instead


@dataclass(frozen=True, eq=False, kw_only=True)
class ContourState(TrackState):
    """All that the contour tracker's next frame depends on."""

    previous_pose: np.ndarray  # (run, coordinate) float32, the poses before the last ones
    overlap_levels: np.ndarray  # (run, frame) float32, of the last frames that were not lost; 0 where there were fewer
    exposed_outlines: np.ndarray  # (run, frame) float32, of the same frames [m]
    lost_count: np.ndarray  # (run,) int32, how many frames in a row are lost
    frame_count: np.ndarray  # (run,) int32, how many frames there were
    # (run, part) float32, the mask area that the body leaves uncovered near each of its parts as long as nothing is in
    # doubt, such as that of a bag [m^2]; NaN until it was looked at
    uncovered_levels: np.ndarray
    last_excess: np.ndarray  # (run,) float32, how much more than that was uncovered at the last look [m^2]
    doubt: np.ndarray  # (run,) bool, whether that says that a limb is elsewhere
    failed_looks: np.ndarray  # (run,) int32, how many looks for a limb in a row found none
    look_count: np.ndarray  # (run,) int32, how many looks there were
    outstanding_count: np.ndarray  # (run,) int32, how many of them said that a limb is elsewhere
    climbed_in_vain: np.ndarray  # (run,) bool, whether the ladder of recovery was climbed in vain in the last frame

    @classmethod
    def at(cls, pose: np.ndarray, parts: int) -> Self:
        """Before the first frame, at poses (run, coordinate) of a body of so many parts."""
        runs, nothing = len(pose), np.zeros((len(pose), LEVEL_FRAMES), np.float32)
        counts, by_part = np.zeros(runs, np.int32), np.full((runs, parts), np.nan, np.float32)
        return cls(
            pose, counts, previous_pose=pose, overlap_levels=nothing, exposed_outlines=nothing, lost_count=counts,
            frame_count=counts, uncovered_levels=by_part, last_excess=np.zeros(runs, np.float32),
            doubt=np.zeros(runs, bool), failed_looks=counts, look_count=counts, outstanding_count=counts,
            climbed_in_vain=np.zeros(runs, bool),
        )  # fmt: skip

    def is_looking(self, interval: int) -> np.ndarray:
        """(run,) bool: whether the next frame is looked at for limbs; after looks that failed it is less often."""
        return np.asarray(self.frame_count % (interval * np.minimum(1 + self.failed_looks, _RAREST_LOOK)) == 0)

    def excess(self, area: np.ndarray, largest_usual: float) -> np.ndarray:
        """(run, part) by how much more than usual is uncovered, or than may be usual [m^2]."""
        usual = np.fmin(np.nan_to_num(self.uncovered_levels, nan=np.inf), largest_usual)
        return np.asarray(np.maximum(area - usual, 0.0))

    def looked_at(self, looked: np.ndarray, area: np.ndarray, excess: np.ndarray, astray: np.ndarray) -> Self:
        """The state after a look at runs ``looked`` (run,) bool.

        What was uncovered near each part, ``area`` (run, part) [m^2], exceeds the usual by ``excess``, likewise;
        ``astray`` (run,) says whether a limb is elsewhere, unless nearly all looks do.
        """
        count, outstanding = self.look_count + looked, self.outstanding_count + (looked & astray)
        doubt = astray & ~is_usual(outstanding, count)
        usual = np.where(np.isnan(self.uncovered_levels), area, self.uncovered_levels)
        usual = np.where((looked & ~doubt)[:, None], usual + _LEVEL_SHARE * (area - usual), self.uncovered_levels)
        failed = np.where(astray, self.failed_looks + 1, 0)
        return replace(
            self,
            uncovered_levels=usual.astype(np.float32),
            last_excess=np.where(looked, excess.sum(axis=1), self.last_excess).astype(np.float32),
            doubt=np.where(looked, doubt, self.doubt),
            failed_looks=np.where(looked, failed, self.failed_looks).astype(np.int32),
            look_count=count.astype(np.int32),
            outstanding_count=outstanding.astype(np.int32),
        )

    @cached_property
    def level_known(self) -> np.ndarray:
        """(run,) bool: whether there were frames enough to know the usual overlap."""
        return np.asarray((self.overlap_levels > 0).sum(axis=1) >= _LEAST_FRAMES)

    def settled(self) -> Self:
        """The state as if the last frame had come often enough for its overlap to be the usual one."""
        overlaps, outlines = self.overlap_levels.copy(), self.exposed_outlines.copy()
        overlaps[:, -_LEAST_FRAMES:], outlines[:, -_LEAST_FRAMES:] = overlaps[:, -1:], outlines[:, -1:]
        return replace(self, overlap_levels=overlaps, exposed_outlines=outlines)

    @cached_property
    def _usual_overlap(self) -> np.ndarray:
        """(run,) float32 median of the remembered overlaps, of all runs at once; infinite where none is remembered."""
        levels = self.overlap_levels
        ordered = np.sort(np.where(levels > 0, levels, np.float32(np.inf)), axis=1)
        count = (levels > 0).sum(axis=1)
        run = np.arange(len(levels))
        lower = ordered[run, np.maximum(count - 1, 0) // 2]
        upper = ordered[run, np.minimum(count // 2, LEVEL_FRAMES - 1)]
        return np.asarray((lower + upper) / np.float32(2))

    def falls_short(self, answer: Candidates, fall: float, exposed: float) -> np.ndarray:
        """(run,) bool: whether an answer overlaps less than usual, or has limbs where nobody is seen.

        Until the usual overlap is known every answer falls short. The overlap may be ``fall`` below it; ``exposed`` is
        an outline of such limbs that is too long [m]. What every remembered frame has of it comes on top: a wrong
        calibration exposes the whole body in all frames.
        """
        level = np.where(self.level_known, self._usual_overlap, np.float32(np.inf))
        always = np.where(self.overlap_levels > 0, self.exposed_outlines, np.float32(np.inf)).min(axis=1)
        always = np.where(self.level_known, always, np.float32(0.0))
        return np.asarray((answer.overlap < level - fall) | (answer.exposed > exposed + always))

    def followed_by(self, answer: Candidates, lost: np.ndarray) -> Self:
        """The state after a frame's answer, where ``lost`` (run,) bool says which runs are lost.

        A lost frame's pose is a guess: no motion is taken from it. Neither it nor a frame with a limb in doubt teaches
        anything about the usual overlap. But if frames stay lost for very long, what is seen has changed for good, and
        they count again.
        """
        changed_for_good = self.lost_count >= 2 * LEVEL_FRAMES
        not_counted = (self.doubt | (lost & ~changed_for_good))[:, None]
        overlaps = np.concatenate([self.overlap_levels[:, 1:], answer.overlap[:, None]], axis=1).astype(np.float32)
        outlines = np.concatenate([self.exposed_outlines[:, 1:], answer.exposed[:, None]], axis=1).astype(np.float32)
        return replace(
            self,
            pose=answer.pose.copy(),
            previous_pose=np.where(lost[:, None], answer.pose, self.pose),
            overlap_levels=np.where(not_counted, self.overlap_levels, overlaps),
            exposed_outlines=np.where(not_counted, self.exposed_outlines, outlines),
            lost_count=np.where(lost, self.lost_count + 1, 0).astype(np.int32),
            frame_count=self.frame_count + np.int32(1),
        )
