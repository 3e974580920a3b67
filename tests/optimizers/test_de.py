"""Differential evolution against a float64 twin, the definitions of roles and mating, and known minima."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest
import warp as wp
from de_twin import TWIN, UNIT, Search, Twin, ellipsoid, sphere
from tracked_motion import FRAMES, TRACKED, standing_still, track_motion

from mmocap_warp.optimizers.de import DeConfig

CHANCE = 4  # standard deviations that a frequency may be off


@pytest.mark.parametrize(
    "settings",
    [
        {"population": 1},
        {"placing": 0},
        {"leading": 11},
        {"correcting": -1},
        {"crossover": 1.1},
        {"crossover": float("nan")},
        {"factor": 0.0},
        {"factor": 2.5},
    ],
)
def test_wrong_settings_are_refused(settings):
    ((name, value),) = settings.items()
    with pytest.raises(ValueError, match=rf"{name} must be .*{value}"):
        DeConfig(**settings)


@pytest.mark.parametrize("settings", [{}, {"population": 14, "placing": 3, "leading": 9, "correcting": 14}])
@pytest.mark.parametrize("dofs", [1, 4, 6, 39])
def test_forty_generations_are_the_twins(device, dofs, settings):
    """The costs fall and are noisy, so that many trials win and the members do not crowd at the minimum.

    A donor ``x_P + F (x_L - x_C)`` inherits up to ``1 + 2 F`` times its parents' errors, twice as much for F = 1/2, and
    reflection keeps the members in the box but not their errors. So a twin that is left to itself drifts away, at any
    precision: whether a GPU fuses the product and the sum of the first members, a difference of 1e-7, decides whether
    it is 5e-6 or 1.3e-5 away after forty generations. Hence each generation is compared from the search's own members.

    What a generation rounds off, with the middle c and the half width r of the box in a coordinate: members are within
    ``|c| + r``, the step F (x_L - x_C) within r, a donor before reflection within ``|c| + 2 r``. In units of UNIT, the
    difference adds r, the donor's sum ``|c| + 2 r``, a reflection twice the rounding of the box's end, ``|c| + r``,
    and of r itself, and then its own, ``|c| + r``: together ``4 |c| + 8 r``. The first members' ``|c| + 4 r`` is less.
    """
    rng = np.random.default_rng(dofs)
    search = Search(dofs, [11, 12], device, np.linspace(0.4, 1.0, dofs), rng.normal(0, 0.3, (2, dofs)), **settings)
    o = search.optimizer.state
    twins = [Twin(center, search.scale, search.config) for center in search.start]
    rounding = UNIT * (4 * np.abs(search.start) + 8 * search.scale)  # (run, dof)
    strengths = set()
    for generation in range(40):
        x = search.ask()
        noise = rng.uniform(-0.3 * generation, 1 - 0.3 * generation, x.shape[:2])
        cost = (noise + 2 * np.abs(x - 0.3).mean(axis=-1)).astype(np.float32)
        search.tell(cost)
        for run, twin in enumerate(twins):
            expected = twin.ask(o.uniform.numpy()[run], o.parents.numpy()[run])
            assert np.all(np.abs(x[run] - expected) <= rounding[run])
            if generation:
                np.testing.assert_array_equal(o.parents.numpy()[run], twin.parents)
            twin.tell(cost[run])
            assert np.all(np.abs(o.member.numpy()[run] - twin.x) <= rounding[run])
            twin.x = o.member.numpy()[run].astype(float)
            np.testing.assert_array_equal(o.alpha.numpy()[run], twin.alpha)
            strengths |= set(np.abs(twin.altered).ravel().tolist())
    assert strengths == {0, 1, 2, 3, 4}


def mated(device, alpha, **settings):
    """A search of 200 runs whose members all have the same alphas when they are mated; parents and altered alphas."""
    search = Search(3, range(200), device, **settings)
    search.generation(ellipsoid)
    o = search.optimizer.state
    o.alpha.assign(np.broadcast_to(alpha, o.alpha.numpy().shape))
    search.ask()
    return search, o.parents.numpy(), o.altered.numpy()


def roles(search, run):
    """The members that may place, lead and correct."""
    order, config = search.optimizer.state.order.numpy()[run].tolist(), search.config
    return order[: config.placing], order[: config.leading], order[config.population - config.correcting :]


def test_roles_keep_to_their_sets_and_exclusions(device):
    search, parents, _ = mated(device, (2, -2), placing=3, leading=4, correcting=9)
    o = search.optimizer.state
    ranked = np.take_along_axis(o.member_cost.numpy(), o.order.numpy(), axis=1)
    assert np.all(np.diff(ranked) >= 0)
    for run, receiver in np.ndindex(parents.shape[:2]):
        assert len({receiver, *parents[run, receiver]}) == 4
        for parent, role in zip(parents[run, receiver], roles(search, run), strict=True):
            assert parent in role


@pytest.mark.parametrize("role", [1, 2])
@pytest.mark.parametrize("alpha", [-3, 0, 3])
def test_mating_takes_the_nearest_or_the_farthest_of_alpha_members(device, role, alpha):
    """The nearest of m drawn from n is the j-th nearest of all (from 0) with frequency C(n-1-j, m-1) / C(n, m)."""
    search, parents, altered = mated(device, (alpha, alpha), leading=10, correcting=10)
    x = search.optimizer.state.member.numpy().astype(float)
    places = {}  # how near the chosen ones are, by alpha
    for run, receiver in np.ndindex(parents.shape[:2]):
        free = sorted(set(range(10)) - {receiver, *parents[run, receiver, :role]})
        distance = np.abs(x[run, free] - x[run, parents[run, receiver, 0]]).sum(axis=1)
        chosen = free.index(parents[run, receiver, role])
        drawn = altered[run, receiver, role - 1]
        places.setdefault(drawn, []).append(np.sum(np.sign(drawn + 0.5) * (distance - distance[chosen]) < 0))
    assert sorted(places) == [alpha - 1, alpha, alpha + 1]
    for drawn, place in places.items():
        m, n = max(1, abs(drawn)), 10 - 1 - role
        expected = np.array([comb(n - 1 - j, m - 1) for j in range(n)]) / comb(n, m)
        found = np.bincount(place, minlength=n) / len(place)
        assert np.all(np.abs(found - expected) <= CHANCE * np.sqrt(expected * (1 - expected) / len(place)))


@pytest.mark.parametrize("size", [2, 3])
def test_no_more_are_drawn_than_the_set_less_one(device, size):
    """Of two free members one is drawn, whichever alpha; of three two, so that the farthest is never taken."""
    search, parents, _ = mated(device, (4, 4), placing=1, leading=2 + size)
    x = search.optimizer.state.member.numpy().astype(float)
    places = []
    for run in range(len(parents)):
        best, receiver, *free = roles(search, run)[1]  # the best places, the next receives, the others may lead
        distance = np.abs(x[run, free] - x[run, best]).sum(axis=1)
        places.append(np.argsort(distance).tolist().index(free.index(parents[run, receiver, 1])))
    assert set(places) == {0, 1}


@pytest.mark.parametrize(
    ("alpha", "falling", "rising"),  # frequencies of a step of -1, 0 and 1 of each
    [((0, 2), (1, 1, 1), (1, 1, 1)), ((-4, 4), (0, 2, 1), (1, 2, 0))],
)
def test_alphas_are_altered_by_one_or_not_at_all_and_clamped(device, alpha, falling, rising):
    _, _, altered = mated(device, alpha)
    steps = (altered - alpha).reshape(-1, 2) + 1
    found = np.bincount(3 * steps[:, 0] + steps[:, 1], minlength=9) / len(steps)
    expected = np.outer(falling, rising).ravel() / 9
    assert np.all(np.abs(found - expected) <= CHANCE * np.sqrt(expected * (1 - expected) / len(steps)))


def test_a_trial_that_wins_brings_its_alphas_and_one_that_does_not_takes_them_along(device):
    search = Search(4, range(20), device)
    search.generation(ellipsoid)
    o = search.optimizer.state
    assert not np.any(o.alpha.numpy())
    inherited = 0
    for _ in range(10):
        alpha, member, cost_before = (array.numpy().copy() for array in (o.alpha, o.member, o.member_cost))
        x, cost = search.generation(ellipsoid)
        parents, altered = o.parents.numpy(), o.altered.numpy()
        assert np.abs(altered - np.take_along_axis(alpha, parents[..., :1], axis=1)).max() <= 1
        won = cost < cost_before
        np.testing.assert_array_equal(o.alpha.numpy(), np.where(won[..., None], altered, alpha))
        np.testing.assert_array_equal(o.member.numpy(), np.where(won[..., None], x, member))
        np.testing.assert_array_equal(o.member_cost.numpy(), np.where(won, cost, cost_before))
        inherited += np.sum(won & np.any(altered != 0, axis=-1))
    assert inherited > 0


def test_an_equal_trial_does_not_win(device):
    search = Search(4, [0], device)
    x, _ = search.generation(lambda x: np.ones(x.shape[:2]))
    search.generation(lambda x: np.ones(x.shape[:2]))
    np.testing.assert_array_equal(search.optimizer.state.member.numpy(), x)
    assert not np.any(search.optimizer.state.alpha.numpy())


def folded(x, low, high):
    """Into the box, as a ball between two walls."""
    width = high - low
    return low + width - np.abs((x - low) % (2 * width) - width)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_without_a_crossover_rate_one_coordinate_is_the_donors_with_rate_one_all_are(device, factor):
    """The donors' genes that leave the box are reflected into it."""
    for rate in (0.0, 1.0):
        search = Search(5, range(50), device, scale=[0.1, 0.2, 0.3, 0.4, 0.5], crossover=rate, factor=factor)
        members, _ = search.generation(ellipsoid)
        trial, parents = search.ask(), search.optimizer.state.parents.numpy()
        placing, leading, correcting = (np.take_along_axis(members, parents[..., [r]], axis=1) for r in range(3))
        donor = placing + factor * (leading - correcting)
        assert np.mean(np.abs(donor) > search.scale) > 0.05
        donor = folded(donor, -search.scale, search.scale)
        from_donor = np.abs(trial - donor) < TWIN
        assert np.all(from_donor | (trial == members))
        assert np.all(np.abs(trial) <= search.scale.astype(np.float32))
        if rate == 1.0:
            assert np.all(from_donor)
        else:
            np.testing.assert_array_equal(np.sum(trial != members, axis=-1), 1)
            forced = np.argmax(trial != members, axis=-1)
            assert np.all(np.bincount(forced.ravel()) / forced.size > 0.15)


