"""A driver that minimises functions of NumPy arrays with any optimizer, and functions to minimise."""

from __future__ import annotations

import numpy as np
import warp as wp
from poisoned import SENTINEL

from mmocap_warp.kernels.optimizers.populations import make_space


def keep_best(x, cost, best, best_cost):
    """Let each run's ``best`` (run, dof) be replaced by a strictly better candidate; the first of equals wins."""
    for run, winner in enumerate(cost.argmin(axis=1)):
        if cost[run, winner] < best_cost[run]:
            best[run], best_cost[run] = x[run, winner], cost[run, winner]


class Search:
    """A search by ``kind``; every other column of a wider pose vector is searched, the others are NaN.

    The optimizer's arrays are poisoned before the start: nothing may be used before it is written, but its memory.
    """

    def __init__(self, kind, dofs, seeds, device, evaluations=500, scale=0.5, start=0.0, config=None):
        runs = len(seeds)
        self.scale = np.broadcast_to(np.asarray(scale, float), dofs)
        self.index = 2 * np.arange(dofs)[::-1]
        self.evaluations = evaluations
        self.counter = wp.zeros(runs, dtype=wp.int32, device=device)
        seed = wp.array(seeds, dtype=wp.int32, device=device)
        self.optimizer = kind(make_space(self.index, self.scale, seed, self.counter), evaluations, config=config)
        memory = [id(array) for array in self.optimizer.memory]
        for array in self._arrays().values():
            if id(array) in memory:
                continue
            array.assign(np.full(array.numpy().shape, np.nan if array.dtype is wp.float32 else SENTINEL))
        self.start = np.broadcast_to(np.asarray(start, np.float32), (runs, dofs))
        self.restart()

    def _arrays(self):
        return {name: value for name, value in vars(self.optimizer.state).items() if isinstance(value, wp.array)}

    def restart(self):
        self.best = self.start.astype(float)
        self.best_cost = np.full(len(self.start), np.inf)
        pose = np.full((len(self.start), 2 * len(self.index)), np.nan, np.float32)
        pose[:, self.index] = self.start
        self.optimizer.start(wp.array(pose, device=self.counter.device))

    def ask(self, particles=None):
        """(run, particle, dof)."""
        return self.optimizer.ask(particles or self.optimizer.particles).numpy().astype(float)

    def tell(self, cost):
        self.optimizer.tell(wp.array(np.ravel(cost), dtype=wp.float32, device=self.counter.device))

    def generation(self, function):
        """One generation; returns its candidates (run, particle, dof) and single-precision costs (run, particle)."""
        x = self.ask()
        cost = function(x).astype(np.float32)
        self.tell(cost)
        keep_best(x, cost, self.best, self.best_cost)
        return x, cost

    def run(self, function):
        """Spend the budget; returns the lowest cost that each run met, (run,)."""
        for particles in self.optimizer.plan(self.evaluations):
            x = self.ask(particles)[:, :particles]
            cost = function(x)
            keep_best(x, cost, self.best, self.best_cost)
            if particles == self.optimizer.particles:
                self.tell(cost)
        return self.best_cost

    def estimate(self):
        """The answer that users get, (run, dof): the best candidate since the start, or the optimizer's own."""
        if self.optimizer.returns_best:
            return self.best.copy()
        pose = wp.zeros((len(self.start), 2 * len(self.index)), dtype=wp.float32, device=self.counter.device)
        self.optimizer.estimate(pose)
        return pose.numpy()[:, self.index].astype(float)

    def state(self):
        """Every array that a search changes, by name, the run first."""
        arrays = self._arrays() | {"counter": self.counter}
        return {name: array.numpy().copy() for name, array in arrays.items()}


def assert_a_run_of_a_batch_is_the_single_run(kind, dofs, device, function, **settings):
    """Bit for bit, in every array, after a whole search and the beginning of another."""
    seeds = [5, 900, 0]
    starts = np.random.default_rng(0).normal(0, 1, (3, dofs))
    batch = Search(kind, dofs, seeds, device, start=starts, **settings)
    singles = [
        Search(kind, dofs, [seed], device, start=start[None], **settings)
        for seed, start in zip(seeds, starts, strict=True)
    ]
    for search in (batch, *singles):
        search.run(function)
        search.restart()
        search.generation(function)
    together = batch.state()
    for run, single in enumerate(singles):
        for name, alone in single.state().items():
            np.testing.assert_array_equal(together[name][run], alone[0], err_msg=name)
    candidates = batch.optimizer.population.numpy()
    assert not np.array_equal(candidates[0], candidates[1])


def assert_finite(search):
    """No NaN anywhere, and finite candidates."""
    for name, values in search.state().items():
        assert not np.isnan(values).any(), name
    assert np.isfinite(search.optimizer.population.numpy()).all()


def sphere(x):
    return np.sum(x**2, axis=-1)


def ellipsoid(x):
    """Condition number 100, its minimum away from zero."""
    return np.sum(100 ** np.linspace(0, 1, x.shape[-1]) * (x - 0.3) ** 2, axis=-1)


def rosenbrock(x):
    return np.sum(100 * (x[..., 1:] - x[..., :-1] ** 2) ** 2 + (1 - x[..., :-1]) ** 2, axis=-1)


def flat(x):
    return np.zeros(x.shape[:-1])


def unjudged(x):
    return np.full(x.shape[:-1], np.inf)


def half_judged(x):
    """A sphere that cannot be judged on one side."""
    return np.where(x[..., 0] > 0.2, np.inf, sphere(x))
