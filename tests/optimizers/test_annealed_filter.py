"""The annealed particle filter against a float64 twin fed the same random numbers, and against its definition."""

from functools import partial

import numpy as np
import pytest
from annealed_twin import Twin, bounded, mostly_judged, survival_rate, weights
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

from mmocap_warp.optimizers.annealed_filter import AnnealedFilter, AnnealedFilterConfig

TWIN = 1e-5  # of coordinates about 1, over a whole search in single precision
SURVIVAL = 1e-3
WEIGHT = 1e-5  # relative to the largest
CHANCE = 1e-3  # probability under which a distribution is refused


@pytest.mark.parametrize(
    "settings",
    [
        {"layers": 0},
        {"survival": 0.0},
        {"survival": 1.1},
        {"survival": float("nan")},
        {"diffusion": -0.5},
        {"diffusion": float("inf")},
    ],
)
def test_wrong_settings_are_refused(settings):
    ((name, value),) = settings.items()
    with pytest.raises(ValueError, match=rf"^{name} must .*{value}"):
        AnnealedFilterConfig(**settings)


@pytest.mark.parametrize("dofs", [1, 4, 6, 39])
@pytest.mark.parametrize("function", [bounded, ellipsoid, mostly_judged])
def test_a_whole_search_is_the_twins(device, dofs, function):
    scale = np.linspace(0.2, 0.5, dofs)
    start = np.random.default_rng(dofs).normal(0, 1, (2, dofs))
    search = Search(AnnealedFilter, dofs, [11, 12], device, 500, scale=scale, start=start)
    assert search.optimizer.plan(500) == [50] * 10
    twins = [Twin(scale, 50, [dofs]) for _ in (0, 1)]
    for run, twin in enumerate(twins):
        twin.start(search.start[run].astype(float))
    for _ in range(10):
        x, cost = search.generation(function)
        now = search.state()
        for run, twin in enumerate(twins):
            assert np.abs(x[run] - twin.ask(now["noise"][run].astype(float))).max() < TWIN
            twin.tell(cost[run].astype(float), now["uniform"][run].astype(float))
            assert np.abs(now["weight"][run] - twin.weight).max() < WEIGHT * twin.weight.max()
            np.testing.assert_array_equal(now["parent"][run], twin.parent)
            assert np.abs(search.estimate()[run] - twin.mean).max() < TWIN


def weighed(device, costs, dofs=3, **settings):
    """A search (run, particle) that was told these costs."""
    costs = np.asarray(costs, np.float32)
    runs, particles = costs.shape
    config = AnnealedFilterConfig(layers=2, **settings)
    search = Search(AnnealedFilter, dofs, range(runs), device, 2 * particles, config=config)
    search.ask()
    search.tell(costs)
    return search


@pytest.mark.parametrize("particles", [8, 25, 50, 300])
@pytest.mark.parametrize("survival", [0.2, 0.5, 0.8])
def test_the_survival_rate_is_met_where_it_can_be(device, particles, survival):
    """Costs of all kinds: alike to four digits, spread, near the worst, outside [0, 1], some without a judgement."""
    rng = np.random.default_rng(particles)
    base = rng.uniform(0, 1, (7, particles))
    costs = np.stack(
        [
            0.3 + 1e-4 * base[0],
            base[1],
            0.999 + 1e-3 * base[2],
            base[3] ** 8,
            1e-7 * base[4],
            1e6 * base[5] - 3e5,
            np.where(np.arange(particles) < 0.04 * particles, np.inf, base[6]),
        ]
    )
    weight = weighed(device, costs, survival=survival).optimizer.state.weight.numpy().astype(float)
    np.testing.assert_allclose(weight.sum(axis=1), 1.0, rtol=0, atol=1e-5)
    np.testing.assert_allclose(survival_rate(weight), survival, rtol=0, atol=SURVIVAL)


def test_weights_are_powers_of_one_less_the_cost(device):
    costs = np.random.default_rng(0).uniform(0.1, 0.6, (4, 30)).astype(np.float32)
    search = weighed(device, costs)
    exponent = search.optimizer.state.exponent.numpy().astype(float)
    expected = (1 - costs.astype(float)) ** exponent[:, None]
    expected /= expected.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(search.optimizer.state.weight.numpy(), expected, rtol=1e-4, atol=0)


