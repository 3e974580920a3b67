"""Annealed particle filter: J. Deutscher, I. Reid, International Journal of Computer Vision 61(2), 2005.

APF searches all dimensions at once; in the six-part hierarchy it is the partitioned sampling annealed particle filter,
PSAPF: J. Bandouch, F. Engstler, M. Beetz, British Machine Vision Conference, 2008. Section 4.1 of the paper.
"""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from mmocap_warp.kernels.optimizers import annealed_filter as kernels
from mmocap_warp.kernels.optimizers.populations import SearchSpace, make_population


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
        space: its radius is the standard deviation of the first layer's noise.
        evaluations: the search's budget, which sets the number of particles.
        config: settings.
    """

    returns_best = False

    def __init__(self, space: SearchSpace, evaluations: int, config: AnnealedFilterConfig | None = None) -> None:
        self.config = config or AnnealedFilterConfig()
        self.space = space
        self.particles = max(2, evaluations // self.config.layers)
        self.population = make_population(space, self.particles)
        self.state = kernels.make_state(self.population)

    def plan(self, evaluations: int) -> list[int]:
        """Whole layers only; what does not divide is not spent."""
        return [self.particles] * min(self.config.layers, evaluations // self.particles)

    def start(self, pose: wp.array[wp.float32]) -> None:
        """Begin a search at ``pose`` (run, coordinate)."""
        kernels.start(self.space, pose, self.state)

    def ask(self, particles: int) -> wp.array[wp.float32]:
        """Propagate the first ``particles`` of the selected into ``population``."""
        kernels.sample_noise(self.space, particles, self.state)
        kernels.propagate(self.space, self.config.diffusion, particles, self.state)
        return self.population

    def tell(self, cost: wp.array[wp.float32]) -> None:
        """Weigh a whole layer by its costs (candidate,), and select from it."""
        kernels.weigh(cost, self.config.survival, self.state)
        kernels.select(self.state)

    def estimate(self, pose: wp.array[wp.float32]) -> None:
        """Write the weighted mean of the last layer."""
        kernels.write_mean(self.space, self.state, pose)
