"""A frame's step: an observation in, poses out, one frame's answer starting the next."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.device import available_threads, resolve_device
from mmocap_warp.kernels.body.root_frame import enter, leave
from mmocap_warp.kernels.optimizers.populations import SearchSpace, make_space
from mmocap_warp.objective.objective import Objective
from mmocap_warp.optimizers.protocol import Optimizer
from mmocap_warp.optimizers.search import Search
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.tracking.algorithms import ALGORITHMS, Algorithm
from mmocap_warp.tracking.config import TrackConfig
from mmocap_warp.tracking.strategy import Part, hierarchical, holistic
from mmocap_warp.views.observation import Observation
from mmocap_warp.views.rig import CameraRig


class Tracker:
    """Tracks a subject frame by frame; owns the objective, the optimizers and each run's last answer.

    Args:
        subject: where to start.
        rig: undistorted cameras at the masks' size.
        config: settings.
        fps: frame rate of the recording, for the preset's radii.
        runs: instead of the configuration's. With 0 it can track nothing, but its arrays have the shapes of a run's.

    Attributes:
        device: the Warp device.
        particles: the most candidates of a run at a time.

    Raises:
        ValueError: the body has no model with so many degrees of freedom.
    """

    def __init__(
        self, subject: Subject, rig: CameraRig, config: TrackConfig, fps: float, runs: int | None = None
    ) -> None:
        self.config = config
        self.device = resolve_device(config.device)
        skeleton = subject.body.skeleton
        algorithm = ALGORITHMS[config.algorithm]
        parts = (hierarchical if algorithm.hierarchical else holistic)(skeleton, config.dof)
        rotation, translation = config.radii(fps)
        self._runs = config.runs if runs is None else runs
        seeds = np.arange(config.seed, config.seed + self._runs)
        seed = wp.array(seeds, dtype=wp.int32, device=self.device)
        self._counter = wp.zeros(self._runs, dtype=wp.int32, device=self.device)

        def space(index: np.ndarray) -> SearchSpace:
            return make_space(index, np.where(index < 3, translation, rotation), seed, self._counter)

        optimizers = _optimizers(algorithm, parts, space, config.evaluations)
        self.particles = max(optimizer.particles for optimizer in optimizers)
        self._objective = Objective(
            subject.body,
            subject.root_base,
            rig,
            self._runs * self.particles,
            cost=config.cost,
            renderer=config.renderer,
            bases=self._runs,
            device=self.device,
            threads=config.threads or available_threads(),
        )
        self._home = wp.mat33(subject.root_base.astype(np.float32))
        self._root = wp.mat33(skeleton.frame[0].astype(np.float32))
        self._angles = wp.zeros(self._runs, dtype=wp.vec3, device=self.device)
        limits = skeleton.coordinate_limits if config.limits else np.tile([-np.inf, np.inf], (skeleton.coordinates, 1))
        self._turns_freely = bool(np.all(np.abs(limits[_ROOT_ANGLES]) >= np.pi))
        self._search = Search(self._objective, optimizers, config.evaluations, limits, replays=True)
        self._search.best_pose.assign(np.repeat(subject.pose[None].astype(np.float32), self._runs, axis=0))

    @property
    def candidate_arrays(self) -> list[wp.array[Any]]:
        """The arrays that have a row for every candidate; all others that depend on the runs have one for each run."""
        return self._objective.candidate_arrays

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
        for array in self._search.memory:
            array.zero_()
        for array, values in zip(self._carried, (pose, counter, *memory), strict=False):
            array.assign(values)

    @property
    def _carried(self) -> list[wp.array[Any]]:
        """The arrays of :attr:`state`."""
        return [self._search.best_pose, self._counter, *self._search.memory]

    def step(self, observation: Observation) -> FrameAnswer:
        """Find the pose of the next frame. Without any foreground the frame is lost and the pose is carried over."""
        seen = observation.foreground > 0
        runs, cameras = self._runs, len(seen)
        if not seen.any():
            pose = self._search.best_pose.numpy().copy()
            nothing = np.full(runs, np.nan, np.float32)
            return FrameAnswer(pose, nothing, np.full((runs, cameras), np.nan), 0, STATUS.index("lost"), 0.0)
        self._objective.observe(observation)
        started = time.perf_counter()
        self._run()
        pose = self._search.best_pose.numpy().copy()
        seconds = time.perf_counter() - started
        count = self._judge().astype(np.float64)
        union = count[..., 0] + observation.foreground - count[..., 1]
        iou = np.where(seen, count[..., 1] / np.maximum(union, 1), np.nan)
        status = STATUS.index("tracked" if seen.all() else "partial")
        return FrameAnswer(pose, self._search.best_cost.numpy().copy(), iou, self._search.evaluations, status, seconds)

    def _run(self) -> None:
        """Search, with the root's angles counted from where the last frame left them, unless they have limits."""
        if not self._turns_freely:
            self._search.run()
            return
        pose, base = self._search.best_pose, self._objective.body.root_base
        enter(self._home, self._root, pose, self._angles, base)
        self._search.run()
        leave(self._home, self._root, self._angles, pose, base)

    def _judge(self) -> np.ndarray:
        """Pixel counts of the answers, (run, camera, 2) int: |M| and |M and F|. Not an evaluation of the search.

        Where the answer is an estimate, this is also where its cost becomes known.
        """
        search, objective, runs = self._search, self._objective, self._runs
        wp.copy(objective.pose, search.best_pose, count=search.best_pose.size)
        wp.copy(search.best_cost, objective.evaluate(runs), count=runs)
        count: np.ndarray = objective.count.numpy()
        return count[:runs]


def _optimizers(
    algorithm: Algorithm, parts: list[Part], space: Callable[[np.ndarray], SearchSpace], evaluations: int
) -> list[Optimizer]:
    """One for each part, or one for all of them."""
    if algorithm.partitioned:
        together = np.concatenate([part.index for part in parts])
        sizes = [len(part.index) for part in parts]
        return [algorithm.optimizer(space(together), evaluations, partitions=sizes)]
    return [algorithm.optimizer(space(part.index), evaluations) for part in parts]


_ROOT_ANGLES = slice(3, 6)
