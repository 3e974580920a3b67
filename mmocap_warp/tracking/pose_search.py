"""A search for poses from where a frame left them: objective, optimizers and random numbers of a batch of runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.kernels.body.root_frame import enter, leave
from mmocap_warp.kernels.optimizers.populations import SearchSpace, make_space
from mmocap_warp.masks.observation import Observation
from mmocap_warp.optimizers.protocol import Optimizer
from mmocap_warp.optimizers.search import Search
from mmocap_warp.tracking.algorithms import Algorithm
from mmocap_warp.tracking.from_settings import make_objective, search_limits
from mmocap_warp.tracking.parts import Part, hierarchical, holistic
from mmocap_warp.tracking.track_config import TrackConfig


class RootFrame:
    """Counts root angles from where they are while a search runs, unless they have limits, on the device.

    Args:
        subject: whose skeleton and base.
        limits: (coordinate, 2) lowest and highest value.
        poses: how many at a time.
        device: a Warp device.
    """

    def __init__(self, subject: Subject, limits: np.ndarray, poses: int, device: str) -> None:
        self._home = wp.mat33(subject.root_base.astype(np.float32))
        self._root = wp.mat33(subject.body.skeleton.frame[0].astype(np.float32))
        self._angles = wp.zeros(poses, dtype=wp.vec3, device=device)
        self._turns_freely = bool(np.all(np.abs(limits[ROOT_ANGLES]) >= np.pi))

    def enter(self, pose: wp.array[wp.float32], base: wp.array[wp.mat33]) -> None:
        """Put the root's angles of ``pose`` (n, coordinate) into ``base`` (n,)."""
        if self._turns_freely:
            enter(self._home, self._root, pose, self._angles, base)

    def leave(self, pose: wp.array[wp.float32], base: wp.array[wp.mat33]) -> None:
        """Undo :meth:`enter` for poses that have moved on since."""
        if self._turns_freely:
            leave(self._home, self._root, self._angles, pose, base)


class PoseSearch:
    """Searches with one of the paper's algorithms; owns the objective, the optimizers and the random counters.

    Args:
        subject: whose poses.
        rig: undistorted cameras at the masks' size.
        config: settings.
        algorithm: how to search.
        evaluations: budget of a run's search.
        radii: rotation [rad] and translation [m].
        runs: independent runs.

    Attributes:
        device: the Warp device.
        objective: the cost.
        particles: the most candidates of a run at a time.
        counter: (run,) int32, states of the random numbers.

    Raises:
        ValueError: the body has no model with so many degrees of freedom.
    """

    def __init__(
        self,
        subject: Subject,
        rig: CameraRig,
        config: TrackConfig,
        *,
        algorithm: Algorithm,
        evaluations: int,
        radii: tuple[float, float],
        runs: int,
    ) -> None:
        self.device = resolve_device(config.device)
        skeleton = subject.body.skeleton
        parts = (hierarchical if algorithm.hierarchical else holistic)(skeleton, config.dof)
        rotation, translation = radii
        self._runs = runs
        seeds = np.arange(config.seed, config.seed + runs)
        seed = wp.array(seeds, dtype=wp.int32, device=self.device)
        self.counter = wp.zeros(runs, dtype=wp.int32, device=self.device)

        def space(index: np.ndarray) -> SearchSpace:
            return make_space(index, np.where(skeleton.is_length[index], translation, rotation), seed, self.counter)

        optimizers = _optimizers(algorithm, parts, space, evaluations)
        self.particles = max(optimizer.particles for optimizer in optimizers)
        self.objective = make_objective(subject, rig, config, runs * self.particles, bases=runs)
        limits = search_limits(subject, config)
        self._root_frame = RootFrame(subject, limits, runs, self.device)
        self._search = Search(self.objective, optimizers, evaluations, limits, replays=True)

    @property
    def best_pose(self) -> wp.array[wp.float32]:
        """(run, coordinate): where the search starts, and then its answer."""
        return self._search.best_pose

    @property
    def best_cost(self) -> wp.array[wp.float32]:
        """(run,) of the answer."""
        return self._search.best_cost

    @property
    def evaluations(self) -> int:
        """Spent on a run's search."""
        return self._search.evaluations

    @property
    def memory(self) -> list[wp.array[Any]]:
        """By which, beside ``best_pose`` and ``counter``, a search depends on the one before it."""
        return self._search.memory

    def observe(self, observation: Observation) -> None:
        """Search against these masks from now on."""
        self.objective.observe(observation)

    def run(self) -> None:
        """Search, from ``best_pose``."""
        pose, base = self.best_pose, self.objective.body.root_base
        self._root_frame.enter(pose, base)
        self._search.run()
        self._root_frame.leave(pose, base)

    def judge(self) -> np.ndarray:
        """Pixel counts of the answers, (run, camera, 2) int: |M| and |M and F|. Not an evaluation of the search.

        Where the answer is an estimate, this is also where its cost becomes known.
        """
        objective, runs = self.objective, self._runs
        wp.copy(objective.pose, self.best_pose, count=self.best_pose.size)
        wp.copy(self.best_cost, objective.evaluate(runs), count=runs)
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
