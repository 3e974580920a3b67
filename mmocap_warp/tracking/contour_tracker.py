"""Tracking by contours: the search finds the basin, the contour fit its bottom.

A frame is fitted from the last pose and from where its motion would lead. Where that overlaps the masks as well as the
frames before did, it is the answer. Where not, a short search starts from the last pose and is fitted too; if even that
falls short, a wider search is; and after several frames in a row, the body is looked for anew. The better one is kept.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.contour.fitter import ContourFitter
from mmocap_warp.device import available_threads
from mmocap_warp.objective.objective import Objective
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.tracking.algorithms import ALGORITHMS, CONTOUR_TRACKERS
from mmocap_warp.tracking.config import TrackConfig
from mmocap_warp.tracking.pose_search import PoseSearch, RootFrame, search_limits
from mmocap_warp.tracking.tracker import lost_frame, overlap
from mmocap_warp.views.observation import Observation
from mmocap_warp.views.rig import CameraRig

STEPS = 5
_STARTS = 2  # the last pose, and where its motion leads
_DAMPED = 0.8  # of the last motion is taken to go on
_LONG = 10  # steps of a start that is further away
_SCATTER = 40
_THROW = 0.35
_MEMORY = 20  # frames that the running level is taken over
_FALL = 0.012  # of overlap below that level calls for a search
_BETTER = 0.001  # of overlap by which a later answer must win


class ContourTracker:
    """Tracks a subject frame by frame by contours, with or without a search; keeps what the next frame depends on.

    Args:
        subject: where to start.
        rig: undistorted cameras at the masks' size.
        config: settings; the algorithm is one of ``CONTOUR_TRACKERS``.
        fps: frame rate of the recording, for the preset's radii.
        runs: instead of the configuration's. With 0 it can track nothing, but its arrays have the shapes of a run's.

    Attributes:
        device: the Warp device.
        particles: the most candidates of a run at a time.

    Raises:
        ValueError: the body has no model with so many degrees of freedom, or its tracking mesh is not closed.
    """

    def __init__(
        self, subject: Subject, rig: CameraRig, config: TrackConfig, fps: float, runs: int | None = None
    ) -> None:
        self.config = config
        self._runs = runs = config.runs if runs is None else runs
        searches = CONTOUR_TRACKERS[config.algorithm]
        algorithm = ALGORITHMS[searches or "h-cmaes"]
        rotation, translation = config.radii(fps)

        def search(wide: float) -> PoseSearch:
            return PoseSearch(
                subject,
                rig,
                config,
                algorithm=algorithm,
                evaluations=max(1, round(wide * config.budget)),
                radii=(wide * rotation, wide * translation),
                runs=runs,
            )

        self._search = search(1.0)
        self.device, self.particles = self._search.device, self._search.particles
        self._searches = searches is not None
        self._parts = [
            index[index >= 6] for index in subject.body.skeleton.searched_by_part(config.dof).values() if (index >= 6).any()
        ]
        most = runs * (_SCATTER if searches else _STARTS)
        self._judge = Objective(
            subject.body,
            subject.root_base,
            rig,
            max(most, 1),
            cost=config.cost,
            renderer="raster",
            device=self.device,
            threads=config.threads or available_threads(),
        )
        self._limits = search_limits(subject, config)
        self._searched = subject.body.skeleton.searched(config.dof)
        self._fitter = ContourFitter(
            subject.body,
            rig,
            self._searched,
            self._limits,
            candidates=most,
            device=self.device,
            threads=config.threads or available_threads(),
        )
        self._root_frame = RootFrame(subject, self._limits, most, self.device)
        self._home = subject.root_base
        self._pose = np.repeat(subject.pose[None].astype(np.float32), runs, axis=0)
        self._before = self._pose.copy()
        self._level = np.zeros((runs, _MEMORY), np.float32)

    @property
    def candidate_arrays(self) -> list[wp.array[Any]]:
        """The arrays that have a row for every candidate; all others that depend on the runs have one for each run."""
        return self._search.objective.candidate_arrays

    @property
    def state(self) -> tuple[np.ndarray, ...]:
        """All that the next frame depends on.

        Last poses (run, coordinate) float32 and random counters (run,) int32; the poses before, and the overlaps that
        the running level is taken over (run, frame), zero before there were any, float32.
        """
        counter = self._search.counter.numpy().copy()
        return self._pose.copy(), counter, self._before.copy(), self._level.copy()

    @state.setter
    def state(self, value: tuple[np.ndarray, ...]) -> None:
        pose, counter, *memory = value
        self._pose = pose.copy()
        self._search.counter.assign(counter)
        self._before, self._level = (each.copy() for each in memory or (pose, np.zeros_like(self._level)))

    def step(self, observation: Observation) -> FrameAnswer:
        """Find the pose of the next frame. Without any foreground the frame is lost and the pose is carried over."""
        if not observation.foreground.any():
            return lost_frame(self._pose.copy(), observation)
        started = time.perf_counter()
        self._fitter.observe(0, observation)
        predicted = self._pose + _DAMPED * (self._pose - self._before)
        predicted = np.clip(predicted, self._limits[:, 0], self._limits[:, 1]).astype(np.float32)
        found = self._best_fit(np.stack([self._pose, predicted], axis=1), observation, STEPS)
        evaluations, rescued = 0, np.zeros(self._runs, bool)
        if self._searches:
            wanted = self._falls_short(found)
            if wanted.any():
                evaluations += self._search.evaluations
                found, _ = self._better(wanted, found, self._search_starts(wanted, observation), observation)
            wanted = self._falls_short(found)
            if wanted.any():
                found, rescued = self._better(wanted, found, self._scattered(found.pose), observation)
        self._before, self._pose = self._pose, found.pose
        self._level = np.concatenate([self._level[:, 1:], _mean(found.iou)[:, None]], axis=1).astype(np.float32)
        self.last=found; self.last_evals=evaluations
        seconds = time.perf_counter() - started
        ordinary = STATUS.index("tracked" if observation.foreground.all() else "partial")
        status = np.where(rescued, STATUS.index("rescued"), ordinary)
        return FrameAnswer(found.pose.copy(), self._cost(found.iou), found.iou, evaluations, status, seconds)

    def _cost(self, iou: np.ndarray) -> np.ndarray:
        return (1.0 - _mean(iou)).astype(np.float32)

    def _falls_short(self, found: _Found) -> np.ndarray:
        """(run,) bool: overlap below the running level, or where there is none yet, or limbs where nobody is."""
        known = (self._level > 0).sum(axis=1)
        level = np.array([np.median(row[row > 0]) if n else 1.0 for row, n in zip(self._level, known, strict=True)])
        short: np.ndarray = (known < _FEWEST) | (_mean(found.iou) < level - _FALL) | (found.exposed > _EXPOSED)
        return short

    def _search_starts(self, wanted: np.ndarray, observation: Observation) -> np.ndarray:
        """What searches from the last poses find, (run, 1, coordinate).

        Runs (run,) that want nothing keep their random numbers, so that each is as it would be alone.
        """
        search = self._search
        search.observe(observation)
        counter = search.counter.numpy().copy()
        search.best_pose.assign(self._pose)
        search.run()
        search.counter.assign(np.where(wanted, search.counter.numpy(), counter).astype(np.int32))
        starts: np.ndarray = search.best_pose.numpy()[:, None]
        return starts

    def _scattered(self, pose: np.ndarray) -> np.ndarray:
        """Poses (run, start, coordinate) around some (run, coordinate), each with one part of the body thrown about."""
        starts = np.repeat(pose[:, None], _SCATTER, axis=1)
        counter = self._search.counter.numpy()
        for run, of_run in enumerate(starts):
            rng = np.random.default_rng([self.config.seed + run, int(counter[run])])
            for number, start in enumerate(of_run):
                index = self._parts[number % len(self._parts)]
                start[index] += rng.normal(0.0, _THROW, len(index))
        return np.clip(starts, self._limits[:, 0], self._limits[:, 1]).astype(np.float32)

    def _better(
        self, wanted: np.ndarray, found: _Found, starts: np.ndarray, observation: Observation
    ) -> tuple[_Found, np.ndarray]:
        """Fit other starts, and keep them in the runs (run,) where they are wanted and better; and which these are."""
        other = self._best_fit(starts, observation, _LONG)
        better = wanted & (other.score > found.score + _BETTER)
        return _Found(
            np.where(better[:, None], other.pose, found.pose),
            np.where(better[:, None], other.iou, found.iou),
            np.where(better, other.exposed, found.exposed),
        ), better

    def _best_fit(self, starts: np.ndarray, observation: Observation, steps: int) -> _Found:
        """Fit starts (run, start, coordinate) by their contours: each run's best."""
        runs, count, coordinates = starts.shape
        fitter, total = self._fitter, runs * count
        flat = starts.reshape(total, coordinates)
        fitter.start_at(flat, np.repeat(self._home[None], total, axis=0), np.zeros(total, int))
        self._root_frame.enter(fitter.descent.pose, fitter.body.root_base)
        fitter.descend(total, steps)
        self._root_frame.leave(fitter.descent.best, fitter.body.root_base)
        fitted = fitter.descent.best.numpy()[:total].copy()
        objective = self._judge
        objective.observe(observation)
        wp.copy(objective.pose, fitter.descent.best, count=total * coordinates)
        objective.evaluate(total)
        iou = overlap(objective.count.numpy()[:total], observation)
        by_view = np.sort(fitter.descent.tally.numpy()[:total, :, 3], axis=1)
        exposed = by_view[:, -2] if by_view.shape[1] > 1 else by_view[:, -1]
        each = _Found(fitted, iou, exposed)
        best = np.argmax(each.score.reshape(runs, count), axis=1) + count * np.arange(runs)
        return _Found(fitted[best], iou[best], exposed[best])


@dataclass(frozen=True, eq=False)
class _Found:
    """Poses and how well they explain the masks.

    Attributes:
        pose: (n, coordinate) float32.
        iou: (n, camera).
        exposed: (n,) length of outline where nobody is, in the view where it is second longest [m].
    """

    pose: np.ndarray
    iou: np.ndarray
    exposed: np.ndarray

    @property
    def score(self) -> np.ndarray:
        """(n,) the higher the better."""
        return _mean(self.iou)


_EXPOSED = 0.12  # m
_FEWEST = 4  # frames that a level needs


def _mean(iou: np.ndarray) -> np.ndarray:
    """(run,) over the views that see anything."""
    mean: np.ndarray = np.nanmean(iou, axis=1)
    return mean
