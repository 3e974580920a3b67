"""A search for poses around the last ones: its parts, objective, optimizers and random numbers, for a batch of runs."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.body.skeleton import ROOT_ANGLES, Skeleton
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.kernels.body.root_frame import enter, leave
from mmocap_warp.kernels.optimizers.populations import make_space
from mmocap_warp.optimizers.search import Optimizer, Search
from mmocap_warp.tracking.algorithms import ALGORITHMS, CONTOUR_TRACKERS, Algorithm
from mmocap_warp.tracking.from_settings import make_objective, search_limits
from mmocap_warp.tracking.track_config import TrackConfig


class RootFrame:
    """Puts the root's rotation into its base while poses are changed, so that its angles stay far from gimbal lock.

    A root whose angles have limits (coordinate, 2) keeps its base. All of it happens on the device.
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


class PoseSearch(Search):
    """Searches with one of the paper's algorithms; owns the objective, the optimizers and the random counters.

    Budget, radii and runs are those of ``config``, the radii for a frame rate of ``fps``.

    Attributes:
        device: the Warp device.
        objective: the cost; it observes the masks that are searched against.
        counter: (run,) int32, states of the random numbers.

    Raises:
        ValueError: the body has no model with so many degrees of freedom.
    """

    def __init__(self, subject: Subject, rig: CameraRig, config: TrackConfig, algorithm: Algorithm, fps: float) -> None:
        self.device, runs = resolve_device(config.device), config.runs
        # Each run has a random stream of its own, so that it is as it would be alone.
        seed = wp.array(np.arange(config.seed, config.seed + runs), dtype=wp.int32, device=self.device)
        self.counter = wp.zeros(runs, dtype=wp.int32, device=self.device)
        optimizers = _optimizers(algorithm, subject.body.skeleton, config, config.radii(fps), seed, self.counter)
        candidates = runs * max(optimizer.particles for optimizer in optimizers)
        self.objective = make_objective(subject, rig, config, candidates, bases=runs)
        limits = search_limits(subject, config)
        self._root_frame = RootFrame(subject, limits, runs, self.device)
        super().__init__(self.objective, optimizers, config.budget, limits, replays=True)

    def remember(self, memory: Sequence[np.ndarray]) -> None:
        """Take over a copy of another search's ``memory``; an empty one makes this search as a new one."""
        for array in self.memory:
            array.zero_()
        for array, values in zip(self.memory, memory, strict=bool(memory)):
            array.assign(values)

    def run(self) -> None:
        """Search, from ``best_pose``."""
        pose, base = self.best_pose, self.objective.body.root_base
        self._root_frame.enter(pose, base)
        super().run()
        self._root_frame.leave(pose, base)

    def judge(self) -> np.ndarray:
        """Pixel counts of the answers, (run, camera, 2) int: |M| and |M and F|. Not an evaluation of the search.

        Where the answer is an estimate, this is also where its cost becomes known.
        """
        objective, runs = self.objective, len(self.best_pose)
        wp.copy(objective.pose, self.best_pose, count=self.best_pose.size)
        wp.copy(self.best_cost, objective.evaluate(runs), count=runs)
        count: np.ndarray = objective.count.numpy()
        return count[:runs]


def _optimizers(
    algorithm: Algorithm,
    skeleton: Skeleton,
    config: TrackConfig,
    radii: tuple[float, float],
    seed: wp.array[wp.int32],
    counter: wp.array[wp.int32],
) -> list[Optimizer]:
    """One optimizer for each part of the body, or one for all of them; their runs are those of ``seed`` (run,).

    Of a person the parts are the paper's six, and later ones never revise earlier ones.
    """
    by_part = [*skeleton.searched_by_part(config.dof).values()]
    parts = by_part if algorithm.hierarchical else [skeleton.searched(config.dof)]
    rotation, translation = radii
    radius = np.where(skeleton.is_length, translation, rotation)
    searched = [np.concatenate(parts)] if algorithm.partitioned else parts
    options = {"partitions": [len(index) for index in parts]} if algorithm.partitioned else {}
    spaces = (make_space(index, radius[index], seed, counter) for index in searched)
    return [algorithm.optimizer(space, config.budget, **options) for space in spaces]


def search_size(skeleton: Skeleton, config: TrackConfig) -> tuple[int, int]:
    """How many candidates a run's search judges at a time, and how many optimizers it has; (0, 0) without a search."""
    name = CONTOUR_TRACKERS.get(config.algorithm, config.algorithm)
    if name is None:
        return 0, 0
    no_runs = wp.zeros(0, dtype=wp.int32, device="cpu")
    optimizers = _optimizers(ALGORITHMS[name], skeleton, config, (1.0, 1.0), no_runs, no_runs)
    return max(optimizer.particles for optimizer in optimizers), len(optimizers)
