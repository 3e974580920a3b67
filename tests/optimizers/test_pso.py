"""PSO against a float64 twin fed the same random numbers, its schedule and limits, and known minima."""

import numpy as np
import pytest
from minimising import (
    Search,
    assert_a_run_of_a_batch_is_the_single_run,
    assert_finite,
    ellipsoid,
    flat,
    half_judged,
    rosenbrock,
    sphere,
    unjudged,
)
from scipy import stats
from tracked_motion import FRAMES, TRACKED, motion, standing_still, track_motion, tracker_of

from mmocap_warp.optimizers.pso import Pso, PsoConfig

TWIN = 1e-6  # of coordinates about 1, a move in single precision
FREE = 5e-4  # likewise, after all moves of a search
SINGLE = 1e-6  # relative, a few roundings
CHANCE = 1e-3  # probability under which a distribution is refused


@pytest.mark.parametrize(
    "settings",
    [
        {"population": 0},
        {"phi_1": -1.0},
        {"phi_2": float("inf")},
        {"inertia_max": 0.0},
        {"inertia_min": float("nan")},
        {"inertia_min": 3.0},
        {"velocity_limit": -0.5},
    ],
)
def test_wrong_settings_are_refused(settings):
    ((name, value),) = settings.items()
    with pytest.raises(ValueError, match=rf"^{name} must .*{value}"):
        PsoConfig(**settings)


class Twin:
    """Fig. 6 for one run in float64, from the first positions and velocities of another (particle, dof)."""

    def __init__(self, x, v, limit, changes):
        self.x, self.v, self.limit, self.changes = x, v, limit, changes
        self.p, self.p_cost = x, np.full(len(x), np.inf)
        self.moves = 0

    def tell(self, cost, r_1, r_2):
        """Learn from costs (particle,) and move by random factors (particle, dof)."""
        better = cost < self.p_cost
        self.p = np.where(better[:, None], self.x, self.p)
        self.p_cost = np.where(better, cost, self.p_cost)
        b = self.p[np.argmin(self.p_cost)]
        c = min(self.moves / self.changes, 1.0) * np.log(10 * 2.0)
        v = 2.0 / np.exp(c) * self.v + 2.0 * r_1 * (self.p - self.x) + 2.0 * r_2 * (b - self.x)
        self.v = np.clip(v, -self.limit, self.limit)
        self.x = self.x + self.v
        self.moves += 1


@pytest.mark.parametrize("dofs", [1, 4, 6, 39])
@pytest.mark.parametrize("function", [ellipsoid, half_judged])
def test_a_whole_search_is_the_twins(device, dofs, function):
    """With an inertia of 2 a move is up to four times as far off as the one before: a swarm left to itself spreads
    rounding errors. Hence one twin that is put where the swarm is before each move, and one that flies on its own."""
    scale = np.linspace(0.2, 0.5, dofs)
    start = np.random.default_rng(dofs).normal(0, 1, (2, dofs))
    search = Search(Pso, dofs, [11, 12], device, 500, scale=scale, start=start)
    now = search.state()
    led, free = (
        [Twin(now["x"][run].astype(float), now["v"][run].astype(float), scale / 2, 48) for run in (0, 1)]
        for _ in range(2)
    )
    for _ in range(50):
        before = now
        _x, cost = search.generation(function)
        now = search.state()
        for run in (0, 1):
            led[run].x, led[run].v = before["x"][run].astype(float), before["v"][run].astype(float)
            for twin, tolerance in ((led[run], TWIN), (free[run], FREE)):
                twin.tell(cost[run], now["r_1"][run].astype(float), now["r_2"][run].astype(float))
                assert np.abs(now["x"][run] - twin.x).max() < tolerance
                assert np.abs(now["v"][run] - twin.v).max() < tolerance
                assert np.abs(now["own_best"][run] - twin.p).max() < tolerance
                best = now["own_best"][run, now["leader"][run]]
                assert np.abs(best - twin.p[np.argmin(twin.p_cost)]).max() < tolerance
                np.testing.assert_array_equal(now["own_cost"][run], twin.p_cost)


def test_the_swarm_starts_about_the_pose(device):
    scale = np.array([0.1, 0.5, 2.0])
    search = Search(Pso, 3, range(400), device, scale=scale, start=[5.0, -5.0, 0.0])
    x = (search.ask() - search.start[:, None].astype(float)) / scale
    v = search.state()["v"] / scale
    for i in range(3):
        assert stats.kstest(x[..., i].ravel(), "norm").pvalue > CHANCE
        assert stats.kstest(v[..., i].ravel(), stats.uniform(-0.5, 1.0).cdf).pvalue > CHANCE
    numbers = np.concatenate([x, v], axis=-1).reshape(4000, 6)
    assert np.abs(np.corrcoef(numbers.T) - np.eye(6)).max() < 5 / np.sqrt(4000)


def test_random_factors_are_uniform_and_anew_in_each_dimension(device):
    search = Search(Pso, 3, range(400), device)
    search.generation(flat)
    first = search.state()
    search.generation(flat)
    second = search.state()
    drawn = [first["r_1"], first["r_2"], second["r_1"], second["r_2"]]
    numbers = np.concatenate(drawn, axis=-1).reshape(4000, 12)
    for i in range(12):
        assert stats.kstest(numbers[:, i], "uniform").pvalue > CHANCE
    assert np.abs(np.corrcoef(numbers.T) - np.eye(12)).max() < 5 / np.sqrt(4000)


