"""Differential evolution in float64, fed the random numbers of the one that is tested, and a search to feed it."""

from __future__ import annotations

import numpy as np
import warp as wp
from minimising import keep_best
from poisoned import SENTINEL

from mmocap_warp.kernels.optimizers.populations import make_space
from mmocap_warp.optimizers.de import De, DeConfig

TWIN = 1e-5  # absolute, of coordinates about 1
UNIT = 2.0**-24  # most that single precision rounds off, as a share of the value


class Search:
    """A search on a host-side function; columns of a wider pose vector are searched."""

    def __init__(self, dofs, seeds, device, scale=None, start=None, **settings):
        runs = len(seeds)
        self.config = DeConfig(**settings)
        self.scale = np.full(dofs, 0.5) if scale is None else np.asarray(scale, float)
        self.index = 2 * np.arange(dofs)[::-1]  # every other coordinate, from the last
        self.seed = wp.array(seeds, dtype=wp.int32, device=device)
        self.counter = wp.zeros(runs, dtype=wp.int32, device=device)
        self.optimizer = De(make_space(self.index, self.scale, self.seed, self.counter), 1000, self.config)
        self._poison()
        self.start = np.zeros((runs, dofs), np.float32) if start is None else np.asarray(start, np.float32)
        pose = np.full((runs, 2 * dofs), np.nan, np.float32)
        pose[:, self.index] = self.start
        self.optimizer.start(wp.array(pose, device=device))
        self.best, self.best_cost = self.start.copy(), np.full(runs, np.inf)  # what users get

    def _poison(self):
        """Nothing is used before it is written."""
        for array in vars(self.optimizer.state).values():
            if isinstance(array, wp.array):
                array.assign(np.full(array.numpy().shape, np.nan if array.dtype is wp.float32 else SENTINEL))

    def ask(self, particles=None):
        """(run, particle, dof)."""
        return self.optimizer.ask(particles or self.optimizer.particles).numpy().astype(float)

    def tell(self, cost):
        self.optimizer.tell(wp.array(np.ravel(cost), dtype=wp.float32, device=self.seed.device))

    def generation(self, function):
        """One generation; returns its candidates and costs."""
        x = self.ask()
        cost = function(x).astype(np.float32)
        self.tell(cost)
        keep_best(x, cost, self.best, self.best_cost)
        return x, cost

    def state(self):
        """Everything that the next generation depends on."""
        o = self.optimizer.state
        arrays = (o.member, o.member_cost, o.alpha, o.order, o.center, o.generation, self.counter)
        return [array.numpy().copy() for array in arrays]


def sphere(x):
    return np.sum(x**2, axis=-1)


def ellipsoid(x):
    """Condition number 100, its minimum away from the start and the middle of the box."""
    return np.sum(100 ** np.linspace(0, 1, x.shape[-1]) * (x - 0.3) ** 2, axis=-1)


class Twin:
    """Fig. 5 for one run in float64, told the random numbers of another and how that decided ties.

    ``uniform`` is (particle, number): the dofs' own, then forced dof, placing, alterations of alpha_L and alpha_C,
    four candidates each for leading and correcting. ``parents`` (particle, role) decide between candidates whose
    distances differ by rounding alone.
    """

    def __init__(self, center, scale, config):
        self.center, self.scale, self.config = np.asarray(center, float), scale, config
        self.x = None
        self.alpha = np.zeros((config.population, 2), int)

    def ask(self, uniform, parents):
        """(particle, dof)."""
        count, dofs = self.config.population, len(self.center)
        if self.x is None:
            self.trial = self.center + self.scale * (2 * uniform[:, :dofs].astype(float) - 1)
            if self.config.include_start:
                self.trial[0] = self.center
            self.altered = self.alpha
            return self.trial
        self.trial, self.altered, self.parents = self.x.copy(), np.zeros_like(self.alpha), np.zeros((count, 3), int)
        order = list(np.argsort(self.cost, kind="stable"))
        for r in range(count):
            own, drawn = uniform[r, :dofs], uniform[r, dofs:]
            p = self._mate(order[: self.config.placing], {r}, 0, 0, drawn[1:2], parents[r, 0])
            step = [pick(drawn[2], 3) - 1, pick(drawn[3], 3) - 1]
            a_l, a_c = self.altered[r] = np.clip(self.alpha[p] + step, -4, 4)
            l = self._mate(order[: self.config.leading], {r, p}, a_l, p, drawn[4:8], parents[r, 1])  # noqa: E741
            c = self._mate(order[count - self.config.correcting :], {r, p, l}, a_c, p, drawn[8:12], parents[r, 2])
            self.parents[r] = p, l, c
            donor = self.x[p] + self.config.factor * (self.x[l] - self.x[c])
            low, high = self.center - self.scale, self.center + self.scale
            donor = np.where(donor > high, 2 * high - donor, np.where(donor < low, 2 * low - donor, donor))
            crossed = own < np.float32(self.config.crossover)
            crossed[pick(drawn[0], dofs)] = True
            self.trial[r, crossed] = donor[crossed]
        return self.trial

    def _mate(self, role, excluded, alpha, placing, uniform, told):
        free = [k for k in role if k not in excluded] or list(role)
        drawn = []
        for u in uniform[: max(1, min(abs(alpha), len(free) - 1))]:
            drawn.append(free.pop(pick(u, len(free))))
        distance = {k: np.abs(self.x[k] - self.x[placing]).sum() * (1 if alpha >= 0 else -1) for k in drawn}
        least = min(drawn, key=distance.__getitem__)
        return told if abs(distance.get(told, np.inf) - distance[least]) < TWIN else least

    def tell(self, cost):
        if self.x is None:
            self.x, self.cost = self.trial.copy(), cost.astype(float)
            return
        won = cost < self.cost
        self.x[won], self.cost[won], self.alpha[won] = self.trial[won], cost[won], self.altered[won]


def pick(u, count):
    return min(int(np.float32(u) * np.float32(count)), count - 1)
