"""Particle swarm optimization: J. Kennedy, R. Eberhart, IEEE Int. Conf. on Neural Networks, 1995.

The inertia's exponential fall and the settings are those of V. John, E. Trucco, S. Ivekovic, Image and Vision Computing
28(11), 2010, as the paper takes them over in Section 4.2.3 and Table 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmocap_warp.kernels.optimizers import pso as kernels
from mmocap_warp.optimizers.protocol import whole_generations


@dataclass(frozen=True)
class PsoConfig:
    """Settings of PSO; the defaults are Table 3.

    Attributes:
        population: N, particles of the swarm.
        phi_1: greatest pull of a particle's own best position.
        phi_2: greatest pull of the swarm's best position.
        inertia_max: omega_max, the weight of the old velocity in the first move.
        inertia_min: omega_min, the weight in the last move.
        velocity_limit: greatest speed v_max in every dimension, in units of the search's ``scale``.
    """

    population: int = 10
    phi_1: float = 2.0
    phi_2: float = 2.0
    inertia_max: float = 2.0
    inertia_min: float = 0.1
    velocity_limit: float = 0.5

    def __post_init__(self) -> None:
        if self.population < 1:
            raise ValueError(f"population must be at least 1, got {self.population}")
        for name in ("phi_1", "phi_2"):
            value = getattr(self, name)
            if not (value >= 0.0 and math.isfinite(value)):
                raise ValueError(f"{name} must be finite and not negative, got {value}")
        for name in ("inertia_max", "inertia_min", "velocity_limit"):
            value = getattr(self, name)
            if not (value > 0.0 and math.isfinite(value)):
                raise ValueError(f"{name} must be positive and finite, got {value}")
        if self.inertia_min > self.inertia_max:
            raise ValueError(f"inertia_min must not exceed inertia_max, got {self.inertia_min} > {self.inertia_max}")


class Pso:
    """PSO over a batch of runs; all state lives on the device.

    ``start`` scatters the swarm, normally about the start pose, which is itself no particle: positions are random as
    in the paper's Fig. 6, and a caller that wants the start judged does so before. ``tell`` remembers the best
    positions, everyone's own and the swarm's, and flies on; ``ask`` only hands out ``population`` (run, particle, dof).

    Of Eq. 19, g_max is the number of inertia changes between the first and the last move within the budget: the first
    move weighs the old velocity by ``inertia_max``, the last by ``inertia_min``.

    Args:
        index: coordinates of the start vector that are searched, (dof,) int.
        scale: (dof,) standard deviation of the first positions, and unit of the velocity's limit.
        runs: independent runs.
        seed: (run,) int32 Warp array; run r's samples depend on its seed and counter alone.
        draw: (run,) int32 Warp array of counters that sampling advances; optimizers of one search share it.
        evaluations: the search's budget, over which the inertia falls.
        config: settings.
    """

    returns_best = True

    def __init__(
        self,
        index: np.ndarray,
        scale: np.ndarray,
        runs: int,
        seed: wp.array,
        draw: wp.array,
        evaluations: int,
        config: PsoConfig | None = None,
    ) -> None:
        self.config = config or PsoConfig()
        self.particles = self.config.population
        dofs, device = len(index), seed.device
        self.index = wp.array(index, dtype=wp.int32, device=device)
        self.scale = wp.array(scale, dtype=wp.float32, device=device)
        self._seed, self._draw = seed, draw
        self._constants = _constants(self.config, moves=len(self.plan(evaluations)) - 1)
        self.population = wp.zeros((runs, self.particles, dofs), dtype=wp.float32, device=device)
        self.velocity = wp.zeros_like(self.population)
        self.own_best = wp.zeros_like(self.population)
        self._r_1 = wp.zeros_like(self.population)
        self._r_2 = wp.zeros_like(self.population)
        self.own_cost = wp.zeros((runs, self.particles), dtype=wp.float32, device=device)
        self.inertia = wp.zeros(runs, dtype=wp.float32, device=device)
        self.leader = wp.zeros(runs, dtype=wp.int32, device=device)
        self._generation = wp.zeros_like(self.leader)

    def plan(self, evaluations: int) -> list[int]:
        """Whole generations, the last one cut."""
        return whole_generations(evaluations, self.particles)

    def start(self, pose: wp.array) -> None:
        """Begin a search about ``pose`` (run, coordinate)."""
        kernels.start(
            self._constants, self._seed, self._draw, pose, self.index, self.scale,
            self.population, self.velocity, self.own_best, self.own_cost, self._generation, self.leader,
        )  # fmt: skip

    def ask(self, particles: int) -> wp.array:
        """The swarm; it flew on when it was told."""
        return self.population

    def tell(self, cost: wp.array) -> None:
        """Learn from the costs (candidate,) of the whole swarm, and fly on."""
        kernels.remember(cost, self.population, self.own_best, self.own_cost, self._generation, self.leader)
        kernels.draw_uniform(self._seed, self._draw, self._r_1, self._r_2)
        kernels.move(
            self._constants, self.scale, self._generation, self.own_best, self.leader, self._r_1, self._r_2,
            self.population, self.velocity, self.inertia,
        )  # fmt: skip

    def estimate(self, pose: wp.array) -> None:
        """Write the swarm's best position."""
        kernels.take_best(self.own_best, self.leader, self.index, pose)


def _constants(config: PsoConfig, moves: int) -> kernels.PsoConstants:
    constants = kernels.PsoConstants()
    for name in ("phi_1", "phi_2", "inertia_max", "velocity_limit"):
        setattr(constants, name, getattr(config, name))
    constants.log_inertia_fall = math.log(config.inertia_max / config.inertia_min)
    constants.inertia_changes = max(1, moves - 1)
    return constants
