"""CMA-ES against a float64 twin, another package and known minima."""

import cmaes
import numpy as np
import pytest
import reference
import warp as wp

from mmocap_warp.kernels.optimizers.populations import make_space
from mmocap_warp.optimizers.cma_es import CmaEs, CmaEsConfig, CmaEsParameters

TWIN = 1e-4  # relative, after 50 generations in single precision
ORTHONORMAL = 1e-5
PRINTED = {  # lambda, mu, mueff, cs, ds, cc, ccov of the paper's Table 2, worked out
    39: (14, 7, 4.541, 0.1405, 1.1405, 0.0930, 0.00401),
    28: (13, 6, 3.981, 0.1710, 1.1710, 0.1250, 0.00635),
    9: (10, 5, 3.415, 0.3513, 1.3513, 0.3077, 0.0385),
    6: (9, 4, 2.841, 0.4088, 1.4088, 0.4000, 0.0582),
    4: (8, 4, 2.841, 0.4919, 1.4919, 0.5000, 0.1021),
}
LARGE = {  # likewise for populations that are given: so many parents are damped more
    4: (60, 30, 16.833, 0.7902, 3.3491, 0.5000, 0.5856),
    6: (41, 20, 11.567, 0.6597, 2.1170, 0.4000, 0.2707),
}


@pytest.mark.parametrize(
    ("dofs", "given", "row"),
    [*((dofs, None, row) for dofs, row in PRINTED.items()), *((dofs, row[0], row) for dofs, row in LARGE.items())],
)
def test_parameters_are_those_of_table_2(dofs, given, row):
    parameters = CmaEsParameters.for_search(dofs, given)
    population, mu, *printed = row
    assert (parameters.dofs, parameters.population) == (dofs, population)
    assert parameters.mu == len(parameters.weights) == mu
    found = (parameters.mu_eff, parameters.c_sigma, parameters.d_sigma, parameters.c_c, parameters.c_cov)
    for value, expected in zip(found, printed, strict=True):
        assert value == pytest.approx(expected, abs=0.5 * 10 ** -len(str(expected).split(".")[1]))
    assert parameters.mu_cov == parameters.mu_eff
    assert parameters.weights.sum() == pytest.approx(1.0)
    assert np.all(np.diff(parameters.weights) < 0)


@pytest.mark.parametrize("settings", [{"population": 1}, {"sigma": 0.0}, {"sigma": float("nan")}, {"sigma": np.inf}])
def test_wrong_settings_are_refused(settings):
    (name,) = settings
    with pytest.raises(ValueError, match=f"{name} must be"):
        CmaEsConfig(**settings)


class Search:
    """A search on a host-side function; columns of a wider pose vector are searched."""

    def __init__(self, dofs, seeds, device, scale=None, start=None, **settings):
        runs = len(seeds)
        self.scale = np.full(dofs, 0.5) if scale is None else np.asarray(scale, float)
        self.index = 2 * np.arange(dofs)[::-1]  # every other coordinate, from the last
        self.seed = wp.array(seeds, dtype=wp.int32, device=device)
        self.counter = wp.zeros(runs, dtype=wp.int32, device=device)
        space = make_space(self.index, self.scale, self.seed, self.counter)
        self.optimizer = CmaEs(space, 1000, CmaEsConfig(**settings))
        self.start = np.zeros((runs, dofs), np.float32) if start is None else np.asarray(start, np.float32)
        pose = np.full((runs, 2 * dofs), np.nan, np.float32)
        pose[:, self.index] = self.start
        self.optimizer.start(wp.array(pose, device=device))

    def ask(self, particles=None):
        """(run, particle, dof)."""
        return self.optimizer.ask(particles or self.optimizer.particles).numpy().astype(float)

    def generation(self, function):
        """One generation; returns its offspring and costs."""
        x = self.ask()
        cost = function(x).astype(np.float32)
        self.optimizer.tell(wp.array(cost.ravel(), device=self.seed.device))
        return x, cost

    def state(self):
        """Everything that the next generation depends on."""
        o = self.optimizer.state
        arrays = (o.mean, o.sigma, o.p_sigma, o.p_c, o.axes, o.lengths, o.generation, self.counter)
        return [array.numpy() for array in arrays]

    def covariance(self, run):
        """C (dof, dof) of a run."""
        o = self.optimizer.state
        root = o.axes.numpy()[run].astype(float) * o.lengths.numpy()[run][:, None]
        return root.T @ root


def sphere(x):
    return np.sum(x**2, axis=-1)


