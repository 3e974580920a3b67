"""Differential evolution in float64, fed the random numbers of the one that is tested, and a search to feed it."""

from __future__ import annotations

import minimising
import numpy as np

from mmocap_warp.optimizers.de import De, DeConfig

TWIN = 1e-5  # absolute, of coordinates about 1
UNIT = 2.0**-24  # most that single precision rounds off, as a share of the value


class Search(minimising.Search):
    """A search by differential evolution, with the settings of its configuration by name."""

    def __init__(self, dofs, seeds, device, scale=0.5, start=0.0, **settings):
        self.config = DeConfig(**settings)
        super().__init__(De, dofs, seeds, device, 1000, scale, start, self.config)

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
