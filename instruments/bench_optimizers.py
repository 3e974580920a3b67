"""The CMA-ES of other packages beside ours, on the CPU in the same process: a generation, and searches of functions.

Ours decomposes C in every generation, and so do evosax and cmaes; cma waits for as many as it thinks C needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
import warp as wp
from bench_searches import minimises_sphere

from mmocap_warp.bench.report_file import ASK_AND_TELL, FUNCTION, OURS
from mmocap_warp.kernels.benchmarks.timing import Case, Check
from mmocap_warp.kernels.optimizers.populations import make_space
from mmocap_warp.optimizers.cma_es import CmaEs, CmaEsConfig, CmaEsParameters

_DOFS = 39  # of a generation that is timed
_FUNCTION_DOFS, _GENERATIONS = 10, 200  # of a search of a function
_SIGMA = 0.5


class Engine(Protocol):
    """Independent runs of a CMA-ES, used as its package would have it."""

    def begin(self) -> None:
        """Begin anew where all coordinates are 1."""

    def ask(self) -> np.ndarray:
        """Sample a generation (run, particle, dof)."""

    def tell(self, cost: np.ndarray) -> None:
        """Learn from its costs (run, particle) float32."""

    def generation(self, cost: np.ndarray) -> Callable[[], None]:
        """What asks and tells, with costs that were made up."""

        def once() -> None:
            self.ask()
            self.tell(cost)

        return once


class _Ours(Engine):
    def __init__(self, dofs: int, particles: int, runs: int) -> None:
        seed = wp.array(np.arange(runs), dtype=wp.int32, device="cpu")
        self._counter = wp.zeros(runs, dtype=wp.int32, device="cpu")
        space = make_space(np.arange(dofs), np.ones(dofs), seed, self._counter)
        self._optimizer = CmaEs(space, 1, CmaEsConfig(population=particles, sigma=_SIGMA))
        self._start = wp.ones((runs, dofs), dtype=wp.float32, device="cpu")
        self._cost = wp.zeros(runs * particles, dtype=wp.float32, device="cpu")

    def begin(self) -> None:
        self._counter.zero_()
        self._optimizer.start(self._start)

    def ask(self) -> np.ndarray:
        return self._optimizer.ask(self._optimizer.particles).numpy()

    def tell(self, cost: np.ndarray) -> None:
        self._cost.numpy()[:] = cost.ravel()
        self._optimizer.tell(self._cost)


class _Evosax(Engine):
    """Compiled by JAX: one run as it is, several as one ``vmap``; asking and telling in one go where none looks."""

    def __init__(self, dofs: int, particles: int, runs: int) -> None:
        import jax
        import jax.numpy as jnp
        from evosax.algorithms import CMA_ES

        algorithm = CMA_ES(population_size=particles, solution=jnp.zeros(dofs))
        parameters = algorithm.default_params.replace(std_init=jnp.asarray(_SIGMA))

        def begin(key: jax.Array) -> Any:
            return algorithm.init(key, jnp.ones(dofs), parameters)

        def ask(key: jax.Array, state: Any) -> Any:
            return algorithm.ask(key, state, parameters)

        def tell(key: jax.Array, state: Any, x: jax.Array, cost: jax.Array) -> Any:
            return algorithm.tell(key, x, cost, state, parameters)[0]

        def step(key: jax.Array, state: Any, cost: jax.Array) -> Any:
            x, state = ask(key, state)
            return tell(key, state, x, cost)

        functions = (begin, ask, tell, step) if runs == 1 else map(jax.vmap, (begin, ask, tell, step))
        self._begin, self._ask, self._tell, self._step = map(jax.jit, functions)
        self._wait, self._put = jax.block_until_ready, partial(jax.device_put, device=jax.devices("cpu")[0])
        keys = (jax.random.split(jax.random.key(generation), runs) for generation in range(_GENERATIONS))
        self._keys, self._runs = [self._put(key[0] if runs == 1 else key) for key in keys], runs

    def begin(self) -> None:
        self._generation, self._state = 0, self._begin(self._keys[0])

    def _key(self, ahead: int = 1) -> Any:
        self._generation += ahead
        return self._keys[self._generation % _GENERATIONS]

    def ask(self) -> np.ndarray:
        self._x, self._state = self._ask(self._key(), self._state)
        return np.asarray(self._x).reshape(self._runs, *self._x.shape[-2:])

    def tell(self, cost: np.ndarray) -> None:
        self._state = self._tell(self._key(0), self._state, self._x, cost.reshape(self._x.shape[:-1]))

    def generation(self, cost: np.ndarray) -> Callable[[], None]:
        given = self._put(cost[0] if self._runs == 1 else cost)

        def step() -> None:
            self._state = self._wait(self._step(self._key(), self._state, given))

        return step


class _OnePerRun(Engine):
    """A package whose optimizer is of one run: ``make`` gives what asks and what tells, anew for each run."""

    def __init__(self, make: Callable[[int, int, int], tuple[Callable, Callable]], *sizes: int) -> None:
        dofs, particles, runs = sizes
        self._makers = [partial(make, dofs, particles, run) for run in range(runs)]

    def begin(self) -> None:
        self._engines = [make() for make in self._makers]

    def ask(self) -> np.ndarray:
        self._x = [ask() for ask, _ in self._engines]
        return np.array(self._x)

    def tell(self, cost: np.ndarray) -> None:
        for (_, tell), x, costs in zip(self._engines, self._x, cost.tolist(), strict=True):
            tell(x, costs)


def _cmaes(dofs: int, particles: int, run: int) -> tuple[Callable, Callable]:
    from cmaes import CMA

    engine = CMA(np.ones(dofs), _SIGMA, population_size=particles, seed=run)
    return lambda: [engine.ask() for _ in range(particles)], lambda x, cost: engine.tell([*zip(x, cost, strict=True)])


def _cma(dofs: int, particles: int, run: int) -> tuple[Callable, Callable]:
    from cma import CMAEvolutionStrategy

    engine = CMAEvolutionStrategy(np.ones(dofs), _SIGMA, {"popsize": particles, "verbose": -9, "seed": 1 + run})
    return engine.ask, engine.tell


ENGINES: dict[str, Callable[[int, int, int], Engine]] = {
    OURS: _Ours, "evosax": _Evosax, "cmaes": partial(_OnePerRun, _cmaes), "cma": partial(_OnePerRun, _cma),
}  # fmt: skip
"""Engines, made from numbers of dofs, particles and runs; ours is the first."""


def sphere(x: np.ndarray) -> np.ndarray:
    """Costs of points (..., dof); 0 at 0."""
    return np.sum(x**2, axis=-1)


def rosenbrock(x: np.ndarray) -> np.ndarray:
    """A bent valley; 0 where all coordinates are 2, and so moved by 1: engines start where they are 1."""
    x = x - 1.0
    return np.sum(100.0 * (x[..., 1:] - x[..., :-1] ** 2) ** 2 + (1.0 - x[..., :-1]) ** 2, axis=-1)


def rastrigin(x: np.ndarray) -> np.ndarray:
    """Many minima; 0 at 0, and about 1 more for each coordinate that ends in the next one."""
    return np.sum(x**2 + 10.0 * (1.0 - np.cos(2.0 * np.pi * x)), axis=-1)


FUNCTIONS = {"sphere": (sphere, 1e-4), "Rosenbrock": (rosenbrock, 8.9), "Rastrigin": (rastrigin, 30.0)}
"""Functions, and the cost below which a search of them must come: one that never learns stays above."""


def optimizer_peers(names: Sequence[str], runs: Sequence[int]) -> Iterator[list[Case]]:
    """The named peers and ours, taking turns."""
    if not ENGINES.keys() & set(names):
        return
    wanted = [name for name in ENGINES if name in names or name == OURS]
    for number in runs:
        yield [_ask_and_tell(name, number) for name in wanted]
    for function in FUNCTIONS:
        yield [_search(name, function) for name in wanted]


def _ask_and_tell(name: str, runs: int) -> Case:
    particles = CmaEsParameters.for_search(_DOFS).population
    engine = ENGINES[name](_DOFS, particles, runs)
    engine.begin()
    made_up = np.random.default_rng(0).uniform(0.1, 0.9, (runs, particles)).astype(np.float32)

    def check() -> Check:
        engine.begin()
        return minimises_sphere(
            engine.ask, lambda cost: engine.tell(cost.astype(np.float32)), sphere, _GENERATIONS, 0.1
        )

    sizes = {"dof": _DOFS, "particles": particles, "runs": runs}
    return Case(ASK_AND_TELL, name, sizes, engine.generation(made_up), check)


def _search(name: str, function: str) -> Case:
    particles = CmaEsParameters.for_search(_FUNCTION_DOFS).population
    costs_of, allowed = FUNCTIONS[function]
    engine = ENGINES[name](_FUNCTION_DOFS, particles, 1)
    lowest = [np.inf]

    def work() -> None:
        engine.begin()
        lowest[0] = np.inf
        for _ in range(_GENERATIONS):
            cost = costs_of(engine.ask())
            lowest[0] = min(lowest[0], float(cost.min()))
            engine.tell(cost.astype(np.float32))

    def check() -> Check:
        return Check(f"{function}'s cost falls to {lowest[0]:.2g}, allowed {allowed:g}", lowest[0] < allowed)

    sizes = {"function": function, "dof": _FUNCTION_DOFS, "particles": particles, "generations": _GENERATIONS}
    return Case(FUNCTION, name, sizes, work, check, _GENERATIONS * particles)