def ellipsoid(x):
    """Condition number 1,000, turned away from the axes."""
    dofs = x.shape[-1]
    turn = np.linalg.qr(np.random.default_rng(dofs).normal(0, 1, (dofs, dofs)))[0]
    return np.sum(1000 ** np.linspace(0, 1, dofs) * (x @ turn) ** 2, axis=-1)


def constants_of(parameters):
    return {name: getattr(parameters, name) for name in ("mu_eff", "c_sigma", "d_sigma", "c_c", "c_cov", "mu_cov")}


def relative(found, expected):
    """Largest difference over largest value."""
    return np.abs(found - expected).max() / np.abs(expected).max()


@pytest.mark.parametrize("dofs", PRINTED)
def test_fifty_generations_are_the_twins(device, dofs):
    start = np.random.default_rng(dofs).normal(0, 1, (2, dofs))
    search = Search(dofs, [11, 12], device, scale=np.linspace(0.1, 0.5, dofs), start=start)
    parameters = search.optimizer.parameters
    twins = [
        reference.CmaEs(start_, 1.0, search.scale, parameters.weights, constants_of(parameters))
        for start_ in search.start.astype(float)
    ]
    for _ in range(50):
        x, cost = search.generation(ellipsoid)
        for run, twin in enumerate(twins):
            twin.tell(x[run], cost[run])
    o = search.optimizer.state
    for run, twin in enumerate(twins):
        assert relative(o.mean.numpy()[run], twin.mean) < TWIN
        assert o.sigma.numpy()[run] == pytest.approx(twin.sigma, rel=TWIN)
        assert relative(o.p_sigma.numpy()[run], twin.p_sigma) < TWIN
        assert relative(o.p_c.numpy()[run], twin.p_c) < TWIN
        assert relative(search.covariance(run), twin.C) < TWIN


def test_a_search_too_wide_for_shared_memory_is_the_twins(device):
    search = Search(90, [11], device)
    parameters = search.optimizer.parameters
    twin = reference.CmaEs(search.start[0], 1.0, search.scale, parameters.weights, constants_of(parameters))
    for _ in range(5):
        x, cost = search.generation(ellipsoid)
        twin.tell(x[0], cost[0])
    assert relative(search.optimizer.state.mean.numpy()[0], twin.mean) < TWIN
    assert relative(search.covariance(0), twin.C) < TWIN


def test_of_equal_costs_the_first_ranks_first(device):
    search = Search(6, [3], device)
    parameters = search.optimizer.parameters
    twin = reference.CmaEs(search.start[0], 1.0, search.scale, parameters.weights, constants_of(parameters))
    for _ in range(20):
        x, cost = search.generation(lambda x: np.where(x[..., 1] > 0, np.inf, np.sign(x[..., 0])))
        twin.tell(x[0], cost[0])
    assert relative(search.optimizer.state.mean.numpy()[0], twin.mean) < TWIN


@pytest.mark.parametrize("dofs", [6, 39])
def test_eigenvectors_stay_orthonormal_over_a_long_search(device, dofs):
    """They are carried from generation to generation, so that rounding could add up."""
    search = Search(dofs, [11, 12], device, start=np.ones((2, dofs)))
    for _ in range(300):
        search.generation(ellipsoid)
    for axes in search.optimizer.state.axes.numpy().astype(float):
        assert np.abs(axes @ axes.T - np.eye(dofs)).max() < ORTHONORMAL


def test_a_long_path_stalls_the_rank_one_update_as_in_the_twin(device):
    """On a slope the step-size path grows: h_sigma is 0 at times, and C keeps its variance."""
    search = Search(6, [3], device)
    parameters = search.optimizer.parameters
    twin = reference.CmaEs(np.zeros(6), 1.0, search.scale, parameters.weights, constants_of(parameters))
    for _ in range(20):
        x, cost = search.generation(lambda x: x[..., 0])
        twin.tell(x[0], cost[0])
    assert 0 < twin.stalls < 20
    assert relative(search.covariance(0), twin.C) < TWIN
    assert search.optimizer.state.sigma.numpy()[0] == pytest.approx(twin.sigma, rel=TWIN)


