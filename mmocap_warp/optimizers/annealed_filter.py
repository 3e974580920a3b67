"""Annealed particle filter: J. Deutscher, I. Reid, International Journal of Computer Vision 61(2), 2005.

APF searches all dimensions at once; in the six-part hierarchy it is the partitioned sampling annealed particle filter,
PSAPF: J. Bandouch, F. Engstler, M. Beetz, British Machine Vision Conference, 2008. Section 4.1 of the paper.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmocap_warp.kernels.optimizers import annealed_filter as kernels
from mmocap_warp.kernels.optimizers.populations import scatter


@dataclass(frozen=True)
class AnnealedFilterConfig:
    """Settings of the annealed particle filter; the defaults are Table 3 and Section 4.1.1.

    Attributes:
        layers: L, over which the budget is spread evenly.
        survival: delta, the share of particles that the weights let pass to the next layer, in (0, 1].
        diffusion: of the selected particles' covariance, the share that propagation adds (Eq. 6).
    """

    layers: int = 10
    survival: float = 0.5
    diffusion: float = 0.5

    def __post_init__(self) -> None:
        if self.layers < 1:
            raise ValueError(f"layers must be at least 1, got {self.layers}")
        if not 0.0 < self.survival <= 1.0:
            raise ValueError(f"survival must be in (0, 1], got {self.survival}")
        if not 0.0 <= self.diffusion < float("inf"):
            raise ValueError(f"diffusion must be finite and not negative, got {self.diffusion}")


class AnnealedFilter:
    """The annealed particle filter over a batch of runs; all state lives on the device.

    ``start`` puts all particles at the start pose. ``ask`` propagates the selected particles into ``population`` (run,
    particle, dof); ``tell`` weighs them by their costs and selects as many with replacement. The answer is the weighted
    mean of the last layer, whose cost nobody has computed.

    A layer has ``evaluations // layers`` particles. It has at least two, as among fewer there is nothing to select: of
    a smaller budget there are fewer layers, and of a budget of one none, so that the start pose is the answer.

    Args:
        index: coordinates of the start vector that are searched, (dof,) int.
        scale: (dof,) standard deviation of the first layer's noise.
        runs: independent runs.
        seed: (run,) int32 Warp array; run r's samples depend on its seed and counter alone.
        draw: (run,) int32 Warp array of counters that sampling advances; optimizers of one search share it.
        evaluations: the search's budget, which sets the number of particles.
        config: settings.
    """

    returns_best = False

    def __init__(
        self,
        index: np.ndarray,
        scale: np.ndarray,
        runs: int,
        seed: wp.array,
        draw: wp.array,
        evaluations: int,
        config: AnnealedFilterConfig | None = None,
    ) -> None:
        self.config = config or AnnealedFilterConfig()
        self.particles = max(2, evaluations // self.config.layers)
        dofs, device = len(index), seed.device
        self.index = wp.array(index, dtype=wp.int32, device=device)
        self.scale = wp.array(scale, dtype=wp.float32, device=device)
        self._seed, self._draw = seed, draw
        self.population = wp.zeros((runs, self.particles, dofs), dtype=wp.float32, device=device)
        self.selected = wp.zeros_like(self.population)
        self._center = wp.zeros((runs, dofs), dtype=wp.float32, device=device)
        self.mean = wp.zeros_like(self._center)
        self.weight = wp.zeros((runs, self.particles), dtype=wp.float32, device=device)
        self._distance = wp.zeros_like(self.weight)
        self._chance = wp.zeros_like(self.weight)
        # The first layer needs a number per dimension, later ones a number per particle.
        numbers = max(dofs, self.particles)
        self._noise = wp.zeros((runs, self.particles, numbers), dtype=wp.float32, device=device)
        self.parent = wp.zeros((runs, self.particles), dtype=wp.int32, device=device)
        self.exponent = wp.zeros(runs, dtype=wp.float32, device=device)
        self._layer = wp.zeros(runs, dtype=wp.int32, device=device)

    def plan(self, evaluations: int) -> list[int]:
        """Whole layers only; what does not divide is not spent."""
        return [self.particles] * min(self.config.layers, evaluations // self.particles)

    def start(self, pose: wp.array) -> None:
        """Begin a search at ``pose`` (run, coordinate)."""
        kernels.start(pose, self.index, self.selected, self._center, self.mean, self._layer)

    def ask(self, particles: int) -> wp.array:
        """Propagate the first ``particles`` of the selected into ``population``."""
        kernels.draw_noise(self._seed, self._draw, particles, self._chance, self._noise)
        kernels.propagate(
            self.selected, self._center, self._layer, self.scale, self.config.diffusion, self._noise,
            particles, self.population,
        )  # fmt: skip
        return self.population

    def tell(self, cost: wp.array) -> None:
        """Weigh a whole layer by its costs (candidate,), and select from it."""
        kernels.weigh(
            cost, self.population, self.config.survival, self._layer, self._distance, self.exponent, self.weight,
            self.mean,
        )  # fmt: skip
        kernels.select(self.population, self.weight, self._chance, self.parent, self.selected, self._center)

    def estimate(self, pose: wp.array) -> None:
        """Write the weighted mean of the last layer."""
        scatter(self.mean, self.index, pose)