@pytest.mark.parametrize(("factor", "offset"), [(1.0, 3.0), (1000.0, 0.0), (0.01, -0.001), (1e38, -1e38), (3e38, 0)])
def test_costs_outside_0_to_1_are_mapped_onto_it_by_their_range(device, factor, offset):
    costs = np.linspace(0, 1, 20)[None]
    inside = weighed(device, costs).optimizer.state.weight.numpy()
    outside = weighed(device, factor * costs + offset).optimizer.state.weight.numpy()
    np.testing.assert_allclose(outside, inside, rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("costs", "weights"),
    [
        ([0.2, 0.2, 0.2, 0.2], [0.25, 0.25, 0.25, 0.25]),
        ([1.0, 1.0, 1.0, 1.0], [0.25, 0.25, 0.25, 0.25]),
        ([7.0, 7.0, 7.0, 7.0], [0.25, 0.25, 0.25, 0.25]),
        ([np.inf, np.inf, np.inf, np.inf], [0.25, 0.25, 0.25, 0.25]),
        ([np.inf, 1.0, np.inf, 1.0], [0, 0.5, 0, 0.5]),
        ([np.inf, np.inf, 0.3, np.inf], [0, 0, 1, 0]),
        ([0.1, 0.1, 0.1, 0.5], [1 / 3, 1 / 3, 1 / 3, 0]),  # three that share the best cannot be told apart
        ([0.1, np.inf, 0.9, np.inf], [0.5, 0, 0.5, 0]),  # two survive at most: no exponent is soft enough
        ([0.0, 1.0, 1.0, 1.0], [1, 0, 0, 0]),
        ([0.5, 1e-42, 0.0, 1.0], None),
        ([-1e-45, 0.0, 0.0, 0.0], None),
        ([-3e38, 3e38, 0.0, 1.0], None),
    ],
)
def test_weights_where_the_survival_rate_cannot_be_met(device, costs, weights):
    search = weighed(device, [costs, costs])
    found = search.optimizer.state.weight.numpy()
    if weights is not None:
        np.testing.assert_allclose(found, [weights, weights], rtol=0, atol=1e-3)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, rtol=0, atol=1e-5)
    assert_finite(search)
    assert not np.any(np.isinf(costs)) or np.all(np.isinf(costs)) or not found[:, np.isinf(costs)].any()


def test_particles_are_selected_as_often_as_they_weigh_with_replacement(device):
    """Counts of 2000 runs: chi-square of their sum, and of a run's own counts, which are those of independent draws."""
    cost = np.linspace(0.1, 0.9, 20)
    search = weighed(device, np.tile(cost, (2000, 1)))
    weight = search.optimizer.state.weight.numpy()[0].astype(float)
    parent = search.optimizer.state.parent.numpy()
    counts = np.stack([np.bincount(chosen, minlength=20) for chosen in parent])
    likely = weight * 20 > 0.05
    assert likely.sum() > 10
    expected = np.append(weight[likely], weight[~likely].sum()) * parent.size
    total = counts.sum(axis=0)
    observed = np.append(total[likely], total[~likely].sum())
    assert stats.chisquare(observed, expected * parent.size / expected.sum()).pvalue > CHANCE
    for k in np.flatnonzero(likely)[:5]:
        often = np.minimum(counts[:, k], 4)
        share = stats.binom.pmf(np.arange(4), 20, weight[k])
        expected = 2000 * np.append(share, 1 - share.sum())
        assert stats.chisquare(np.bincount(often, minlength=5), expected).pvalue > CHANCE


def test_particles_without_weight_are_never_selected(device):
    costs = np.where(np.arange(16) % 2, np.inf, 0.5)
    parent = weighed(device, np.tile(costs, (500, 1))).optimizer.state.parent.numpy()
    assert not np.any(parent % 2)


def test_propagation_adds_half_of_the_selected_particles_covariance(device):
    runs, particles = 4000, 6
    search = Search(AnnealedFilter, 3, range(runs), device, 10 * particles, scale=100.0)
    search.generation(sphere)
    chosen = np.random.default_rng(1).normal(0, [0.1, 1.0, 3.0], (particles, 3)) @ np.linalg.qr(np.ones((3, 3)))[0]
    o = search.optimizer.state
    o.selected.assign(np.tile(chosen, (runs, 1, 1)))
    o.center.assign(np.tile(chosen.mean(axis=0), (runs, 1)))
    o.spread.assign(np.tile(chosen.std(axis=0), (runs, 1)))
    added = search.ask() - chosen.astype(np.float32)
    expected = 0.5 * np.cov(chosen.T, bias=True)
    white = np.linalg.solve(np.linalg.cholesky(expected), added.reshape(-1, 3).T)
    assert np.abs(np.cov(white) - np.eye(3)).max() < 5 * np.sqrt(2 / (runs * particles))
    assert stats.kstest(white[0], "norm").pvalue > CHANCE
    together = np.cov(added[:, :, 0].T) / expected[0, 0]  # of one particle's with another's
    assert np.abs(together - np.eye(particles)).max() < 5 * np.sqrt(2 / runs)


