"""A frame's step: an observation in, poses out, one frame's answer starting the next."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.tracking.pose_search import PoseSearch
from mmocap_warp.tracking.presets import PRESETS
from mmocap_warp.tracking.track_config import TrackConfig


class Tracker:
    """Tracks a subject frame by frame with one of the paper's algorithms, and keeps each run's last answer.

    Args:
        subject: where to start.
        rig: undistorted cameras at the masks' size.
        config: settings.
        fps: frame rate of the recording, for the preset's radii.
        runs: instead of the configuration's. With 0 it can track nothing, but its arrays have the shapes of a run's.

    Attributes:
        device: the Warp device.
        search: what finds each frame's poses.

    Raises:
        ValueError: the body has no model with so many degrees of freedom.
    """

    def __init__(
        self, subject: Subject, rig: CameraRig, config: TrackConfig, fps: float, runs: int | None = None
    ) -> None:
        self.config = config
        self._runs = config.runs if runs is None else runs
        self.search = PoseSearch(
            subject,
            rig,
            config,
            algorithm=PRESETS[config.preset].algorithm(config.algorithm),
            evaluations=config.budget,
            radii=config.radii(fps),
            runs=self._runs,
        )
        self.device = self.search.device
        self.search.best_pose.assign(np.repeat(subject.pose[None].astype(np.float32), self._runs, axis=0))

    @property
    def state(self) -> tuple[np.ndarray, ...]:
        """All that the next frame depends on.

        Last poses (run, coordinate) float32 and random counters (run,) int32; of a particle filter its particles
        (run, particle, dof) and their mean (run, dof), float32. Without those, a filter begins anew at the poses.
        """
        return tuple(array.numpy().copy() for array in self._carried)

    @state.setter
    def state(self, value: tuple[np.ndarray, ...]) -> None:
        pose, counter, *memory = value
        for array in self.search.memory:
            array.zero_()
        for array, values in zip(self._carried, (pose, counter, *memory), strict=False):
            array.assign(values)

    @property
    def _carried(self) -> list[wp.array[Any]]:
        """The arrays of :attr:`state`."""
        return [self.search.best_pose, self.search.counter, *self.search.memory]

    def step(self, observation: Observation) -> FrameAnswer:
        """Find the pose of the next frame. Without any foreground the frame is lost and the pose is carried over."""
        if not observation.foreground.any():
            return lost_frame(self.search.best_pose.numpy().copy(), observation)
        search = self.search
        search.observe(observation)
        started = time.perf_counter()
        search.run()
        pose = search.best_pose.numpy().copy()
        seconds = time.perf_counter() - started
        iou = overlap(search.judge(), observation)
        status = STATUS.index("tracked" if observation.foreground.all() else "partial")
        return FrameAnswer(pose, search.best_cost.numpy().copy(), iou, search.evaluations, status, seconds)


def lost_frame(pose: np.ndarray, observation: Observation) -> FrameAnswer:
    """The answer where nothing is seen: poses (run, coordinate) carried over."""
    runs, cameras = len(pose), len(observation.foreground)
    nothing = np.full(runs, np.nan, np.float32)
    return FrameAnswer(pose, nothing, np.full((runs, cameras), np.nan), 0, STATUS.index("lost"), 0.0)


def overlap(count: np.ndarray, observation: Observation) -> np.ndarray:
    """Intersection over union (n, camera) of pixel counts (n, camera, 2), |M| and |M and F|; NaN for a lost view."""
    count = count.astype(np.float64)
    union = count[..., 0] + observation.foreground - count[..., 1]
    return np.where(observation.foreground > 0, count[..., 1] / np.maximum(union, 1), np.nan)
