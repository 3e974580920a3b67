"""CMA-ES: N. Hansen, A. Ostermeier, Evolutionary Computation 9(2), 2001, with the parameters of the paper's Table 2."""

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import warp as wp

from mmocap_warp.kernels.optimizers import cma_es as kernels
from mmocap_warp.kernels.optimizers import cma_es_learning as learning
from mmocap_warp.kernels.optimizers.populations import SearchSpace, make_population
from mmocap_warp.kernels.structs import allocated
from mmocap_warp.optimizers.search import Optimizer


@dataclass(frozen=True)
class CmaEsConfig:
    """Settings of CMA-ES; the defaults are Table 2."""

    population: int | None = None  # lambda, offspring a generation; None is ``4 + floor(3 ln D)``
    sigma: float = 1.0  # initial step size, in units of the search's radius

    def __post_init__(self) -> None:
        if self.population is not None and self.population < 2:
            raise ValueError(f"population must be at least 2, got {self.population}")
        if not (self.sigma > 0.0 and math.isfinite(self.sigma)):
            raise ValueError(f"sigma must be positive and finite, got {self.sigma}")


@dataclass(frozen=True)
class CmaEsParameters:
    """Table 2 of the paper: the strategy's parameters for a search in ``dofs`` dimensions."""

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
    def for_search(cls, dofs: int, population: int | None = None) -> Self:
        """The parameters for ``dofs`` dimensions, with Table 2's population unless one is given."""
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


class CmaEs(Optimizer):
    """CMA-ES over a batch of runs; all state lives on the device.

    ``start`` begins a search, then ``ask`` fills ``population`` (run, particle, dof) and ``tell`` learns from its
    costs (candidate = run * particles + particle). A generation may be asked for fewer particles to meet a budget;
    such a cut generation is not told.

    Args:
        space: its radius is the unit of the step size.
        evaluations: budget of a search; CMA-ES does not depend on it.
        config: settings.
    """

    def __init__(self, space: SearchSpace, evaluations: int, config: CmaEsConfig | None = None) -> None:
        self.config = config or CmaEsConfig()
        self.space = space
        self.parameters = CmaEsParameters.for_search(space.index.size, self.config.population)
        self.particles = self.parameters.population
        self._device_parameters = _device_parameters(self.parameters, space.seed.device)
        self.population = make_population(space, self.particles)
        self.state = kernels.make_state(self.population)

    def start(self, pose: wp.array[wp.float32]) -> None:
        """Begin a search at ``pose`` (run, coordinate)."""
        kernels.start(self.space, pose, self.config.sigma, self.state)

    def ask(self, particles: int) -> wp.array[wp.float32]:
        """Sample the first ``particles`` of the next generation into ``population``."""
        kernels.sample(self.space, particles, self.state)
        return self.population

    def tell(self, cost: wp.array[wp.float32]) -> None:
        """Learn from the costs (candidate,) of a whole generation."""
        learning.update(self.space, self._device_parameters, cost, self.state)


def _device_parameters(parameters: CmaEsParameters, device: wp.DeviceLike) -> Any:
    dofs = parameters.dofs
    names = ("mu", "mu_eff", "c_sigma", "d_sigma", "c_c", "c_cov", "mu_cov")
    values = {name: getattr(parameters, name) for name in names}
    values["chi_n"] = math.sqrt(dofs) * (1 - 1 / (4 * dofs) + 1 / (21 * dofs**2))
    values["flat_rank"] = math.ceil(0.7 * parameters.population) - 1
    return allocated(learning.CmaEsParameters, device, weight=parameters.weights, **values)