def test_the_first_layer_is_spread_by_the_radius(device):
    scale = np.array([0.1, 0.5, 2.0])
    search = Search(AnnealedFilter, 3, range(400), device, 100, scale=scale, start=[5.0, -5.0, 0.0])
    z = (search.ask() - search.start[:, None].astype(float)) / scale
    for i in range(3):
        assert stats.kstest(z[..., i].ravel(), "norm").pvalue > CHANCE
    assert np.abs(np.corrcoef(z.reshape(-1, 3).T) - np.eye(3)).max() < 5 / np.sqrt(4000)


@pytest.mark.parametrize(
    ("evaluations", "sizes"),
    [
        (0, []),
        (1, []),
        (2, [2]),
        (7, [2, 2, 2]),
        (20, [2] * 10),
        (83, [8] * 10),
        (84, [8] * 10),
        (500, [50] * 10),
        (1500, [150] * 10),
    ],
)
def test_a_budget_is_spread_over_the_layers(device, evaluations, sizes):
    search = Search(AnnealedFilter, 4, [0, 1], device, evaluations, start=0.7)
    assert search.optimizer.plan(evaluations) == sizes
    search.run(sphere)
    assert np.isfinite(search.estimate()).all()
    if not sizes:
        np.testing.assert_array_equal(search.estimate(), search.start)


def test_generations_never_exceed_another_budget():
    search = Search(AnnealedFilter, 4, [0], "cpu", 500)
    assert search.optimizer.plan(499) == [50] * 9
    assert search.optimizer.plan(49) == []
    assert search.optimizer.plan(5000) == [50] * 10


@pytest.mark.parametrize("dofs", [1, 39])
def test_a_run_of_a_batch_is_the_single_run_bit_for_bit(device, dofs):
    assert_a_run_of_a_batch_is_the_single_run(AnnealedFilter, dofs, device, ellipsoid, evaluations=150)


@pytest.mark.parametrize("partitions", [None, [3, 1]])
def test_a_search_depends_on_the_last_one_by_its_memory_alone(device, partitions):
    """And by which random numbers it used."""
    kind = partial(AnnealedFilter, partitions=partitions)
    search, other = (Search(kind, 4, [3, 4], device, 150) for _ in range(2))
    search.run(sphere)
    other.counter.assign(search.counter.numpy())
    for mine, theirs in zip(other.optimizer.memory, search.optimizer.memory, strict=True):
        mine.assign(theirs.numpy())
    for each in (search, other):
        each.restart()
        for _ in range(3):
            each.generation(ellipsoid)
    for name, values in other.state().items():
        np.testing.assert_array_equal(search.state()[name], values, err_msg=name)


def test_a_search_begins_with_the_last_ones_particles(device):
    """Each where it was, moved by as much as the start is from the last answer, and spread by the radius."""
    search = Search(AnnealedFilter, 3, range(300), device, 200, start=1.0)
    search.run(bounded)
    chosen, answer = (array.numpy().astype(float) for array in search.optimizer.memory)
    assert np.mean(chosen.std(axis=1) > 0) > 0.9
    search.restart()
    z = (search.ask() - chosen - (1.0 - answer)[:, None]) / 0.5
    for i in range(3):
        assert stats.kstest(z[..., i].ravel(), "norm").pvalue > CHANCE


def test_a_search_from_the_last_answer_leaves_the_particles_where_they_were(device):
    search = Search(AnnealedFilter, 3, [0, 1], device, 200, start=1.0)
    search.run(ellipsoid)
    chosen = search.optimizer.memory[0].numpy().copy()
    search.start = search.estimate().astype(np.float32)
    search.restart()
    np.testing.assert_array_equal(search.optimizer.memory[0].numpy(), chosen)


def test_a_search_that_carries_no_particles_begins_with_all_of_them_at_its_start(device):
    """Also after a search; and it has no memory that another one would need."""
    search = Search(AnnealedFilter, 3, range(300), device, 200, start=1.0, config=AnnealedFilterConfig(carries=False))
    assert search.optimizer.memory == ()
    search.run(bounded)
    search.restart()
    np.testing.assert_array_equal(search.state()["selected"], np.ones((300, 20, 3)))
    z = (search.ask() - 1.0) / 0.5
    for i in range(3):
        assert stats.kstest(z[..., i].ravel(), "norm").pvalue > CHANCE


