"""Median costs of the optimizers on standard functions, beside other packages' at equal evaluations.

    OPENBLAS_NUM_THREADS=1 python docs/benchmarks/optimizers.py > docs/benchmarks/optimizers.txt

It needs the packages of the extra ``test`` and takes about two minutes on one core; more threads would slow NumPy down.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product

import cmaes
import numpy as np
import warp as wp
from scipy.optimize import differential_evolution
from scipy.stats import mannwhitneyu

from mmocap_warp.optimizers.annealed_filter import AnnealedFilter
from mmocap_warp.optimizers.cma_es import CmaEs, CmaEsParameters
from mmocap_warp.optimizers.de import De, DeConfig
from mmocap_warp.optimizers.minimize import minimize
from mmocap_warp.optimizers.pso import Pso
from mmocap_warp.versions import package_versions

BUDGETS = (500, 1500, 3000)
DIMENSIONS = (10, 39)
RUNS = 30
SOLVED = 1e-8  # lower costs count as this one: single precision ends there, and so does the COCO platform's target
LEVEL = 0.05
FUNCTIONS = ("sphere", "ellipsoid", "Rosenbrock", "Rastrigin")
SCALE = {"Rosenbrock": 2.048, "Rastrigin": 5.12}  # half the width of their usual boxes; here every box is [-1, 1]

OURS: dict[str, Callable] = {
    "CMA-ES": CmaEs,
    "DE, Table 3": De,
    "DE, N = 30": partial(De, config=DeConfig(population=30, placing=15, leading=15, correcting=15)),
    "DE, open roles": partial(De, config=DeConfig(placing=2, leading=10, correcting=10, crossover=0.7, factor=0.75)),
    "PSO": Pso,
    "APF": AnnealedFilter,
}
Pair = tuple[str, str]  # ours and another's
TABLES: dict[str, list[str | Pair]] = {  # columns: medians by name, and verdicts on pairs
    "CMA-ES": ["CMA-ES", "cmaes, Table 2", ("CMA-ES", "cmaes, Table 2"), "cmaes", ("CMA-ES", "cmaes")],
    "Differential evolution, N = 10": [
        "SciPy, N = 10",
        "DE, Table 3",
        ("DE, Table 3", "SciPy, N = 10"),
        "DE, open roles",
        ("DE, open roles", "SciPy, N = 10"),
    ],
    "Differential evolution, N = 30": ["SciPy, N = 30", "DE, N = 30", ("DE, N = 30", "SciPy, N = 30")],
    "PSO and APF": ["PSO", "APF"],
}

INTRODUCTION = """# Optimizers on standard functions

Made by `OPENBLAS_NUM_THREADS=1 python docs/benchmarks/optimizers.py > docs/benchmarks/optimizers.txt`;
docs/algorithms.md says what follows from it.

Every run starts at 0 with radius 1 in each coordinate, without bounds. The minimum is 0, at a point that is drawn once
for each function from [-0.8, 0.8]^D. The ellipsoid's axes are the coordinates', its condition number is 10^6;
Rosenbrock's function is scaled by 2.048 and Rastrigin's by 5.12, so that their usual boxes are [-1, 1]^D.

- CMA-ES and the package `cmaes` begin with step size 1 and have the same population size. `cmaes` is as it comes,
  `cmaes, Table 2` has the paper's constants set from outside.
