"""Annealed particle filter: J. Deutscher, I. Reid, International Journal of Computer Vision 61(2), 2005.

APF anneals all coordinates at once. Partition by partition it is the partitioned sampling annealed particle filter,
PSAPF: J. Bandouch, F. Engstler, M. Beetz, British Machine Vision Conference, 2008. Section 4.1 of the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from mmocap_warp.kernels.optimizers import annealed_filter as kernels
from mmocap_warp.kernels.optimizers.populations import SearchSpace, make_population, scatter
from mmocap_warp.optimizers.search import Optimizer, share_budget


@dataclass(frozen=True)
class AnnealedFilterConfig:
    """Settings of the annealed particle filter; the defaults are Table 3 and Section 4.1.1."""

    layers: int = 10  # L, in each partition
    survival: float = 0.5  # delta, the share of particles that the weights let pass to the next layer, in (0, 1]
    # of the selected particles' covariance, the share that propagation adds (Eq. 6); in no coordinate more than the
    # search's radius
    diffusion: float = 0.5
    # as printed, a search begins with the last one's particles, and a layer is weighed by the exponent that the layer
    # before chose. Otherwise all particles begin at the last answer, and a layer chooses its own
    carries: bool = True

    def __post_init__(self) -> None:
        if self.layers < 1:
            raise ValueError(f"layers must be at least 1, got {self.layers}")
        if not 0.0 < self.survival <= 1.0:
            raise ValueError(f"survival must be in (0, 1], got {self.survival}")
        if not 0.0 <= self.diffusion < float("inf"):
            raise ValueError(f"diffusion must be finite and not negative, got {self.diffusion}")


class AnnealedFilter(Optimizer):
    """The annealed particle filter over a batch of runs; all state lives on the device.

    There is one set of particles, each a point in all coordinates, and a search makes its set from the last search's.
    ``start`` moves that with the answer; at first all its particles are the start pose. ``ask`` propagates one
    partition of the selected particles into ``population`` (run, particle, dof); ``tell`` weighs them by their costs
    and selects as many, whole, with replacement. The answer is the weighted mean of the last layer, whose cost nobody
    has computed.

    Of the budget, each layer of each partition has the same number of particles. It has at least two, as among fewer
    there is nothing to select: of a smaller budget there are fewer layers, and of a budget of one none, so that the
    start pose is the answer.

    Args:
        space: its radius is the standard deviation of the noise in a partition's first layer.
        evaluations: budget of a search, which sets the number of particles.
        config: settings.
        partitions: how many coordinates each has; they lie side by side in ``space`` and are annealed in turn. None:
            all coordinates together.

    Raises:
        ValueError: the partitions have not as many coordinates as the space.
    """

    returns_best = False

    def __init__(
        self,
        space: SearchSpace,
        evaluations: int,
        config: AnnealedFilterConfig | None = None,
        partitions: Sequence[int] | None = None,
    ) -> None:
        self.config = config or AnnealedFilterConfig()
        self.space = space
        self._partitions = list(partitions or [space.index.size])
        if sum(self._partitions) != space.index.size:
            raise ValueError(f"partitions must add up to {space.index.size} coordinates, got {self._partitions}")
        self._layers = self.config.layers * len(self._partitions)
        self.particles = max(2, evaluations // self._layers)
        self.population = make_population(space, self.particles)
        self.state = kernels.make_state(self.population)
        self._set: tuple[Any, ...] = (self.state.selected, self.state.mean)
        self.memory = self._set if self.config.carries else ()
        self.plan(evaluations)

    def plan(self, evaluations: int) -> list[int]:
        """Whole layers only, shared evenly over the partitions; what does not divide is not spent."""
        layers = min(self._layers, evaluations // self.particles)
        share = share_budget(layers, len(self._partitions))
        self._schedule = kernels.make_schedule(self._partitions, share, not self.config.carries, self.space.seed.device)
        return [self.particles] * layers

    def start(self, pose: wp.array[wp.float32]) -> None:
        """Begin a search at ``pose`` (run, coordinate) with the particles of the last one, if they are carried."""
        if not self.config.carries:
            for array in self._set:
                array.zero_()
        kernels.start(self.space, pose, self.state)

    def ask(self, particles: int) -> wp.array[wp.float32]:
        """Propagate the first ``particles`` of the selected into ``population``."""
        kernels.sample_noise(self.space, particles, self.state)
        kernels.propagate(self.space, self._schedule, self.config.diffusion, particles, self.state)
        return self.population

    def tell(self, cost: wp.array[wp.float32]) -> None:
        """Weigh a whole layer by its costs (candidate,), and select from it."""
        kernels.weigh(cost, self._schedule, self.config.survival, self.state)
        kernels.select(self.state)

    def estimate(self, pose: wp.array[wp.float32]) -> None:
        """Write the weighted mean of the last layer."""
        scatter(self.state.mean, self.space.index, pose)
