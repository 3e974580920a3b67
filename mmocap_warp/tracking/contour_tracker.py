"""Tracking by contours: the search finds the basin, the contour fit its bottom.

A frame is fitted from the last pose and from where its motion would lead. Where that overlaps the masks as well as the
frames before did, it is the answer. Where not, a short search starts from the last pose and is fitted too; if even that
falls short, a wider search is; and after several frames in a row, the body is looked for anew. The better one is kept.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.contour.fitter import ContourFitter
from mmocap_warp.device import available_threads
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
_WIDE = 4.0  # the wide search, as a multiple of the short one's radii and budget
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
        self._wide_search = search(_WIDE) if searches else None
        self._searches = searches is not None
        self.device, self.particles = self._search.device, self._search.particles
        self._limits = search_limits(subject, config)
        self._searched = subject.body.skeleton.searched(config.dof)
        self._fitter = ContourFitter(
            subject.body,
            rig,
            self._searched,
            self._limits,
            candidates=_STARTS * runs,
            device=self.device,
            threads=config.threads or available_threads(),
        )
        self._root_frame = RootFrame(subject, self._limits, _STARTS * runs, self.device)
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
        self._search.observe(observation)
        predicted = self._pose + _DAMPED * (self._pose - self._before)
        predicted = np.clip(predicted, self._limits[:, 0], self._limits[:, 1]).astype(np.float32)
        pose, iou = self._best_fit(np.stack([self._pose, predicted], axis=1), observation)
        evaluations = 0
        if self._searches:
            short = self._falls_short(iou)
            if short.any():
                evaluations += self._search.evaluations
                pose, iou = self._improve(self._search, short, pose, iou, observation)
        self.searched = bool(evaluations)
        self._before, self._pose = self._pose, pose
        self._level = np.concatenate([self._level[:, 1:], _mean(iou)[:, None]], axis=1).astype(np.float32)
        seconds = time.perf_counter() - started
        status = STATUS.index("tracked" if observation.foreground.all() else "partial")
        return FrameAnswer(pose.copy(), self._cost(iou), iou, evaluations, status, seconds)

    def _cost(self, iou: np.ndarray) -> np.ndarray:
        return (1.0 - _mean(iou)).astype(np.float32)

    def _falls_short(self, iou: np.ndarray) -> np.ndarray:
        """(run,) bool: whether an overlap (run, camera) is below the running level, or there is none yet."""
        known = (self._level > 0).sum(axis=1)
        level = np.array([np.median(row[row > 0]) if n else 1.0 for row, n in zip(self._level, known, strict=True)])
        short: np.ndarray = (known < _FEWEST) | (_mean(iou) < level - _FALL)
        return short

    def _improve(
        self, search: PoseSearch, wanted: np.ndarray, pose: np.ndarray, iou: np.ndarray, observation: Observation
    ) -> tuple[np.ndarray, np.ndarray]:
        """Search from the last poses, fit what is found, and keep it in the runs (run,) where it is wanted and better.

        Runs that want nothing keep their random numbers, so that each is as it would be alone.
        """
        counter = search.counter.numpy().copy()
        search.best_pose.assign(self._pose)
        search.run()
        search.counter.assign(np.where(wanted, search.counter.numpy(), counter).astype(np.int32))
        found, found_iou = self._best_fit(search.best_pose.numpy()[:, None], observation)
        better = wanted & (_mean(found_iou) > _mean(iou) + _BETTER)
        return np.where(better[:, None], found, pose), np.where(better[:, None], found_iou, iou)

    def _best_fit(self, starts: np.ndarray, observation: Observation) -> tuple[np.ndarray, np.ndarray]:
        """Fit starts (run, start, coordinate) by their contours: each run's best pose and its overlap (run, camera)."""
        runs, count, coordinates = starts.shape
        fitter, total = self._fitter, runs * count
        flat = starts.reshape(total, coordinates)
        fitter.start_at(flat, np.repeat(self._home[None], total, axis=0), np.zeros(total, int))
        self._root_frame.enter(fitter.descent.pose, fitter.body.root_base)
        fitter.descend(total, STEPS)
        self._root_frame.leave(fitter.descent.best, fitter.body.root_base)
        fitted = fitter.descent.best.numpy()[:total].copy()
        objective = self._search.objective
        wp.copy(objective.pose, fitter.descent.best, count=total * coordinates)
        objective.evaluate(total)
        iou = overlap(objective.count.numpy()[:total], observation).reshape(runs, count, -1)
        best = np.argmax(np.nanmean(iou, axis=2), axis=1)
        each = np.arange(runs)
        return fitted.reshape(runs, count, -1)[each, best], iou[each, best]


_FEWEST = 4  # frames that a level needs


def _mean(iou: np.ndarray) -> np.ndarray:
    """(run,) over the views that see anything."""
    mean: np.ndarray = np.nanmean(iou, axis=1)
    return mean