- DE and SciPy's `differential_evolution` begin with the same population: the start and N - 1 uniform points of the box
  [-1, 1]^D. SciPy's is otherwise as it comes (`best1bin`, immediate updates), but neither polishes nor stops early.
  `Table 3` is the paper's setting: N = 10, role sets of 5, CR = 0.9, F = 0.5. `N = 30` has role sets of 15. In `open
  roles` the best two of N = 10 place, all lead and correct, CR = 0.7, F = 0.75.
- PSO and APF have no counterpart. APF's answer is an estimate, the others' the best point that was evaluated.

A figure is the median over {runs} runs of the cost at the answer, in double precision; what is lower than {solved:.0e}
counts as that. *better*, *same* and *worse* are ours against the nearest of others to the left: two-sided Mann-Whitney
test on {runs} and {runs} costs, at the {level:.0%} level by Holm's procedure over all {comparisons} comparisons.
"""


@wp.kernel
def _evaluate(
    function: int,  # place in FUNCTIONS
    scale: float,
    x: wp.array2d[wp.float32],  # (candidate, coordinate)
    minimum: wp.array[wp.float32],  # (coordinate,)
    # out
    cost: wp.array[wp.float32],  # (candidate,)
):
    c = wp.tid()
    dofs = x.shape[1]
    total = wp.float32(0.0)
    for i in range(dofs):
        z = scale * (x[c, i] - minimum[i])
        if function == 0:
            total += z * z
        elif function == 1:
            total += wp.pow(1.0e6, float(i) / float(dofs - 1)) * z * z
        elif function == 2:
            if i + 1 < dofs:
                following = scale * (x[c, i + 1] - minimum[i + 1])
                valley = following + 1.0 - (z + 1.0) * (z + 1.0)
                total += 100.0 * valley * valley + z * z
        else:
            total += z * z + 10.0 * (1.0 - wp.cos(2.0 * wp.PI * z))
    cost[c] = total


class Problem:
    """A function to minimise, on the host and on the device."""

    def __init__(self, function: str, dofs: int) -> None:
        self.function, self.dofs = function, dofs
        kind = FUNCTIONS.index(function)
        self._scale = SCALE.get(function, 1.0)
        self._minimum = np.random.default_rng([kind, dofs]).uniform(-0.8, 0.8, dofs).astype(np.float32)
        self._given = [kind, self._scale], wp.array(self._minimum)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Costs of points (..., coordinate), in double precision."""
        z = self._scale * (x - self._minimum.astype(float))
        if self.function == "sphere":
            return np.sum(z**2, axis=-1)
        if self.function == "ellipsoid":
            return np.sum(1e6 ** np.linspace(0, 1, self.dofs) * z**2, axis=-1)
        if self.function == "Rosenbrock":
            z = z + 1
            return np.sum(100 * (z[..., 1:] - z[..., :-1] ** 2) ** 2 + (1 - z[..., :-1]) ** 2, axis=-1)
        return np.sum(z**2 + 10 * (1 - np.cos(2 * np.pi * z)), axis=-1)

    def on_device(self, x: wp.array, out: wp.array) -> None:
        """Fill ``out`` (candidate,) with the costs of ``x`` (candidate, coordinate)."""
        settings, minimum = self._given
        wp.launch(_evaluate, dim=out.shape, inputs=[*settings, x, minimum], outputs=[out])


class Trace:
    """A problem that remembers the lowest cost at each budget."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self._costs = problem, []

    def __call__(self, x: np.ndarray) -> float:
        """Cost of a point."""
        self._costs.append(float(self._problem(x)))
        return self._costs[-1]

    def __len__(self) -> int:
        return len(self._costs)

    @property
    def lowest(self) -> list[float]:
        """Lowest cost at each budget."""
        return [min(self._costs[:budget]) for budget in BUDGETS]


def by_cmaes(problem: Problem, seed: int, table_2: bool = False) -> list[float]:
    """One run of the package ``cmaes``; lowest cost at each budget."""
    trace, search = Trace(problem), cmaes.CMA(mean=np.zeros(problem.dofs), sigma=1.0, seed=seed)
    if table_2:
        _take_parameters(search, CmaEsParameters.for_search(problem.dofs))
    while len(trace) < BUDGETS[-1]:
        points = [search.ask() for _ in range(search.population_size)]
        search.tell([(x, trace(x)) for x in points])
    return trace.lowest


def _take_parameters(search: cmaes.CMA, ours: CmaEsParameters) -> None:
    """Give the package the paper's parameters: no negative weights, rank-one and rank-mu rates from one ``c_cov``."""
    search._weights = np.concatenate([ours.weights, np.zeros(ours.population - ours.mu)])
    search._mu, search._mu_eff = ours.mu, ours.mu_eff
    search._c_sigma, search._d_sigma, search._cc = ours.c_sigma, ours.d_sigma, ours.c_c
    search._c1, search._cmu = ours.c_cov / ours.mu_cov, ours.c_cov * (1 - 1 / ours.mu_cov)


def by_scipy(problem: Problem, seed: int, members: int) -> list[float]:
    """One run of SciPy's differential evolution; lowest cost at each budget."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(-1, 1, (members, problem.dofs))
    first[0] = 0.0
    trace, generations = Trace(problem), BUDGETS[-1] // members - 1
    differential_evolution(
        trace, [(-1, 1)] * problem.dofs, init=first, maxiter=generations, tol=0, polish=False, rng=rng
    )  # fmt: skip
    return trace.lowest


OTHERS: dict[str, Callable[[Problem, int], list[float]]] = {
    "cmaes": by_cmaes,
    "cmaes, Table 2": partial(by_cmaes, table_2=True),
    "SciPy, N = 10": partial(by_scipy, members=10),
    "SciPy, N = 30": partial(by_scipy, members=30),
}


def by_us(problem: Problem, optimizer: Callable) -> np.ndarray:
    """Costs of the answers (budget, run)."""
    start = np.zeros(problem.dofs)
    costs = []
    for budget in BUDGETS:
        found = minimize(problem.on_device, start, 1.0, budget, optimizer=optimizer, runs=RUNS)
        exact = problem(found.x.astype(float))
        np.testing.assert_allclose(found.cost, exact, rtol=1e-3, atol=SOLVED)  # both forms are the same function
        costs.append(exact)
    return np.array(costs)


def measure(problem: Problem) -> dict[str, np.ndarray]:
    """Costs (budget, run) by column."""
    columns = {name: by_us(problem, optimizer) for name, optimizer in OURS.items()}
    for name, run in OTHERS.items():
        columns[name] = np.array([run(problem, seed) for seed in range(RUNS)]).T
    return {name: np.maximum(costs, SOLVED) for name, costs in columns.items()}


@dataclass(frozen=True)
class Comparison:
    """Ours beside another's: how likely so large a difference is by chance, and its sign."""

    p: float
    lower: bool


def compare(ours: np.ndarray, theirs: np.ndarray) -> Comparison:
    """Two-sided Mann-Whitney test."""
    if np.ptp([ours, theirs]) == 0:
        return Comparison(1.0, False)
    test = mannwhitneyu(ours, theirs, alternative="two-sided")
    return Comparison(test.pvalue, test.statistic < len(ours) * len(theirs) / 2)


def verdicts(comparisons: dict[tuple, Comparison]) -> dict[tuple, str]:
    """Holm's procedure: from the least likely on, until one is not significant."""
    answer = dict.fromkeys(comparisons, "same")
    for rank, key in enumerate(sorted(comparisons, key=lambda key: comparisons[key].p)):
        if comparisons[key].p > LEVEL / (len(comparisons) - rank):
            break
        answer[key] = "better" if comparisons[key].lower else "worse"
    return answer


def table(columns: list[str | Pair], cell: Callable[..., str]) -> Iterator[str]:
    """Lines of a table with a row for every function, number of dimensions and budget (by place)."""
    names = [name if isinstance(name, str) else f"{name[0]} is" for name in columns]
    yield f"| function | D | evaluations | {' | '.join(names)} |"
    yield "|---" * (3 + len(columns)) + "|"
    for function, dofs in product(FUNCTIONS, DIMENSIONS):
        for b, budget in enumerate(BUDGETS):
            cells = [cell(column, function, dofs, b) for column in columns]
            yield f"| {function} | {dofs} | {budget} | {' | '.join(cells)} |"


def machine() -> str:
    """What the figures were measured with."""
    known = package_versions(("warp-lang", "numpy", "scipy", "cmaes"))
    packages = ", ".join(f"{name} {version}" for name, version in known.items())
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"Python {platform.python_version()}, {packages}; one of {cores} {platform.machine()} cores"


def main() -> None:
    """Measure and print the page."""
    wp.config.log_level = wp.LOG_WARNING
    started = time.perf_counter()
    costs: dict[tuple[str, int], dict[str, np.ndarray]] = {}
    for function, dofs in product(FUNCTIONS, DIMENSIONS):
        costs[function, dofs] = measure(Problem(function, dofs))
        print(f"{function}, D = {dofs}: {time.perf_counter() - started:.0f} s", file=sys.stderr)
    pairs = [column for columns in TABLES.values() for column in columns if not isinstance(column, str)]
    verdict = verdicts(
        {
            (pair, *problem, b): compare(*(found[name][b] for name in pair))
            for (problem, found), b, pair in product(costs.items(), range(len(BUDGETS)), pairs)
        }
    )

    def cell(column: str | Pair, function: str, dofs: int, b: int) -> str:
        if isinstance(column, str):
            return f"{np.median(costs[function, dofs][column][b]):.2g}"
        return verdict[column, function, dofs, b]

    print(INTRODUCTION.format(runs=RUNS, solved=SOLVED, level=LEVEL, comparisons=len(verdict)))
    print(f"{machine()}, {time.perf_counter() - started:.0f} s.")
    for title, columns in TABLES.items():
        print(f"\n## {title}\n")
        print("\n".join(table(columns, cell)))


if __name__ == "__main__":
    main()