def test_partitions_are_annealed_in_turn_and_whole_particles_selected(device):
    """A layer moves its own coordinates, the others stay as each particle has them; none is the same for all."""
    search = Search(partial(AnnealedFilter, partitions=[2, 3]), 5, [3, 4], device, 2 * 10 * 12, start=0.7)
    assert search.optimizer.plan(240) == [12] * 20
    for layer in range(20):
        before = search.optimizer.state.selected.numpy().copy()
        x, _cost = search.generation(flat)  # nobody is preferred, so that the particles never come together
        now, moved = slice(0, 2) if layer < 10 else slice(2, 5), x != before
        assert moved[..., now].all()
        assert not np.delete(moved, now, axis=2).any()
        parent = search.optimizer.state.parent.numpy()
        chosen = np.take_along_axis(x, parent[..., None], axis=1)
        np.testing.assert_array_equal(search.optimizer.state.selected.numpy(), chosen)
    assert (x.std(axis=1)[:, 2:] > 0).all()
    with pytest.raises(ValueError, match=r"partitions must add up to 5 coordinates, got \[2, 2\]"):
        Search(partial(AnnealedFilter, partitions=[2, 2]), 5, [3], device)


def test_what_no_cost_shows_spreads_by_no_more_than_the_radius_a_layer(device):
    """Over 50 frames; Eq. 6 alone would spread it 57-fold in variance in each of them, until numbers overflow."""
    search = Search(AnnealedFilter, 4, range(5), device, 200, scale=[0.5, 0.5, 0.1, 0.0])
    for _ in range(50):
        search.run(flat)
        search.start = search.estimate().astype(np.float32)
        search.restart()
    assert_finite(search)
    spread = search.optimizer.memory[0].numpy().std(axis=1)
    assert np.all(spread <= 10 * np.array([0.5, 0.5, 0.1, 0.0]))
    assert np.all(spread[:, 3] == 0)


@pytest.mark.parametrize("partitions", [None, [2, 2]])
def test_an_exponent_serves_the_layer_after_the_one_that_it_was_made_of(device, partitions):
    """But for a partition's first layer, of whose costs nothing is known before."""
    search = Search(partial(AnnealedFilter, partitions=partitions), 4, [1], device, 1200, start=0.8)
    layers = search.optimizer.plan(1200)
    for layer in range(len(layers)):
        before = search.optimizer.state.exponent.numpy()[0]
        _x, cost = search.generation(bounded)
        weight = search.optimizer.state.weight.numpy()[0].astype(float)
        after = search.optimizer.state.exponent.numpy()[0]
        used = after if layer % 10 == 0 else before
        np.testing.assert_allclose(weight, weights(cost[0].astype(float), used), rtol=1e-3, atol=1e-7)
        assert abs(survival_rate(weights(cost[0].astype(float), after)) - 0.5) < SURVIVAL


def test_without_carrying_a_layer_is_weighed_by_its_own_exponent(device):
    search = Search(AnnealedFilter, 4, [3, 4], device, 500, config=AnnealedFilterConfig(carries=False))
    for _ in range(3):
        _x, cost = search.generation(bounded)
        weight = search.state()["weight"].astype(float)
        np.testing.assert_allclose(survival_rate(weight), 0.5, atol=SURVIVAL)
        for run in (0, 1):
            expected = weights(cost[run].astype(float), search.state()["exponent"][run])
            assert np.abs(weight[run] - expected).max() < WEIGHT * expected.max()


def test_asking_again_without_telling_samples_again(device):
    search = Search(AnnealedFilter, 4, [3, 4], device, 150)
    search.generation(sphere)
    before = search.state()
    first = search.ask(5)
    assert not np.any(search.ask(5)[:, :5] == first[:, :5])
    after = search.state()
    for name in ("selected", "center", "mean", "weight", "layer"):
        np.testing.assert_array_equal(before[name], after[name], err_msg=name)
    np.testing.assert_array_equal(after["counter"], before["counter"] + 10)


@pytest.mark.parametrize("scale", [0.5, 0.0])
@pytest.mark.parametrize("dofs", [1, 6])
@pytest.mark.parametrize("function", [flat, unjudged, half_judged])
def test_costs_that_tell_little_do_no_harm(device, function, dofs, scale):
    search = Search(AnnealedFilter, dofs, range(3), device, 500, scale=scale, start=0.3)
    search.run(function)
    assert_finite(search)
    assert np.isfinite(search.estimate()).all()
    if scale == 0.0:
        np.testing.assert_array_equal(search.estimate(), search.start)


@pytest.mark.parametrize("function", [sphere, rosenbrock, bounded])
@pytest.mark.parametrize(("dofs", "share"), [(4, 0.1), (9, 0.3), (28, 0.8)])
def test_the_estimate_is_better_than_the_start(device, function, dofs, share):
    search = Search(AnnealedFilter, dofs, range(7), device, 1500, start=-1.0)
    search.run(function)
    assert np.median(function(search.estimate())) < share * function(search.start).mean()