def test_the_first_members_are_uniform_in_the_box_and_the_start_is_one_of_them(device):
    scale, start = np.array([0.5, 0.01, 2.0]), np.tile([3.0, -1.0, 0.0], (400, 1))
    x = Search(3, range(400), device, scale, start).ask()
    np.testing.assert_array_equal(x[:, 0], start.astype(np.float32))
    unit = ((x[:, 1:] - start[0]) / scale).reshape(-1, 3)
    assert unit.min() >= -1.001
    assert unit.max() < 1.001
    counts = np.stack([np.histogram(column, 10, (-1.001, 1.001))[0] for column in unit.T])
    assert np.all(np.abs(counts / 3600 - 0.1) < CHANCE * np.sqrt(0.09 / 3600))
    without = Search(3, range(400), device, scale, start, include_start=False).ask()
    assert not np.any(without[:, 0] == start.astype(np.float32))
    np.testing.assert_array_equal(without[:, 1:], x[:, 1:])


@pytest.mark.parametrize("dofs", [1, 4, 9])
def test_a_known_minimum_is_found(device, dofs):
    """With 30 members; Table 3's ten crowd together too soon for exactness."""
    roles = {"placing": 15, "leading": 15, "correcting": 15}
    search = Search(dofs, range(20), device, start=np.full((20, dofs), 0.3), population=30, **roles)
    for _ in range(100):
        search.generation(sphere)
    assert np.median(sphere(search.best)) < 1e-7 * sphere(search.start[0])


