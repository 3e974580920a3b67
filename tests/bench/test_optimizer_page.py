"""The benchmark in the documents judges the same functions on both sides, and by the procedure that it names."""

from __future__ import annotations

import sys
from importlib import util
from pathlib import Path

import numpy as np
import pytest
import warp as wp

FILE = Path(__file__).resolve().parents[2] / "docs" / "benchmarks" / "optimizers.py"
SINGLE = 1e-4  # relative, of sums of squares in single precision


@pytest.fixture(scope="module")
def benchmark():
    pytest.importorskip("cmaes")
    specification = util.spec_from_file_location("optimizer_benchmark", FILE)
    module = util.module_from_spec(specification)
    sys.modules[specification.name] = module  # where its dataclass looks for annotations
    specification.loader.exec_module(module)
    yield module
    del sys.modules[specification.name]


@pytest.mark.parametrize("dofs", [2, 10])
@pytest.mark.parametrize("function", ["sphere", "ellipsoid", "Rosenbrock", "Rastrigin"])
def test_both_forms_of_a_function_agree_and_have_their_minimum_where_it_is_said(benchmark, function, dofs):
    problem = benchmark.Problem(function, dofs)
    x = np.random.default_rng(0).uniform(-1, 1, (100, dofs)).astype(np.float32)
    x[0] = problem._minimum
    expected = problem(x.astype(float))
    cost = wp.zeros(len(x), dtype=wp.float32)
    problem.on_device(wp.array(x), cost)
    np.testing.assert_allclose(cost.numpy(), expected, rtol=SINGLE, atol=1e-12)
    assert expected[0] == 0.0
    assert np.all(expected[1:] > 0.0)


def test_holm_stops_at_the_first_that_is_not_significant(benchmark):
    """Of four at 5 %, the thresholds are 0.0125, 0.0167, 0.025 and 0.05."""
    p = {"a": (0.03, True), "b": (0.012, False), "c": (0.016, True), "d": (0.026, True)}
    comparisons = {key: benchmark.Comparison(*value) for key, value in p.items()}
    assert benchmark.verdicts(comparisons) == {"a": "same", "b": "worse", "c": "better", "d": "same"}


def test_lower_costs_are_better_and_equal_ones_the_same(benchmark):
    low, high = np.linspace(0, 1, 30), np.linspace(2, 3, 30)
    assert benchmark.compare(low, high).lower
    assert not benchmark.compare(high, low).lower
    assert benchmark.compare(low, high).p < 1e-6
    assert benchmark.compare(np.ones(30), np.ones(30)).p == 1.0


def test_others_spend_what_ours_may_spend(benchmark):
    problem = benchmark.Problem("sphere", 4)
    for run in benchmark.OTHERS.values():
        lowest = run(problem, 0)
        assert len(lowest) == len(benchmark.BUDGETS)
        assert lowest == sorted(lowest, reverse=True)
        assert lowest[-1] < problem(np.zeros(4))


def test_a_trace_counts_and_cuts(benchmark):
    trace = benchmark.Trace(lambda x: x[0])
    for cost in [*range(5000, 1000, -1)]:
        trace(np.array([cost]))
    assert len(trace) == 4000
    assert trace.lowest == [5000 - budget + 1 for budget in benchmark.BUDGETS]
