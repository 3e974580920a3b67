"""Tracking by contours: the search finds the basin, the contour fit its bottom.

A frame is fitted from the last pose and from where its motion would lead. Where that overlaps the masks as well as the
frames before did, and no limb is where nobody is seen, it is the answer. Where not, each of these is tried until one
is good, and the best is kept:

1. a short search from the last pose, then contours;
2. contours from many poses around the best so far, each with one part of the body thrown about: what finds an arm that
   a search of five times the budget does not;
3. after some frames in a row that stayed bad: contours from poses where the masks meet, heading anywhere; of a body
   that does not stand, turned any way, and of one on a base that stands still, bent any way.

A view that was taken a fraction of a frame off the others sees, for the contours, the body on its way from the last
pose. The search and the overlaps that judge do without that.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.body.rotations import spread_rotations, transposed, zyx_angles, zyx_rotation
from mmocap_warp.body.shape_space import heading_rotation, upright_base
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.device.replays import Replays
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.device.transfers import Download
from mmocap_warp.masks.observation import Observation
from mmocap_warp.masks.visual_hull import visual_hull
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.tracking.algorithms import ALGORITHMS, CONTOUR_TRACKERS
from mmocap_warp.tracking.from_settings import make_fitter, make_objective, search_limits
from mmocap_warp.tracking.pose_search import PoseSearch, RootFrame
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import lost_frame, overlap

_STEPS = 5
_LONG = 10  # steps of a start that is further away
_STARTS = 2  # the last pose, and where its motion leads
_DAMPED = 0.8  # of the last motion is taken to go on
_SCATTER = 40  # poses
_THROW = 0.35  # [rad] by which they are thrown about
_HEADINGS = 16
_STARTS_ANYHOW = 20  # turns of a body that lies anyhow
_VOXEL = 0.04  # [m]
_MEMORY = 20  # frames that the running level is taken over
_FEWEST = 4  # of these a level needs
_FALL = 0.012  # of overlap below the level calls for more
_EXPOSED = 0.12  # [m] of outline where nobody is, likewise: beyond what the last frames all have of it
_LOST_FALL, _LOST_EXPOSED = 0.06, 0.5  # beyond these there is no answer
_PATIENCE = 3  # lost frames before the body is looked for anew
_BETTER = 0.001  # of overlap by which a later answer must win


@dataclass(frozen=True, eq=False)
class _Found:
    """Poses and how well they explain the masks.

    Attributes:
        pose: (n, coordinate) float32.
        iou: (n, camera), NaN for a lost view.
        exposed: (n,) outline deep outside of the masks, in the view where it is second longest [m]: one view may be
            spoilt.
        cost: (n,) float32.
    """

    pose: np.ndarray
    iou: np.ndarray
    exposed: np.ndarray
    cost: np.ndarray

    @property
    def overlap(self) -> np.ndarray:
        """(n,) mean over the views that see anything: what the better one is chosen by."""
        mean: np.ndarray = np.nanmean(self.iou, axis=1)
        return mean

    def __getitem__(self, index: np.ndarray) -> _Found:
        return _Found(self.pose[index], self.iou[index], self.exposed[index], self.cost[index])

    def or_better(self, other: _Found, better: np.ndarray) -> _Found:
        """Others where they are ``better`` (n,) bool."""
        return _Found(
            np.where(better[:, None], other.pose, self.pose),
            np.where(better[:, None], other.iou, self.iou),
            np.where(better, other.exposed, self.exposed),
            np.where(better, other.cost, self.cost),
        )


class ContourTracker:
    """Tracks a subject frame by frame by contours; keeps what the next frame depends on.

    Args:
        subject: where to start.
        rig: undistorted cameras at the masks' size.
        config: settings; its algorithm is one of ``CONTOUR_TRACKERS``, or one of the paper's to be polished.
        fps: frame rate of the recording, for the preset's radii, and for views that are late; negative where frames are
            tracked from the last to the first.
        runs: instead of the configuration's. With 0 it can track nothing, but its arrays have the shapes of a run's.

    Attributes:
        device: the Warp device.
        search: what finds starts for the contours; None where there is no search.
        starts: poses of a run that are fitted at a time.

    Raises:
        ValueError: the body has no model with so many degrees of freedom, or its tracking mesh is not closed.
    """

    def __init__(
        self, subject: Subject, rig: CameraRig, config: TrackConfig, fps: float, runs: int | None = None
    ) -> None:
        self.config = config
        self._subject, self._rig = subject, rig
        self._rate = fps
        self._runs = runs = config.runs if runs is None else runs
        self.device = resolve_device(config.device)
        searched_by = config.algorithm if config.polish else CONTOUR_TRACKERS[config.algorithm]
        self.search = (
            None
            if searched_by is None
            else PoseSearch(
                subject,
                rig,
                config,
                algorithm=ALGORITHMS[searched_by],
                evaluations=config.budget,
                radii=config.radii(abs(fps)),
                runs=runs,
            )
        )
        self._limits = search_limits(subject, config)
        skeleton = subject.body.skeleton
        by_part = skeleton.searched_by_part(config.dof).values()
        self._parts = [index[index >= ROOT_ANGLES.stop] for index in by_part if (index >= ROOT_ANGLES.stop).any()]
        self.starts = starts = _SCATTER if config.algorithm == "search-contour" else _STARTS
        self._fitter = make_fitter(subject, rig, config, starts * runs)
        self._judge = make_objective(subject, rig, config, starts * runs)
        self._root_frame = RootFrame(subject, self._limits, starts * runs, self.device)
        descent, judge = self._fitter.descent, self._judge
        self._answers = Download([descent.best, descent.tally, judge.cost, judge.count])
        self._replays = Replays(self.device)
        self._pose = np.repeat(subject.pose[None].astype(np.float32), runs, axis=0)
        self._before = self._pose.copy()
        self._level = np.zeros((runs, _MEMORY), np.float32)
        self._outside = np.zeros((runs, _MEMORY), np.float32)
        self._lost = np.zeros((runs, 1), np.float32)

    @property
    def state(self) -> tuple[np.ndarray, ...]:
        """All that the next frame depends on.

        Last poses (run, coordinate) float32 and random counters (run,) int32; the poses before, the overlaps that the
        running level is taken over (run, frame), zero before there were any, and how many frames in a row are lost
        (run, 1), float32, and the exposed outlines of those frames (run, frame); then what the search remembers.
        """
        search = self.search
        counter = search.counter.numpy() if search else np.zeros(self._runs, np.int32)
        memory = [each.numpy() for each in search.memory] if search else []
        carried = self._pose, counter, self._before, self._level, self._lost, self._outside
        return tuple(array.copy() for array in (*carried, *memory))

    @state.setter
    def state(self, value: tuple[np.ndarray, ...]) -> None:
        pose, counter, *memory = value
        self._pose = pose.copy()
        kept = memory or (pose, *(np.zeros_like(each) for each in (self._level, self._lost, self._outside)))
        self._before, self._level, self._lost, self._outside = (each.copy() for each in kept[:4])
        if self.search:
            self.search.counter.assign(counter)
            for array, values in zip(self.search.memory, kept[4:], strict=False):
                array.assign(values)

    def step(self, observation: Observation) -> FrameAnswer:
        """Find the pose of the next frame. Without any foreground the frame is lost and the pose is carried over."""
        if not observation.foreground.any():
            return lost_frame(self._pose.copy(), observation)
        started = time.perf_counter()
        self._fitter.observe(0, observation)
        self._judge.observe(observation)
        if self.search and self.config.polish:
            starts = self._search_starts(self.search, np.ones(self._runs, bool), observation)
            found = self._best_fit(starts, observation, _LONG)
            evaluations, rescued = self.search.evaluations, np.zeros(self._runs, bool)
        else:
            found, evaluations, rescued = self._follow(observation)
        lost = self._level_known & self._falls_short(found, _LOST_FALL, _LOST_EXPOSED)
        ordinary = STATUS.index("tracked" if observation.foreground.all() else "partial")
        status = np.where(rescued, STATUS.index("rescued"), ordinary)
        status = np.where(lost, STATUS.index("lost"), status)
        self._carry(found, lost)
        seconds = time.perf_counter() - started
        return FrameAnswer(found.pose, found.cost, found.iou, evaluations, status, seconds)

    def _follow(self, observation: Observation) -> tuple[_Found, int, np.ndarray]:
        """What is found from the last poses, the evaluations spent, and which runs (run,) needed more than a search."""
        predicted = self._pose + np.float32(_DAMPED) * (self._pose - self._before)
        found = self._best_fit(np.stack([self._pose, self._within(predicted)], axis=1), observation, _STEPS)
        evaluations, rescued = 0, np.zeros(self._runs, bool)
        search = self.search
        if search is None:
            return found, evaluations, rescued
        wanted = self._falls_short(found)
        if wanted.any():
            evaluations = search.evaluations
            found, _ = self._improved(found, wanted, self._search_starts(search, wanted, observation), observation)
        wanted = self._falls_short(found)
        if wanted.any():
            before = found.overlap
            found, better = self._improved(found, wanted, self._scattered(search, found.pose), observation)
            rescued = better & self._level_known & (found.overlap > before + _FALL)
        wanted = self._falls_short(found) & (self._lost[:, 0] >= _PATIENCE)
        if wanted.any():
            found, anew = self._improved(found, wanted, self._anew(search, observation), observation)
            found, more = self._improved(found, anew, self._scattered(search, found.pose), observation)
            rescued = rescued | anew | more
        return found, evaluations, rescued

    def _carry(self, found: _Found, lost: np.ndarray) -> None:
        """Keep what the next frame starts from. A lost frame's pose is a guess; the motion before it goes nowhere."""
        self._before, self._pose = np.where(lost[:, None], found.pose, self._pose), found.pose.copy()
        level = np.concatenate([self._level[:, 1:], found.overlap[:, None]], axis=1).astype(np.float32)
        outside = np.concatenate([self._outside[:, 1:], found.exposed[:, None]], axis=1).astype(np.float32)
        forever = self._lost[:, 0] >= 2 * _MEMORY  # what is seen has changed for good
        passed_over = (lost & ~forever)[:, None]
        self._level = np.where(passed_over, self._level, level)
        self._outside = np.where(passed_over, self._outside, outside)
        self._lost = np.where(lost[:, None], self._lost + 1, 0).astype(np.float32)

    @property
    def _level_known(self) -> np.ndarray:
        """(run,) bool: whether there were frames enough for a level."""
        known: np.ndarray = (self._level > 0).sum(axis=1) >= _FEWEST
        return known

    @property
    def _median_level(self) -> np.ndarray:
        """(run,) float32 median of the overlaps that there are; infinite where there are none."""
        ordered = np.sort(np.where(self._level > 0, self._level, np.float32(np.inf)), axis=1)
        count = (self._level > 0).sum(axis=1)
        run = np.arange(self._runs)
        lower, upper = ordered[run, np.maximum(count - 1, 0) // 2], ordered[run, np.minimum(count // 2, _MEMORY - 1)]
        median: np.ndarray = (lower + upper) / np.float32(2)
        return median

    def _falls_short(self, found: _Found, fall: float = _FALL, exposed: float = _EXPOSED) -> np.ndarray:
        """(run,) bool: overlap below the running level, or limbs where nobody is; without a level all fall short.

        Args:
            found: a pose for each run.
            fall: how far below.
            exposed: outline of such limbs that is too long for a person [m]. What every frame remembered has of it
                comes on top: a wrong calibration exposes the whole body, always.
        """
        level = np.where(self._level_known, self._median_level, np.float32(np.inf))
        always = np.where(self._level > 0, self._outside, np.float32(np.inf)).min(axis=1)
        always = np.where(self._level_known, always, np.float32(0.0))
        exposed *= self._subject.body.relative_size
        short: np.ndarray = (found.overlap < level - fall) | (found.exposed > exposed + always)
        return short

    def _improved(
        self, found: _Found, wanted: np.ndarray, starts: np.ndarray, observation: Observation
    ) -> tuple[_Found, np.ndarray]:
        """Fit starts (run, start, coordinate), and take the best in runs (run,) that want it if it is better: which."""
        other = self._best_fit(starts, observation, _LONG)
        better = wanted & (other.overlap > found.overlap + _BETTER)
        return found.or_better(other, better), better

    def _search_starts(self, search: PoseSearch, wanted: np.ndarray, observation: Observation) -> np.ndarray:
        """What searches from the last poses find, (run, 1, coordinate).

        Runs (run,) that want nothing keep their random numbers, so that each is as it would be alone.
        """
        search.observe(observation)
        counter = search.counter.numpy().copy()
        search.best_pose.assign(self._pose)
        search.run()
        search.counter.assign(np.where(wanted, search.counter.numpy(), counter).astype(np.int32))
        starts: np.ndarray = search.best_pose.numpy()[:, None].copy()
        return starts

    def _scattered(self, search: PoseSearch, pose: np.ndarray) -> np.ndarray:
        """Poses (run, start, coordinate) around some (run, coordinate), each with one part of the body thrown about."""
        starts = np.repeat(pose[:, None], _SCATTER, axis=1)
        counter = search.counter.numpy()
        for run, of_run in enumerate(starts):
            rng = np.random.default_rng([self.config.seed + run, int(counter[run])])
            for number, start in enumerate(of_run):
                index = self._parts[number % len(self._parts)]
                start[index] += rng.normal(0.0, _THROW, len(index))
        return self._within(starts)

    def _anew(self, search: PoseSearch, observation: Observation) -> np.ndarray:
        """Last poses and the first one (run, start, coordinate) where the masks meet, turned any way.

        A body that stands is turned about the vertical. One whose base stands still bends any way.
        """
        skeleton = self._subject.body.skeleton
        if skeleton.root_is_fixed:
            return self._bent_anyhow(search)
        hull = visual_hull(self._rig, observation, spacing=_VOXEL * self._subject.body.relative_size, tolerate=1)
        up = upright_base(self._rig.up)
        frame, home = skeleton.frame[0].astype(float), self._subject.root_base
        first = np.repeat(self._subject.pose[None], self._runs, axis=0)
        if skeleton.stands:
            headings = 2 * np.pi * np.arange(_HEADINGS) / _HEADINGS
            turns = [up @ heading_rotation(heading) @ transposed(up) for heading in headings]
        else:
            turns = list(spread_rotations(_STARTS_ANYHOW))
        starts = []
        for pose in (self._pose.astype(float), first):
            for turn in turns:
                turned = turn @ home @ frame @ zyx_rotation(pose[:, ROOT_ANGLES])
                start = pose.copy()
                start[:, ROOT_ANGLES] = zyx_angles(frame.T @ home.T @ turned)
                if len(hull):
                    start[:, :3] = np.median(hull, axis=0)
                starts.append(start)
        return self._within(np.stack(starts, axis=1))

    def _bent_anyhow(self, search: PoseSearch) -> np.ndarray:
        """Poses (run, start, coordinate) of which all angles are drawn anew, within their limits."""
        low, high = np.clip(self._limits, -np.pi, np.pi).T
        bent = np.concatenate(self._parts)
        starts = np.repeat(self._pose[:, None], _SCATTER, axis=1)
        counter = search.counter.numpy()
        for run, of_run in enumerate(starts):
            rng = np.random.default_rng([self.config.seed + run, int(counter[run])])
            of_run[:, bent] = rng.uniform(low[bent], high[bent], (_SCATTER, len(bent)))
        return starts

    def _within(self, pose: np.ndarray) -> np.ndarray:
        """Poses as float32, within their limits."""
        within: np.ndarray = np.clip(pose, self._limits[:, 0], self._limits[:, 1]).astype(np.float32)
        return within

    def _best_fit(self, starts: np.ndarray, observation: Observation, steps: int) -> _Found:
        """Fit starts (run, start, coordinate) by their contours: each run's best."""
        runs, count, coordinates = starts.shape
        fitter, total = self._fitter, runs * count
        home = np.repeat(self._subject.root_base[None], total, axis=0)
        if fitter.late:
            fitter.follow(np.repeat(self._pose, count, axis=0), home, self._rate)
        fitter.start_at(starts.reshape(total, coordinates), home, np.zeros(total, int))
        kind = (total, steps, fitter.fields.value.ptr, fitter.follows)
        self._replays.run(kind, lambda: self._launch_fit(total, steps))
        pose, tally, cost, pixels = self._answers.read(total)
        exposed = np.sort(tally[:, :, 3], axis=1)[:, -2:].min(axis=1)
        found = _Found(pose, overlap(pixels, observation), exposed, cost)
        best = np.argmax(found.overlap.reshape(runs, count), axis=1)
        return found[best + count * np.arange(runs)]

    def _launch_fit(self, total: int, steps: int) -> None:
        """Fit the first poses, judge them, and have the answers on their way to the host."""
        fitter, judge = self._fitter, self._judge
        self._root_frame.enter(fitter.descent.pose, fitter.body.root_base)
        fitter.descend(total, steps)
        self._root_frame.leave(fitter.descent.best, fitter.body.root_base)
        wp.copy(judge.pose, fitter.descent.best, count=judge.pose.shape[1] * total)
        judge.evaluate(total)
        self._answers.fetch(total)
