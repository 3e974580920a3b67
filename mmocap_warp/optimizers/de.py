"""Differential evolution with role differentiation and malleable mating, the paper's Fig. 5.

R. Storn, K. Price, J. Global Optimization 11, 1997; roles and mating: C. García-Martínez, F. J. Rodríguez, M. Lozano,
Soft Computing 15(11), 2011.
"""

from dataclasses import asdict, dataclass

import warp as wp

from mmocap_warp.kernels.optimizers import de as kernels
from mmocap_warp.kernels.optimizers.populations import SearchSpace, make_population
from mmocap_warp.kernels.structs import filled
from mmocap_warp.optimizers.search import Optimizer


@dataclass(frozen=True)
class DeConfig:
    """Settings of differential evolution; the defaults are Table 3.

    A role's set is what the sizes say less the members that Fig. 5 excludes; one that is left empty, as may be with
    few members, is used whole.
    """

    population: int = 10  # N, members
    placing: int = 5  # N_P, how many of the best a donor may be placed at
    leading: int = 5  # N_L, how many of the best it may be led to
    correcting: int = 5  # N_C, how many of the worst it may be led away from
    crossover: float = 0.9  # CR in [0, 1], chance of a coordinate to come from the donor; one always does
    factor: float = 0.5  # F in (0, 2], scale of the step from the placing member
    include_start: bool = True  # evaluate the start as one of the first population; otherwise all of it is random

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


class De(Optimizer):
    """Differential evolution over a batch of runs; all state lives on the device.

    It searches the box of the radius around the start. The first generation evaluates the first members, each
    later one a trial for every member; a generation that is cut to meet a budget is not told.

    Args:
        space: its radius is half the width of the box in each coordinate; 0 holds one fixed.
        evaluations: budget of a search; differential evolution does not depend on it.
        config: settings.
    """

    def __init__(self, space: SearchSpace, evaluations: int, config: DeConfig | None = None) -> None:
        self.config = config or DeConfig()
        self.space = space
        self.particles = self.config.population
        roles = {name: value for name, value in asdict(self.config).items() if name != "population"}
        self._parameters = filled(kernels.DeParameters, **roles)
        self.population = make_population(space, self.particles)
        self.state = kernels.make_state(self.population)

    def start(self, pose: wp.array[wp.float32]) -> None:
        """Begin a search around ``pose`` (run, coordinate)."""
        kernels.start(self.space, pose, self.state)

    def ask(self, particles: int) -> wp.array[wp.float32]:
        """Write the first ``particles`` of the first members, or of the next trials, into ``population``."""
        kernels.sample_uniform(self.space, particles, self.state)
        kernels.mate(self._parameters, particles, self.state)
        kernels.vary(self.space, self._parameters, particles, self.state)
        return self.population

    def tell(self, cost: wp.array[wp.float32]) -> None:
        """Select by the costs (candidate,) of a whole generation."""
        kernels.select(cost, self.state)
