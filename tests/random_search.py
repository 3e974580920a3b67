"""A ninth optimizer from outside the package: normal samples about the best point so far, as a class and a name."""

from dataclasses import dataclass

import warp as wp

from mmocap_warp.kernels.optimizers.populations import SearchSpace, advance, make_population, random_stream, scatter
from mmocap_warp.optimizers.search import Optimizer
from mmocap_warp.tracking.algorithms import ALGORITHMS, Algorithm


@wp.struct
class RandomSearchState:
    x: wp.array3d[wp.float32]  # (run, particle, dof)
    center: wp.array2d[wp.float32]  # (run, dof)
    lowest: wp.array[wp.float32]  # (run,)
    step: wp.array[wp.float32]  # (run,)


@wp.kernel
def _start(space: SearchSpace, pose: wp.array2d[wp.float32], state: RandomSearchState):
    run = wp.tid()
    state.lowest[run] = wp.inf
    state.step[run] = 1.0
    for i in range(space.index.shape[0]):
        state.center[run, i] = pose[run, space.index[i]]


@wp.kernel
def _sample(space: SearchSpace, state: RandomSearchState):
    run, k = wp.tid()
    random = random_stream(space, run, k)  # every candidate has its own
    for i in range(space.radius.shape[0]):
        state.x[run, k, i] = state.center[run, i] + state.step[run] * space.radius[i] * wp.randn(random)


@wp.kernel
def _learn(cost: wp.array[wp.float32], state: RandomSearchState):
    run = wp.tid()
    particles = state.x.shape[1]
    winner = wp.int32(-1)
    for k in range(particles):
        if cost[run * particles + k] < state.lowest[run]:
            state.lowest[run] = cost[run * particles + k]
            winner = k
    if winner < 0:
        state.step[run] = 0.5 * state.step[run]
    else:
        for i in range(state.x.shape[2]):
            state.center[run, i] = state.x[run, winner, i]


@dataclass(frozen=True)
class RandomSearchConfig:
    """Settings.

    Attributes:
        population: samples of a generation.
    """

    population: int = 20

    def __post_init__(self):
        if self.population < 1:
            raise ValueError(f"population must be at least 1, got {self.population}")


class RandomSearch:
    """Random search over a batch of runs; all state lives on the device."""

    returns_best = True
    memory = ()
    plan = Optimizer.plan

    def __init__(self, space, evaluations, config=None):
        self.space = space
        self.particles = (config or RandomSearchConfig()).population
        self.population = make_population(space, self.particles)
        runs, dofs, self._device = len(space.seed), len(space.index), space.seed.device
        self.state = RandomSearchState()
        self.state.x = self.population
        self.state.center = wp.zeros((runs, dofs), dtype=wp.float32, device=self._device)
        self.state.lowest = wp.zeros(runs, dtype=wp.float32, device=self._device)
        self.state.step = wp.zeros(runs, dtype=wp.float32, device=self._device)

    def start(self, pose):
        wp.launch(_start, len(self.space.seed), inputs=[self.space, pose, self.state], device=self._device)

    def ask(self, particles):
        wp.launch(_sample, (len(self.space.seed), particles), inputs=[self.space, self.state], device=self._device)
        advance(self.space.counter, particles)
        return self.population

    def tell(self, cost):
        wp.launch(_learn, len(self.space.seed), inputs=[cost, self.state], device=self._device)

    def estimate(self, pose):
        scatter(self.state.center, self.space.index, pose)


ALGORITHMS["h-random"] = Algorithm(RandomSearch, "H-RANDOM", hierarchical=True)