@pytest.mark.parametrize("dofs", [6, 39])
def test_the_package_cmaes_learns_the_same(device, dofs):
    """M. Nomura's package with Table 2's constants: weights (none negative), c1 + cmu = ccov, generations from 1."""
    search = Search(dofs, [8], device, scale=np.ones(dofs), start=np.full((1, dofs), 2.0))
    parameters = search.optimizer.parameters
    other = cmaes.CMA(mean=np.full(dofs, 2.0), sigma=1.0, population_size=parameters.population)
    other._weights = np.concatenate([parameters.weights, np.zeros(parameters.population - parameters.mu)])
    other._mu, other._mu_eff = parameters.mu, parameters.mu_eff
    other._c_sigma, other._d_sigma, other._cc = parameters.c_sigma, parameters.d_sigma, parameters.c_c
    other._c1, other._cmu = parameters.c_cov / parameters.mu_cov, parameters.c_cov * (1 - 1 / parameters.mu_cov)
    other._g = -1  # it counts from 2 in the correction of h_sigma
    for _ in range(50):
        x, cost = search.generation(ellipsoid)
        other.tell(list(zip(x[0], cost[0], strict=True)))
    o = search.optimizer.state
    assert relative(o.mean.numpy()[0], other._mean) < TWIN
    assert o.sigma.numpy()[0] == pytest.approx(other._sigma, rel=TWIN)
    assert relative(search.covariance(0), other._C) < TWIN


@pytest.mark.parametrize(("function", "evaluations"), [(sphere, 4000), (ellipsoid, 12000)])
@pytest.mark.parametrize("dofs", [4, 9, 28])
def test_known_minima_are_found(device, function, evaluations, dofs):
    search = Search(dofs, range(5), device, start=np.full((5, dofs), 1.5))
    for _ in range(evaluations // search.optimizer.particles):
        search.generation(function)
    assert function(search.optimizer.state.mean.numpy()).max() < 1e-6 * function(search.start).min()


def test_a_flat_neighbourhood_widens_the_step(device):
    """Table 2's constants alone would shrink or keep the step at random; equal costs tell to look further."""
    search = Search(6, range(8), device)
    for _ in range(10):
        search.generation(lambda x: np.zeros(x.shape[:2]))
    assert search.optimizer.state.sigma.numpy().min() > 5.0


@pytest.mark.parametrize(("dofs", "equal"), [(4, 6), (6, 7), (9, 7), (39, 10)])
def test_a_generation_is_flat_where_its_best_seventy_percent_are_equal(device, dofs, equal):
    """Candidates rank alike in all three searches; the flat one's sigma is wider by exp(0.2 + c_sigma / d_sigma)."""
    sigma = {}
    for best in (1, equal - 1, equal):  # how many share the lowest cost; the first ranks first
        search = Search(dofs, [3], device)
        ranks = np.maximum(np.arange(search.optimizer.particles), best - 1)
        search.generation(lambda x, ranks=ranks: ranks[None].astype(float))
        sigma[best] = search.optimizer.state.sigma.numpy()[0]
    parameters = search.optimizer.parameters
    assert equal == np.ceil(0.7 * parameters.population)
    assert sigma[equal - 1] == sigma[1]
    widened = np.exp(0.2 + parameters.c_sigma / parameters.d_sigma)
    assert sigma[equal] == pytest.approx(widened * sigma[1], rel=1e-5)


def test_infinite_costs_do_no_harm(device):
    """Where most offspring cannot be judged, the search goes on with the others."""
    search = Search(6, range(3), device, start=np.ones((3, 6)))
    for _ in range(60):
        search.generation(lambda x: np.where(x[..., 0] > 1.0, np.inf, sphere(x)))
    assert all(np.isfinite(values).all() for values in search.state())
    assert sphere(search.optimizer.state.mean.numpy()).max() < 0.1


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
    for search in (cut, whole):
        search.generation(sphere)
    before = cut.state()
    first = cut.ask(3)[:, :3]
    np.testing.assert_array_equal(first, whole.ask()[:, :3])
    for name, (was, now) in enumerate(zip(before[:-1], cut.state()[:-1], strict=True)):
        np.testing.assert_array_equal(was, now, err_msg=str(name))
    for _ in range(300):
        cut.generation(sphere)
    assert sphere(cut.optimizer.state.mean.numpy()).max() < 1e-6


def test_start_begins_anew(device):
    search = Search(6, [4, 5], device)
    for _ in range(30):
        search.generation(ellipsoid)
    fresh = Search(6, [4, 5], device)
    pose = np.zeros((2, 12), np.float32)
    search.optimizer.start(wp.array(pose, device=device))
    for used, new in zip(search.state()[:-1], fresh.state()[:-1], strict=True):
        np.testing.assert_array_equal(used, new)


def test_the_population_may_be_set(device):
    search = Search(4, [0], device, population=20, sigma=0.25)
    assert search.ask().shape == (1, 20, 4)
    assert search.optimizer.parameters.mu == 10
    assert search.optimizer.state.sigma.numpy()[0] == 0.25
