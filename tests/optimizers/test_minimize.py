"""Minimising costs that are Warp kernels of one's own, by any optimizer."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import warp as wp

from mmocap_warp.optimizers.annealed_filter import AnnealedFilter
from mmocap_warp.optimizers.cma_es import CmaEs, CmaEsConfig
from mmocap_warp.optimizers.de import De
from mmocap_warp.optimizers.minimize import minimize
from mmocap_warp.optimizers.pso import Pso

OPTIMIZERS = [CmaEs, De, Pso, AnnealedFilter]
SINGLE = 1e-6  # relative, sums in single precision


@wp.kernel
def _sphere(x: wp.array2d[wp.float32], cost: wp.array[wp.float32]):
    c = wp.tid()
    total = wp.float32(0.0)
    for i in range(x.shape[1]):
        total += (x[c, i] - 0.5) * (x[c, i] - 0.5)
    cost[c] = total


@wp.kernel
def _rosenbrock(x: wp.array2d[wp.float32], cost: wp.array[wp.float32]):
    c = wp.tid()
    total = wp.float32(0.0)
    for i in range(x.shape[1] - 1):
        valley = x[c, i + 1] - x[c, i] * x[c, i]
        total += 100.0 * valley * valley + (1.0 - x[c, i]) * (1.0 - x[c, i])
    cost[c] = total


def of(kernel, seen=None):
    """The kernel as a cost; candidates of each call are appended to ``seen``."""

    def cost(x, out):
        if seen is not None:
            seen.append(x.numpy().copy())
        wp.launch(kernel, dim=out.shape, inputs=[x], outputs=[out], device=out.device)

    return cost


def sphere(x):
    return np.sum((x.astype(float) - 0.5) ** 2, axis=-1)


@pytest.mark.parametrize(("kernel", "minimum", "budget"), [(_sphere, 0.5, 3000), (_rosenbrock, 1.0, 15_000)])
@pytest.mark.parametrize("coordinates", [2, 8])
def test_the_minimum_is_found(device, kernel, minimum, budget, coordinates):
    found = minimize(of(kernel), np.zeros(coordinates), 0.5, budget, runs=3, device=device)
    # Rosenbrock's function has a second, local minimum at x_0 = -1 from four coordinates on.
    best = found.x[np.argmin(found.cost)]
    np.testing.assert_allclose(best, minimum, atol=1e-3)
    assert found.cost.min() < 1e-6


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_a_run_of_a_batch_is_the_single_run_bit_for_bit(device, optimizer):
    settings = {"start": np.zeros(5), "radius": 0.4, "evaluations": 300, "optimizer": optimizer, "device": device}
    batch = minimize(of(_rosenbrock), **settings, runs=3, seed=7)
    for run in range(3):
        single = minimize(of(_rosenbrock), **settings, seed=7 + run)
        np.testing.assert_array_equal(batch.x[run], single.x[0])
        assert batch.cost[run] == single.cost[0]
    assert len({tuple(x) for x in batch.x}) == 3


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_the_cost_is_the_answers_own(device, optimizer):
    """Also where the answer is an estimate, which no generation contains."""
    seen = []
    found = minimize(of(_sphere, seen), np.zeros(4), 0.5, 500, optimizer=optimizer, runs=3, device=device)
    np.testing.assert_allclose(found.cost, sphere(found.x), rtol=SINGLE, atol=1e-12)
    assert np.all(found.cost < 0.5 * sphere(np.zeros(4)))
    judged = np.concatenate(seen)
    assert [(x == judged).all(axis=1).any() for x in found.x] == [True] * 3


@pytest.mark.parametrize("evaluations", [1, 2, 3, 29, 500])
@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_the_budget_is_kept_and_the_start_comes_first(device, optimizer, evaluations):
    seen = []
    start = np.array([0.1, -0.2, 0.3])
    found = minimize(of(_sphere, seen), start, 0.5, evaluations, optimizer=optimizer, runs=2, device=device)
    assert found.evaluations <= evaluations
    if optimizer is AnnealedFilter:
        assert len(seen.pop()) == 2  # its answer, judged at the end
    else:
        assert found.evaluations == evaluations
        np.testing.assert_array_equal(seen[0], np.tile(start.astype(np.float32), (2, 1)))
        assert np.all(found.cost <= sphere(start.astype(np.float32)) * (1 + SINGLE))
    assert sum(map(len, seen)) == 2 * found.evaluations


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_bounds_hold_for_every_candidate_and_the_answer_may_lie_on_them(device, optimizer):
    bounds = np.array([[-1.0, 0.2], [0.6, 1.0], [0.7, 0.7], [-np.inf, np.inf]])
    seen = []
    start = [0.0, 0.8, 0.7, 0.0]
    found = minimize(
        of(_sphere, seen), start, 0.4, 1500, optimizer=optimizer, runs=3, bounds=bounds, device=device
    )  # fmt: skip
    lower, upper = bounds.T.astype(np.float32)
    for x in (*seen, found.x):
        assert np.all((lower <= x) & (x <= upper))
    best = np.clip(0.5, lower, upper)
    np.testing.assert_allclose(np.median(found.x, axis=0), best, atol=0.1)
    if optimizer is CmaEs:
        np.testing.assert_allclose(found.x, np.tile(best, (3, 1)), atol=1e-3)


def test_every_coordinate_has_its_own_radius(device):
    seen = []
    minimize(of(_sphere, seen), np.zeros(3), [0.5, 0.0, 0.01], 11, optimizer=De, runs=20, device=device)
    reach = np.abs(np.concatenate(seen)).max(axis=0)
    assert 0.4 < reach[0] <= 0.5
    assert reach[1] == 0.0
    assert 0.005 < reach[2] <= 0.01


def test_an_optimizer_may_have_settings_of_its_own(device):
    seen = []
    wide = partial(CmaEs, config=CmaEsConfig(population=30))
    minimize(of(_sphere, seen), np.zeros(3), 0.5, 61, optimizer=wide, device=device)
    assert [len(x) for x in seen] == [1, 30, 30]


def test_the_seed_decides(device):
    first, again, other = (
        minimize(of(_sphere), np.zeros(3), 0.5, 50, seed=seed, device=device).x.tolist() for seed in (3, 3, 4)
    )
    assert first == again
    assert first != other
    unless_told = minimize(of(_sphere), np.zeros(3), 0.5, 50, device=device).x.tolist()
    assert unless_told == minimize(of(_sphere), np.zeros(3), 0.5, 50, seed=0, device=device).x.tolist()


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"start": np.zeros((2, 2))}, r"start must be \(coordinate,\), got shape \(2, 2\)"),
        ({"start": np.zeros(0)}, "start must be"),
        ({"start": [0.0, np.nan]}, "start must be finite"),
        ({"evaluations": 0}, "evaluations and runs must be at least 1"),
        ({"runs": 0}, "evaluations and runs must be at least 1"),
        ({"bounds": np.zeros((3, 2))}, r"bounds must be \(2, 2\), got \(3, 2\)"),
        ({"bounds": [[1.0, 2.0], [-1.0, 1.0]]}, "start must be finite and within its bounds"),
        ({"bounds": [[1.0, -1.0], [-1.0, 1.0]]}, "start must be finite and within its bounds"),
        ({"bounds": [[np.nan, 1.0], [-1.0, 1.0]]}, "start must be finite and within its bounds"),
        ({"radius": -0.1}, "radius must be finite and not negative"),
        ({"radius": [0.1, np.inf]}, "radius must be finite and not negative"),
        ({"radius": [0.1, 0.2, 0.3]}, "broadcast"),
    ],
)
def test_wrong_arguments_are_refused(wrong, says):
    right = {"start": np.zeros(2), "radius": 0.5, "evaluations": 10}
    with pytest.raises(ValueError, match=says):
        minimize(of(_sphere), **(right | wrong))
