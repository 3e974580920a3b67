"""Particle swarm optimization: J. Kennedy, R. Eberhart, IEEE Int. Conf. on Neural Networks, 1995.

The inertia's exponential fall and the settings are those of V. John, E. Trucco, S. Ivekovic, Image and Vision Computing
28(11), 2010, as the paper takes them over in Section 4.2.3 and Table 3.
"""

import math
from dataclasses import dataclass

import warp as wp

from mmocap_warp.kernels.optimizers import pso as kernels
from mmocap_warp.kernels.optimizers.populations import SearchSpace, make_population
from mmocap_warp.kernels.structs import filled
from mmocap_warp.optimizers.search import Optimizer


@dataclass(frozen=True)
class PsoConfig:
    """Settings of PSO; the defaults are Table 3."""

    population: int = 10  # N, particles of the swarm
    phi_1: float = 2.0  # greatest pull of a particle's own best position
    phi_2: float = 2.0  # greatest pull of the swarm's best position
    inertia_max: float = 2.0  # omega_max, the weight of the old velocity in the first move
    inertia_min: float = 0.1  # omega_min, the weight in the last move
    velocity_limit: float = 0.5  # greatest speed v_max in every dimension, in units of the search's radius

    def __post_init__(self) -> None:
        if self.population < 1:
            raise ValueError(f"population must be at least 1, got {self.population}")
        for name in ("phi_1", "phi_2"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be finite and not negative, got {getattr(self, name)}")
        for name in ("inertia_max", "inertia_min", "velocity_limit"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be positive and finite, got {getattr(self, name)}")
        if self.inertia_min > self.inertia_max:
            raise ValueError(f"inertia_min must not exceed inertia_max, got {self.inertia_min} > {self.inertia_max}")


class Pso(Optimizer):
    """PSO over a batch of runs; all state lives on the device.

    ``start`` scatters the swarm, normally about the start pose, which is itself no particle: positions are random as
    in the paper's Fig. 6, and a caller that wants the start judged does so before. ``tell`` remembers the best
    positions, everyone's own and the swarm's, and flies on; ``ask`` only hands out ``population`` (run, particle, dof).

    Of Eq. 19, g_max is the number of inertia changes between the first and the last move within the budget: the first
    move weighs the old velocity by ``inertia_max``, the last by ``inertia_min``.

    Args:
        space: its radius is the standard deviation of the first positions, and the unit of the velocity's limit.
        evaluations: budget over which the inertia falls, until ``plan`` tells another.
        config: settings.
    """

    def __init__(self, space: SearchSpace, evaluations: int, config: PsoConfig | None = None) -> None:
        self.config = config or PsoConfig()
        self.space = space
        self.particles = self.config.population
        settings = {name: getattr(self.config, name) for name in ("phi_1", "phi_2", "inertia_max", "velocity_limit")}
        fall = math.log(self.config.inertia_max / self.config.inertia_min)
        self._parameters = filled(kernels.PsoParameters, log_inertia_fall=fall, inertia_changes=1, **settings)
        self.plan(evaluations)
        self.population = make_population(space, self.particles)
        self.state = kernels.make_state(self.population)

    def plan(self, evaluations: int) -> list[int]:
        """Whole generations, the last one cut; the inertia falls over the moves between them."""
        sizes = super().plan(evaluations)
        moves = len(sizes) - 1
        self._parameters.inertia_changes = max(1, moves - 1)
        return sizes

    def start(self, pose: wp.array[wp.float32]) -> None:
        """Begin a search about ``pose`` (run, coordinate)."""
        kernels.start(self.space, self._parameters, pose, self.state)

    def ask(self, particles: int) -> wp.array[wp.float32]:
        """The swarm; it flew on when it was told."""
        return self.population

    def tell(self, cost: wp.array[wp.float32]) -> None:
        """Learn from the costs (candidate,) of the whole swarm, and fly on."""
        kernels.remember(cost, self.state)
        kernels.sample_factors(self.space, self.state)
        kernels.move(self.space, self._parameters, self.state)