@pytest.mark.parametrize("dofs", [1, 4, 9])
def test_ten_members_come_nearer_to_a_known_minimum(device, dofs):
    search = Search(dofs, range(20), device, start=np.full((20, dofs), 0.3))
    for _ in range(50):
        search.generation(sphere)
    assert np.all(sphere(search.best) < 0.5 * sphere(search.start[0]))


COSTS = {
    "flat": lambda x: np.ones(x.shape[:2]),
    "infinite": lambda x: np.full(x.shape[:2], np.inf),
    "partly infinite": lambda x: np.where(x[..., 0] > 0.1, np.inf, sphere(x)),
    "the start infinite": lambda x: np.where(sphere(x) < 0.01, np.inf, sphere(x)),
}


@pytest.mark.parametrize("scale", [0.5, 0.0])
@pytest.mark.parametrize("dofs", [1, 6])
@pytest.mark.parametrize("name", COSTS)
def test_any_cost_leaves_a_defined_answer_in_the_box(device, name, dofs, scale):
    search = Search(dofs, range(4), device, np.full(dofs, scale), np.full((4, dofs), 0.2))
    for _ in range(30):
        x, _ = search.generation(COSTS[name])
        assert np.all(np.abs(x - 0.2) <= scale + TWIN)
        assert scale or np.all(x == np.float32(0.2))
    cost = search.optimizer.state.member_cost.numpy()
    answer = search.best
    assert not np.any(np.isnan(cost))
    assert np.all(COSTS[name](answer[:, None])[:, 0] == pytest.approx(cost.min(axis=1)))
    if name in ("flat", "infinite"):
        np.testing.assert_array_equal(answer, search.start)  # the start wins ties
    elif scale:
        assert np.all(np.isfinite(cost.min(axis=1)))


