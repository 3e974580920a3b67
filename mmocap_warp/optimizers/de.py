"""Differential evolution with role differentiation and malleable mating, the paper's Fig. 5.

R. Storn, K. Price, J. Global Optimization 11, 1997; roles and mating: C. García-Martínez, F. J. Rodríguez, M. Lozano,
Soft Computing 15(11), 2011.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmocap_warp.kernels.optimizers import de as kernels
from mmocap_warp.optimizers.protocol import whole_generations


@dataclass(frozen=True)
class DeConfig:
    """Settings of differential evolution; the defaults are Table 3.

    A role's set is what the sizes say less the members that Fig. 5 excludes; one that is left empty, as may be with
    few members, is used whole.

    Attributes:
        population: N, members.
        placing: N_P, how many of the best a donor may be placed at.
        leading: N_L, how many of the best it may be led to.
        correcting: N_C, how many of the worst it may be led away from.
        crossover: CR in [0, 1], chance of a coordinate to come from the donor; one always does.
        factor: F in (0, 2], scale of the step from the placing member.
        include_start: evaluate the start as one of the first population; otherwise all of it is random.
    """

    population: int = 10
    placing: int = 5
    leading: int = 5
    correcting: int = 5
    crossover: float = 0.9
    factor: float = 0.5
    include_start: bool = True

    def __post_init__(self) -> None:
        if self.population < 2:
            raise ValueError(f"population must be at least 2, got {self.population}")
        for role in ("placing", "leading", "correcting"):
            if not 1 <= getattr(self, role) <= self.population:
                raise ValueError(f"{role} must be in 1 .. population ({self.population}), got {getattr(self, role)}")
        if not 0.0 <= self.crossover <= 1.0:
            raise ValueError(f"crossover must be in [0, 1], got {self.crossover}")
        if not 0.0 < self.factor <= 2.0:
            raise ValueError(f"factor must be in (0, 2], got {self.factor}")


class De:
    """Differential evolution over a batch of runs; all state lives on the device.

    It searches the box of ``scale`` around the start. The first generation evaluates the first members, each later one
    a trial for every member; a generation that is cut to meet a budget is not told.

    Args:
        index: coordinates of the start vector that are searched, (dof,) int.
        scale: (dof,) half the width of the box in each of them; 0 holds one fixed.
        runs: independent runs.
        seed: (run,) int32 Warp array; run r's members depend on its seed and counter alone.
        draw: (run,) int32 Warp array of counters that drawing advances; optimizers of one search share it.
        evaluations: the search's budget; differential evolution does not depend on it.
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
        config: DeConfig | None = None,
    ) -> None:
        self.config = config or DeConfig()
        dofs, members, device = len(index), self.config.population, seed.device
        self.particles = members
        self.index = wp.array(index, dtype=wp.int32, device=device)
        self.scale = wp.array(scale, dtype=wp.float32, device=device)
        self._seed, self._draw = seed, draw
        self._constants = _constants(self.config)
        self.population = wp.zeros((runs, members, dofs), dtype=wp.float32, device=device)
        self.member = wp.zeros_like(self.population)
        self.member_cost = wp.zeros((runs, members), dtype=wp.float32, device=device)
        self.alpha = wp.zeros((runs, members), dtype=wp.vec2i, device=device)
        self._altered = wp.zeros_like(self.alpha)
        self._parents = wp.zeros((runs, members), dtype=wp.vec3i, device=device)
        self._order = wp.zeros((runs, members), dtype=wp.int32, device=device)
        self._center = wp.zeros((runs, dofs), dtype=wp.float32, device=device)
        self._generation = wp.zeros(runs, dtype=wp.int32, device=device)
        self._chance = wp.zeros((runs, members, dofs + kernels.CHANCES), dtype=wp.float32, device=device)

    def plan(self, evaluations: int) -> list[int]:
        """Whole generations, the last one cut."""
        return whole_generations(evaluations, self.particles)

    def start(self, pose: wp.array) -> None:
        """Begin a search around ``pose`` (run, coordinate)."""
        kernels.start(
            pose, self.index, self._center, self.member, self.member_cost, self.alpha, self._order, self._generation
        )

    def ask(self, particles: int) -> wp.array:
        """Write the first ``particles`` of the first members, or of the next trials, into ``population``."""
        kernels.draw_chances(self._seed, self._draw, particles, self._chance)
        kernels.mate(
            self._constants, self.member, self.alpha, self._order, self._chance, particles,
            self._parents, self._altered,
        )  # fmt: skip
        kernels.vary(
            self._constants, self._center, self.scale, self.member, self._parents, self._generation, self._chance,
            particles, self.population,
        )  # fmt: skip
        return self.population

    def tell(self, cost: wp.array) -> None:
        """Select by the costs (candidate,) of a whole generation."""
        kernels.select(
            cost, self.population, self._altered, self.member, self.member_cost, self.alpha,
            self._order, self._generation,
        )  # fmt: skip

    def estimate(self, pose: wp.array) -> None:
        """Write the best member; the start where no generation was told."""
        kernels.write_best(self.member, self._order, self.index, pose)


def _constants(config: DeConfig) -> kernels.DeConstants:
    constants = kernels.DeConstants()
    for name in ("placing", "leading", "correcting", "crossover", "factor", "include_start"):
        setattr(constants, name, getattr(config, name))
    return constants
