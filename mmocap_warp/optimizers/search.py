"""A search within a strict budget: the start first, then each part's optimizer."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import warp as wp

from mmocap_warp.device.transfers import Replays
from mmocap_warp.kernels.optimizers.populations import SearchSpace, clamp, keep_best, make_limits, place


class Optimizer(Protocol):
    """Minimises a batched cost over a batch of independent runs; all of its state lives on the device.

    It is made for the budget of a whole search. Before the first search, ``plan`` gives it its share of the budget and
    returns the sizes of the generations. ``start`` begins a search. Then, for each size, ``ask(size)`` fills the first
    ``size`` particles of ``population``, the caller computes their costs (candidate = run * size + particle), and
    ``tell`` learns from them. A generation smaller than ``particles`` only spends the rest of the budget: ``tell`` is
    not called for it.

    Nothing that changes from one generation to the next is a number on the host. So a captured graph of a generation
    can be replayed.

    Attributes:
        space: its runs, what they search and how far, and their random streams.
        particles: size of a whole generation.
        population: (run, particle, dof) float32, the candidates.
        returns_best: whether the answer is the best candidate ever, which the caller keeps; otherwise it is the
            optimizer's own ``estimate``.
        memory: arrays, the run first, by which a search depends on the one before it; zeros before there was one.
    """

    space: SearchSpace
    particles: int
    population: wp.array[wp.float32]
    returns_best: bool = True
    memory: tuple[wp.array[Any], ...] = ()

    def plan(self, evaluations: int) -> list[int]:
        """Take over the budget of every search from now on, and return the sizes of the generations that spend it.

        They never add up to more. By default all are whole, but for the last one.
        """
        whole, left = divmod(evaluations, self.particles)
        return [self.particles] * whole + ([left] if left else [])

    def start(self, pose: wp.array[wp.float32]) -> None:
        """Begin a search at ``pose`` (run, coordinate)."""

    def ask(self, particles: int) -> wp.array[wp.float32]:
        """Fill ``population`` and return it."""

    def tell(self, cost: wp.array[wp.float32]) -> None:
        """Learn from the costs (candidate,) of a whole generation; infinite costs are allowed, NaN is not."""

    def estimate(self, pose: wp.array[wp.float32]) -> None:
        """Write the answer's coordinates into ``pose`` (run, coordinate), where ``returns_best`` is False."""
        return


def share_budget(evaluations: int, parts: int) -> list[int]:
    """Split a budget evenly; what does not divide goes to the first parts."""
    return [evaluations // parts + (i < evaluations % parts) for i in range(parts)]


class BatchedCost(Protocol):
    """A cost of many candidates at once."""

    device: str  # the Warp device of its arrays
    pose: wp.array[wp.float32]  # (candidate, coordinate), where candidates are written

    def evaluate(self, candidates: int) -> wp.array[wp.float32]:
        """Costs (candidate,) float32 of the first ``candidates`` rows of ``pose``; infinite is allowed, NaN is not."""

    @property
    def addresses(self) -> tuple[int | None, ...]:
        """Of arrays that are made anew when more room is needed: a graph holds them."""
        return ()

    def prepare(self, runs: int, index: np.ndarray) -> None:
        """Allocate what ``hold`` will need; nothing where candidates are always judged whole."""
        return

    def hold(self, base: wp.array[wp.float32], index: np.ndarray) -> None:
        """Note that candidates differ from their run's ``base`` (run, coordinate) in coordinates ``index`` alone."""
        return

    def release(self) -> None:
        """Note that candidates may differ in everything again."""
        return


class Search:
    """Finds the best coordinates (in tracking: a pose) for a batch of runs, starting from each run's last answer.

    Nothing is read back while it runs: ``best_pose`` (run, coordinate) and ``best_cost`` (run,) stay on the
    device until the caller asks for them.

    Args:
        objective: the cost; its ``pose`` is sized for ``runs`` times the largest population.
        optimizers: one per part, in order.
        evaluations: budget of each run; the start is the first evaluation, unless the answer is an estimate. The rest
            is shared evenly over the optimizers, which are told their shares here and nowhere else.
        limits: (coordinate, 2) lowest and highest value of every coordinate; infinite where free.
        replays: search again and again with the same arrays, and on a GPU replay a captured graph.
    """

    def __init__(
        self,
        objective: BatchedCost,
        optimizers: Sequence[Optimizer],
        evaluations: int,
        limits: np.ndarray,
        replays: bool = False,
    ) -> None:
        runs = optimizers[0].population.shape[0]
        device = objective.device
        self._objective, self._optimizers = objective, optimizers
        self._runs = runs
        self._replays = Replays(device) if replays else None
        self._returns_best = all(optimizer.returns_best for optimizer in optimizers)
        shares = share_budget(evaluations - self._returns_best, len(optimizers))
        self._moved = [optimizer.space.index.numpy() for optimizer in optimizers]
        for moved in self._moved:
            objective.prepare(runs, moved)
        self._sizes = [optimizer.plan(share) for optimizer, share in zip(optimizers, shares, strict=True)]
        for optimizer, share, sizes in zip(optimizers, shares, self._sizes, strict=True):
            if sum(sizes) > share or max(sizes, default=0) > optimizer.particles:
                most = f"{share} candidates, {optimizer.particles} at a time"
                raise ValueError(f"{type(optimizer).__name__}.plan may have at most {most}, got {list(sizes)}")
        self._limits = make_limits(limits, device)
        self.best_pose = wp.zeros((runs, len(limits)), dtype=wp.float32, device=device)
        self.best_cost = wp.zeros(runs, dtype=wp.float32, device=device)

    @property
    def memory(self) -> list[wp.array[Any]]:
        """Arrays by which, beside ``best_pose`` and the random counters, a search depends on the one before it."""
        return [array for optimizer in self._optimizers for array in optimizer.memory]

    @property
    def evaluations(self) -> int:
        """What a search costs each run: the budget, or less where it does not divide."""
        return self._returns_best + sum(map(sum, self._sizes))

    def run(self) -> None:
        """Search; improves ``best_pose`` in place."""
        if self._replays:
            self._replays.run(("search", *self._objective.addresses), self._run)
        else:
            self._run()

    def _run(self) -> None:
        """All launches of a search: the start, then part by part."""
        objective = self._objective
        self.best_cost.fill_(wp.inf)
        if self._returns_best:
            wp.copy(objective.pose, self.best_pose, count=self.best_pose.size)
            keep_best(objective.evaluate(self._runs), objective.pose, 1, self.best_cost, self.best_pose)
        for optimizer, moved, sizes in zip(self._optimizers, self._moved, self._sizes, strict=True):
            objective.hold(self.best_pose, moved)
            optimizer.start(self.best_pose)
            for particles in sizes:
                population = optimizer.ask(particles)
                place(population, optimizer.space.index, self.best_pose, self._limits, particles, objective.pose)
                cost = objective.evaluate(self._runs * particles)
                if optimizer.returns_best:
                    keep_best(cost, objective.pose, particles, self.best_cost, self.best_pose)
                if particles == optimizer.particles:
                    optimizer.tell(cost)
            if not optimizer.returns_best:
                optimizer.estimate(self.best_pose)
                clamp(self._limits, self.best_pose)
        objective.release()
