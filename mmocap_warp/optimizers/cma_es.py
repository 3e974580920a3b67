"""CMA-ES: N. Hansen, A. Ostermeier, Evolutionary Computation 9(2), 2001, with the constants of the paper's Table 2."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmocap_warp.kernels.optimizers import cma_es as kernels
from mmocap_warp.kernels.optimizers.populations import scatter
from mmocap_warp.optimizers.protocol import whole_generations


@dataclass(frozen=True)
class CmaEsConfig:
    """Settings of CMA-ES; the defaults are Table 2.

    Attributes:
        population: lambda, offspring a generation; None is ``4 + floor(3 ln D)``.
        sigma: initial step size, in units of the search's ``scale``.
    """

    population: int | None = None
    sigma: float = 1.0

    def __post_init__(self) -> None:
        if self.population is not None and self.population < 2:
            raise ValueError(f"population must be at least 2, got {self.population}")
        if not (self.sigma > 0.0 and math.isfinite(self.sigma)):
            raise ValueError(f"sigma must be positive and finite, got {self.sigma}")


@dataclass(frozen=True)
class CmaEsTable:
    """Table 2 of the paper: the strategy's constants for a search in ``dofs`` dimensions."""

    dofs: int
    population: int
    mu: int
    weights: np.ndarray
    mu_eff: float
    c_sigma: float
    d_sigma: float
    c_c: float
    c_cov: float
    mu_cov: float

    @classmethod
    def for_search(cls, dofs: int, population: int | None = None) -> CmaEsTable:
        """The constants for ``dofs`` dimensions, with Table 2's population unless one is given."""
        lam = population or 4 + math.floor(3 * math.log(dofs))
        mu = lam // 2
        raw = math.log(mu + 1) - np.log(np.arange(1, mu + 1))
        weights = raw / raw.sum()
        mu_eff = 1.0 / float(np.sum(weights**2))
        c_sigma = (mu_eff + 2) / (dofs + mu_eff + 3)
        d_sigma = 1 + 2 * max(0.0, math.sqrt(max(0.0, (mu_eff - 1) / (dofs + 1))) - 1) + c_sigma
        mu_cov = mu_eff
        c_cov = (1 / mu_cov) * 2 / (dofs + math.sqrt(2)) ** 2
        c_cov += (1 - 1 / mu_cov) * min(1.0, (2 * mu_eff - 1) / ((dofs + 2) ** 2 + mu_eff))
        return cls(dofs, lam, mu, weights, mu_eff, c_sigma, d_sigma, 4 / (dofs + 4), c_cov, mu_cov)


class CmaEs:
    """CMA-ES over a batch of runs; all state lives on the device.

    ``start`` begins a search, then ``ask`` fills ``population`` (run, particle, dof) and ``tell`` learns from its
    costs (candidate = run * particles + particle). A generation may be asked for fewer particles to meet a budget;
    such a cut generation is not told.

    Args:
        index: coordinates of the start vector that are searched, (dof,) int.
        scale: (dof,) unit of the step size for each of them.
        runs: independent runs.
        seed: (run,) int32 Warp array; run r's samples depend on its seed and counter alone.
        draw: (run,) int32 Warp array of counters that sampling advances; optimizers of one search share it.
        evaluations: the search's budget; CMA-ES does not depend on it.
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
        config: CmaEsConfig | None = None,
    ) -> None:
        self.config = config or CmaEsConfig()
        self.table = CmaEsTable.for_search(len(index), self.config.population)
        dofs, lam, device = len(index), self.table.population, seed.device
        self.particles = lam
        self.index = wp.array(index, dtype=wp.int32, device=device)
        self.scale = wp.array(scale, dtype=wp.float32, device=device)
        self._seed, self._draw = seed, draw
        self._weight = wp.array(self.table.weights, dtype=wp.float32, device=device)
        self._constants = _constants(self.table)
        self.population = wp.zeros((runs, lam, dofs), dtype=wp.float32, device=device)
        self.mean = wp.zeros((runs, dofs), dtype=wp.float32, device=device)
        self.sigma = wp.zeros(runs, dtype=wp.float32, device=device)
        self.p_sigma = wp.zeros_like(self.mean)
        self.p_c = wp.zeros_like(self.mean)
        self.axes = wp.zeros((runs, dofs, dofs), dtype=wp.float32, device=device)
        self.lengths = wp.zeros_like(self.mean)
        self.generation = wp.zeros(runs, dtype=wp.int32, device=device)
        self._z = wp.zeros_like(self.population)
        self._order = wp.zeros((runs, lam), dtype=wp.int32, device=device)
        self._scratch = kernels.scratch(runs, dofs, device)
        self._state = kernels.CmaEsState()
        for name in ("mean", "sigma", "p_sigma", "p_c", "axes", "lengths", "generation"):
            setattr(self._state, name, getattr(self, name))

    def plan(self, evaluations: int) -> list[int]:
        """Whole generations, the last one cut."""
        return whole_generations(evaluations, self.particles)

    def start(self, pose: wp.array) -> None:
        """Begin a search at ``pose`` (run, coordinate)."""
        kernels.start(pose, self.index, self.config.sigma, self._state)

    def ask(self, particles: int) -> wp.array:
        """Sample the first ``particles`` of the next generation into ``population``."""
        kernels.sample(self._seed, self._draw, self._state, self.scale, particles, self._z, self.population)
        return self.population

    def tell(self, cost: wp.array) -> None:
        """Learn from the costs (candidate,) of a whole generation."""
        seen = kernels.Generation()
        seen.cost, seen.z, seen.weight, seen.scale, seen.order = cost, self._z, self._weight, self.scale, self._order
        kernels.update(self._constants, seen, self._scratch, self._state)

    def estimate(self, pose: wp.array) -> None:
        """Write the mean of the search distribution."""
        scatter(self.mean, self.index, pose)


def _constants(table: CmaEsTable) -> kernels.CmaEsConstants:
    constants = kernels.CmaEsConstants()
    for name in ("mu", "mu_eff", "c_sigma", "d_sigma", "c_c", "c_cov", "mu_cov"):
        setattr(constants, name, getattr(table, name))
    dofs = table.dofs
    constants.chi_n = math.sqrt(dofs) * (1 - 1 / (4 * dofs) + 1 / (21 * dofs**2))
    constants.flat_rank = math.ceil(0.7 * table.population) - 1
    return constants
