"""Every optimizer on what a cost should not be: flat, infinite, of one dimension, with next to no budget or room."""

from __future__ import annotations

import numpy as np
import pytest
from minimising import Search, assert_finite, flat, half_judged, sphere, unjudged

from mmocap_warp.optimizers.annealed_filter import AnnealedFilter
from mmocap_warp.optimizers.cma_es import CmaEs
from mmocap_warp.optimizers.de import De
from mmocap_warp.optimizers.minimize import minimize
from mmocap_warp.optimizers.pso import Pso

OPTIMIZERS = [CmaEs, De, Pso, AnnealedFilter]


def bottomless(x):
    """A slope."""
    return x[..., 0]


def nowhere_to_begin(x):
    """A sphere that cannot be judged at the start."""
    return np.where(np.all(x == np.float32(0.1), axis=-1), np.inf, sphere(x))


def huge(x):
    """Costs near the end of single precision."""
    return np.minimum(1e38 * sphere(x), 3e38)


COSTS = [sphere, flat, unjudged, half_judged, nowhere_to_begin, bottomless, huge]


class Judge:
    """A cost computed on the host, that keeps what it saw."""

    def __init__(self, function):
        self.function, self.seen = function, []

    def __call__(self, x, out):
        candidates = x.numpy()
        self.seen.append(candidates.copy())
        out.assign(self.function(candidates.astype(float)).astype(np.float32))


def answer(optimizer, function, dofs, evaluations, device, radius=0.5, bounds=None):
    """The minimum, after checks of what holds for any cost."""
    judge, start = Judge(function), np.full(dofs, 0.1, np.float32)
    found = minimize(judge, start, radius, evaluations, optimizer=optimizer, runs=2, bounds=bounds, device=device)
    assert all(np.isfinite(x).all() for x in judge.seen)
    assert np.isfinite(found.x).all()
    assert not np.isnan(found.cost).any()
    judged_at_the_end = 2 * (optimizer is AnnealedFilter)
    assert sum(map(len, judge.seen)) == 2 * found.evaluations + judged_at_the_end
    assert found.evaluations <= evaluations
    np.testing.assert_array_equal(found.cost, function(found.x.astype(float)).astype(np.float32))
    if optimizer is not AnnealedFilter:
        assert np.all(found.cost <= np.float32(function(start.astype(float))))
    return found


@pytest.mark.parametrize("evaluations", [1, 3, 37, 2000])
@pytest.mark.parametrize("dofs", [1, 5])
@pytest.mark.parametrize("function", COSTS)
@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_any_cost_in_any_budget_has_a_defined_answer(device, optimizer, function, dofs, evaluations):
    found = answer(optimizer, function, dofs, evaluations, device)
    if optimizer is not AnnealedFilter and function in (flat, unjudged):
        np.testing.assert_array_equal(found.x, np.float32(0.1))  # the start wins ties
    if evaluations == 2000 and function in (half_judged, nowhere_to_begin):
        assert np.isfinite(found.cost).all()


@pytest.mark.parametrize("function", COSTS)
@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_without_a_radius_nothing_moves(device, optimizer, function):
    found = answer(optimizer, function, 4, 500, device, radius=0.0)
    np.testing.assert_array_equal(found.x, np.float32(0.1))


@pytest.mark.parametrize("function", COSTS)
@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_coordinates_without_a_radius_stay(device, optimizer, function):
    found = answer(optimizer, function, 4, 500, device, radius=[0.5, 0.0, 0.5, 0.0])
    np.testing.assert_array_equal(found.x[:, [1, 3]], np.float32(0.1))


@pytest.mark.parametrize("function", COSTS)
@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_bounds_of_no_width_leave_the_start(device, optimizer, function):
    found = answer(optimizer, function, 4, 500, device, bounds=np.full((4, 2), 0.1))
    np.testing.assert_array_equal(found.x, np.float32(0.1))


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_one_run_in_trouble_does_not_touch_the_others(device, optimizer):
    """Only the first run's candidates can be judged: it is the single run, bit for bit."""

    def first_of(runs):
        def cost(x, out):
            values = sphere(x.numpy()).astype(np.float32)
            values[len(values) // runs :] = np.inf
            out.assign(values)

        return minimize(cost, np.full(3, 0.1), 0.5, 500, optimizer=optimizer, runs=runs, seed=4, device=device)

    pair, single = first_of(2), first_of(1)
    np.testing.assert_array_equal(pair.x[0], single.x[0])
    assert np.isfinite(pair.x[1]).all()


@pytest.mark.parametrize("function", COSTS)
@pytest.mark.parametrize("dofs", [1, 39])
@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_no_state_is_ever_nan(device, optimizer, dofs, function):
    """Of arrays that were poisoned before; for CMA-ES, over more generations than flat costs once took to overflow."""
    search = Search(optimizer, dofs, range(2), device, 4000, start=0.1)
    search.run(function)
    assert_finite(search)
    assert np.isfinite(search.estimate()).all()
    assert np.isfinite(search.ask()).all()
