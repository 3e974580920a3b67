"""The search of one frame: carried-over pose first, then each part's optimizer, within a strict budget."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from mmocap_warp.kernels.populations import keep_best, place
from mmocap_warp.objective import Objective
from mmocap_warp.optimizers.cma_es import CmaEs
from mmocap_warp.strategy import share_budget


class FrameSearch:
    """Finds the best pose of a frame for a batch of runs, starting from each run's last answer.

    Nothing is read back while a frame is searched: ``best_pose`` (run, coordinate) and ``best_cost`` (run,) stay on the
    device until the caller asks for them.

    Args:
        objective: the cost; sized for ``runs`` times the largest population.
        optimizers: one per part, in order.
        evaluations: budget per frame and run; the carried-over pose is the first evaluation.
        limits: (coordinate, 2) lowest and highest value of every coordinate; infinite where free.
    """

    def __init__(
        self,
        objective: Objective,
        optimizers: Sequence[CmaEs],
        evaluations: int,
        limits: np.ndarray,
    ) -> None:
        runs = optimizers[0].population.shape[0]
        device = objective.device
        self._objective, self._optimizers = objective, optimizers
        self._runs, self._evaluations = runs, evaluations
        self._shares = share_budget(evaluations - 1, len(optimizers))
        self._lower = wp.array(limits[:, 0], dtype=wp.float32, device=device)
        self._upper = wp.array(limits[:, 1], dtype=wp.float32, device=device)
        self.best_pose = wp.zeros((runs, len(limits)), dtype=wp.float32, device=device)
        self.best_cost = wp.zeros(runs, dtype=wp.float32, device=device)

    def run(self) -> int:
        """Search; improves ``best_pose`` in place and returns the evaluations spent by each run."""
        objective = self._objective
        self.best_cost.fill_(wp.inf)
        wp.copy(objective.pose, self.best_pose, count=self.best_pose.size)
        keep_best(objective.evaluate(self._runs), objective.pose, 1, self.best_cost, self.best_pose)
        for optimizer, share in zip(self._optimizers, self._shares, strict=True):
            self._search_part(optimizer, share)
        return self._evaluations

    def _search_part(self, optimizer: CmaEs, budget: int) -> None:
        """Spend a part's budget; its last generation is cut to fit and teaches nothing."""
        optimizer.start(self.best_pose)
        objective = self._objective
        while budget > 0:
            particles = min(optimizer.particles, budget)
            budget -= particles
            population = optimizer.ask(particles)
            place(population, optimizer.index, self.best_pose, self._lower, self._upper, particles, objective.pose)
            cost = objective.evaluate(self._runs * particles)
            keep_best(cost, objective.pose, particles, self.best_cost, self.best_pose)
            if particles == optimizer.particles:
                optimizer.tell(cost)

    def judge(self) -> np.ndarray:
        """Pixel counts of the best poses, (run, camera, 2) int: |M| and |M and F|. Not an evaluation of the search."""
        objective = self._objective
        wp.copy(objective.pose, self.best_pose, count=self.best_pose.size)
        objective.evaluate(self._runs)
        return objective.count.numpy()[: self._runs]