@pytest.mark.parametrize("evaluations", [500, 499, 83, 84])
def test_inertia_falls_from_2_to_a_tenth_over_the_moves_of_the_budget(device, evaluations):
    """In equal ratios. The cut generation moves too, so that 83 evaluations are nine generations and eight moves."""
    search = Search(Pso, 4, [0, 1], device, evaluations)
    generations = len(search.optimizer.plan(evaluations))
    inertia = []
    for _ in range(generations - 1):
        search.generation(sphere)
        inertia.append(search.state()["inertia"])
    np.testing.assert_allclose(inertia[0], 2.0, rtol=SINGLE)
    np.testing.assert_allclose(inertia[-1], 0.1, rtol=SINGLE)
    expected = np.geomspace(2.0, 0.1, generations - 1)
    np.testing.assert_allclose(inertia, np.stack([expected] * 2, axis=1), rtol=SINGLE)
    search.generation(sphere)
    np.testing.assert_allclose(search.optimizer.state.inertia.numpy(), 0.1, rtol=SINGLE)  # beyond the budget


@pytest.mark.parametrize("limit", [0.5, 0.05])
def test_no_particle_is_faster_than_the_limit(device, limit):
    scale = np.array([0.1, 0.5, 2.0])
    search = Search(Pso, 3, range(5), device, scale=scale, start=3.0, config=PsoConfig(velocity_limit=limit))
    fastest = np.abs(search.state()["v"])
    x = search.ask()
    for _ in range(50):
        search.generation(ellipsoid)
        moved = np.abs(search.ask() - x)
        assert np.all(moved <= limit * scale + 1e-5)
        fastest = np.maximum(fastest, np.abs(search.state()["v"]))
        x = search.ask()
    np.testing.assert_array_equal(fastest.max(axis=(0, 1)), np.float32(limit) * np.float32(scale))


def test_the_first_of_equals_leads_and_is_remembered(device):
    search = Search(Pso, 3, range(4), device)
    first = search.ask()
    for _ in range(3):
        search.generation(flat)
    np.testing.assert_array_equal(search.optimizer.state.own_best.numpy(), first)
    np.testing.assert_array_equal(search.estimate(), first[:, 0])


def test_start_forgets_the_last_search(device):
    """But not which random numbers it used."""
    search = Search(Pso, 4, [3, 4], device)
    search.run(sphere)
    before = search.ask()
    search.restart()
    fresh = Search(Pso, 4, [3, 4], device)
    fresh.counter.assign(search.counter.numpy() - search.optimizer.particles)
    fresh.restart()
    assert not np.any(search.ask() == before)
    for _ in range(3):
        search.generation(ellipsoid)
        fresh.generation(ellipsoid)
    for name, values in fresh.state().items():
        np.testing.assert_array_equal(search.state()[name], values, err_msg=name)


@pytest.mark.parametrize("dofs", [1, 39])
def test_a_run_of_a_batch_is_the_single_run_bit_for_bit(device, dofs):
    assert_a_run_of_a_batch_is_the_single_run(Pso, dofs, device, ellipsoid, evaluations=157)


@pytest.mark.parametrize("scale", [0.5, 0.0])
@pytest.mark.parametrize("dofs", [1, 6])
@pytest.mark.parametrize("function", [flat, unjudged, half_judged])
def test_costs_that_tell_little_do_no_harm(device, function, dofs, scale):
    search = Search(Pso, dofs, range(3), device, scale=scale, start=0.25)
    for _ in range(60):
        search.generation(function)
    assert_finite(search)
    if scale == 0.0:
        assert np.all(search.ask() == 0.25)


@pytest.mark.parametrize(("evaluations", "sizes"), [(0, []), (1, [1]), (7, [7]), (10, [10]), (25, [10, 10, 5])])
def test_small_budgets_are_spent(device, evaluations, sizes):
    search = Search(Pso, 4, range(3), device, evaluations, start=1.0)
    assert search.optimizer.plan(evaluations) == sizes
    search.run(sphere)
    assert np.isfinite(search.ask()).all()


@pytest.mark.parametrize("dofs", [1, 4, 9, 28])
def test_known_minima_are_approached(device, dofs):
    start = Search(Pso, dofs, range(9), device, 4000, start=1.5)
    assert np.median(start.run(sphere)) < 1e-4 * sphere(start.start).mean()
    if dofs > 1:
        valley = Search(Pso, dofs, range(9), device, 4000, start=-0.5)
        assert np.median(valley.run(rosenbrock)) < 0.1 * rosenbrock(valley.start).mean()


def test_a_swarm_of_one_is_allowed(device):
    search = Search(Pso, 4, [0], device, 100, start=1.0, config=PsoConfig(population=1))
    assert search.run(sphere)[0] < sphere(search.start)[0]
    assert_finite(search)


@pytest.mark.parametrize("algorithm", ["pso", "h-pso"])
def test_a_motion_is_tracked(device, algorithm):
    result, errors = track_motion(algorithm, device, FRAMES, runs=2)
    assert np.all(errors < TRACKED * standing_still(FRAMES))
    assert np.all(result.evaluations == 500)
    single, _ = track_motion(algorithm, device, frames=2, seed=1)
    np.testing.assert_array_equal(result.pose[1, :2], single.pose[0])
    assert not np.array_equal(result.pose[0], result.pose[1])


@pytest.mark.parametrize("evaluations", [1, 7, 83, 500])
@pytest.mark.parametrize("algorithm", ["pso", "h-pso"])
def test_a_frame_costs_its_budget_exactly(device, algorithm, evaluations):
    tracker, calls = tracker_of(algorithm, device, evaluations=evaluations, runs=2)
    assert tracker.step(motion(device)[1][1]).evaluations == evaluations
    assert calls.pop() == 2  # the answer is looked at once more, for its overlap
    assert sum(calls) == 2 * evaluations