def test_a_box_may_be_of_zero_width_in_some_coordinates(device):
    search = Search(4, [0, 1], device, [0.5, 0.0, 0.5, 0.0], np.full((2, 4), 0.2))
    for _ in range(100):
        x, _ = search.generation(ellipsoid)
        np.testing.assert_array_equal(x[..., [1, 3]], np.float32(0.2))
    np.testing.assert_allclose(search.best[:, [0, 2]], 0.3, atol=1e-3)


@pytest.mark.parametrize(("population", "role"), [(2, 1), (2, 2), (3, 1), (3, 3), (4, 1)])
def test_role_sets_that_exclusions_empty_are_used_whole(device, population, role):
    search = Search(3, range(10), device, population=population, placing=role, leading=role, correcting=role)
    for generation in range(30):
        x, _ = search.generation(ellipsoid)
        assert np.all(np.abs(x) <= 0.5)
        if not generation:
            continue
        parents = search.optimizer.state.parents.numpy()
        assert parents.min() >= 0
        assert parents.max() < population
    if role == 1:  # the best is then its own placing and leading member
        best = search.optimizer.state.order.numpy()[:, 0]
        search.ask()
        assert np.all(search.optimizer.state.parents.numpy()[np.arange(10), best, :2] == best[:, None])
    assert np.all(ellipsoid(search.best) <= ellipsoid(search.start))


@pytest.mark.parametrize("dofs", [6, 39])
def test_a_run_of_a_batch_is_the_single_run_bit_for_bit(device, dofs):
    seeds = [5, 900, 0]
    start = np.random.default_rng(0).normal(0, 1, (3, dofs))
    batch = Search(dofs, seeds, device, start=start)
    singles = [Search(dofs, [seed], device, start=start[run : run + 1]) for run, seed in enumerate(seeds)]
    for _ in range(15):
        batch.generation(ellipsoid)
        for single in singles:
            single.generation(ellipsoid)
    for run, single in enumerate(singles):
        for together, alone in zip(batch.state(), single.state(), strict=True):
            np.testing.assert_array_equal(together[run], alone[0])


def test_a_cut_generation_is_the_beginning_of_a_whole_one_and_breaks_nothing(device):
    cut, whole = (Search(9, [1, 2], device) for _ in range(2))
    for generation in range(3):
        before = cut.state()
        np.testing.assert_array_equal(cut.ask(3)[:, :3], whole.ask()[:, :3], err_msg=str(generation))
        for was, now in zip(before[:-1], cut.state()[:-1], strict=True):
            np.testing.assert_array_equal(was, now)
        np.testing.assert_array_equal(cut.state()[-1], before[-1] + 3)
        whole.counter.assign(cut.counter)
        for search in (cut, whole):
            search.generation(sphere)


def test_a_budget_below_one_population_begins_with_the_start(device):
    search = Search(6, [0, 1], device, start=np.full((2, 6), 0.7))
    assert search.optimizer.plan(4) == [4]
    assert search.optimizer.plan(25) == [10, 10, 5]
    np.testing.assert_array_equal(search.ask(4)[:, 0], search.start)
    for member in range(10):
        np.testing.assert_array_equal(search.optimizer.state.member.numpy()[:, member], search.start)


def test_start_begins_anew(device):
    search, fresh = (Search(6, [4, 5], device) for _ in range(2))
    for _ in range(30):
        search.generation(ellipsoid)
    search.optimizer.start(wp.zeros((2, 12), dtype=wp.float32, device=device))
    fresh.counter.assign(search.counter)
    for used, new in zip(search.state(), fresh.state(), strict=True):
        np.testing.assert_array_equal(used, new)
    for _ in range(3):
        np.testing.assert_array_equal(search.generation(ellipsoid)[0], fresh.generation(ellipsoid)[0])


@pytest.mark.parametrize("algorithm", ["de", "h-de"])
def test_a_motion_is_tracked(device, algorithm):
    result, errors = track_motion(algorithm, device, FRAMES)
    assert errors[0] < TRACKED * standing_still(FRAMES)
    assert result.iou.mean() > 0.85
    assert np.all(result.evaluations == 500)
