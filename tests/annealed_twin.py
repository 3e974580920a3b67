"""The annealed particle filter in float64, fed the random numbers of the one that is tested."""

import numpy as np
from scipy import optimize


def survival_rate(weight):
    """Eq. 7."""
    return weight.sum(axis=-1) ** 2 / (weight**2).sum(axis=-1) / weight.shape[-1]


def weights(cost, exponent):
    """Normalised (particle,), of finite costs in [0, 1]."""
    base = (1 - cost) / (1 - cost.min())
    weight = np.where(base > 0, np.maximum(base, 1e-300) ** exponent, 0.0)
    return weight / weight.sum()


def annealed(cost, survival=0.5):
    """The exponent for which the survival rate is nearest to the one that Eq. 8 asks for."""

    def too_many(log_exponent):
        return survival_rate(weights(cost, np.exp(log_exponent))) - survival

    apart = np.log(1 - cost.min()) - np.log(1 - cost[(cost > cost.min()) & (cost < 1)])
    if not len(apart):
        return 1.0
    softest, hardest = np.log(1e-3 / apart.max()), np.log(1e2 / apart.min())
    if too_many(hardest) > 0:
        return np.exp(hardest)
    if too_many(softest) < 0:
        return np.exp(softest)
    return np.exp(optimize.brentq(too_many, softest, hardest, xtol=1e-13))


class Twin:
    """Fig. 3 for one run in float64, frame after frame, with partitions of so many dofs."""

    def __init__(self, scale, particles, partitions):
        self.scale = scale
        self.selected, self.mean = np.zeros((particles, len(scale))), np.zeros(len(scale))
        ends = np.cumsum(partitions)
        parts = [slice(end - size, end) for size, end in zip(partitions, ends, strict=True)]
        self.schedule = [(part, layer == 0) for part in parts for layer in range(10)]

    def start(self, pose):
        """At a pose (dof,), with the particles that the last frame selected."""
        self.selected = self.selected + pose - self.mean
        self.mean, self.layer = pose, 0

    def ask(self, noise):
        """(particle, dof), by random numbers (particle, number)."""
        particles = len(self.selected)
        part, opens = self.schedule[self.layer]
        self.x = self.selected.copy()
        if opens:
            self.x[:, part] += self.scale[part] * noise[:, part]
        else:
            apart = self.selected[:, part] - self.selected[:, part].mean(axis=0)
            spread = np.sqrt(0.5) * apart.std(axis=0)
            step = np.sqrt(0.5 / particles) * noise[:, :particles] @ apart
            self.x[:, part] += step * np.minimum(1.0, self.scale[part] / np.maximum(spread, 1e-300))
        return self.x

    def tell(self, cost, uniform):
        """Weigh by costs (particle,) and select by random numbers (particle,)."""
        judged = np.isfinite(cost)
        if judged.any() and (cost[judged].min() < 0 or cost[judged].max() > 1):
            cost = (cost - cost[judged].min()) / np.ptp(cost[judged])
        cost = np.where(judged, cost, 1.0)
        following = annealed(cost)
        _part, opens = self.schedule[self.layer]
        self.weight = weights(cost, following if opens else self.exponent)
        self.exponent = following
        self.mean = self.weight @ self.x
        self.parent = np.searchsorted(np.cumsum(self.weight), uniform, side="right")
        self.selected = self.x[self.parent]
        self.layer += 1


def bounded(x):
    """In [0, 1), as the tracker's costs."""
    return 1 - np.exp(-np.mean((x - 0.3) ** 2, axis=-1))


def mostly_judged(x):
    """A fifth of the particles cannot be judged."""
    return np.where(x[..., 0] > np.quantile(x[..., 0], 0.8, axis=-1, keepdims=True), np.inf, bounded(x))
