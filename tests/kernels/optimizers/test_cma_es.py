import numpy as np
import scipy.stats
import warp as wp
from poisoned import poisoned

from mmocap_warp.kernels.optimizers import cma_es
from mmocap_warp.kernels.optimizers.populations import make_space

SIGNIFICANT = 1e-3  # a right sampler fails one in a thousand seeds


def sample(seeds, counters, particles, device, capacity=None, **given):
    """z, x (run, particle, dof) of the kernel, and the counters afterwards."""
    runs, dofs = given["mean"].shape
    seed, counter = (wp.array(values, dtype=wp.int32, device=device) for values in (seeds, counters))
    space = make_space(np.arange(dofs), given["radius"], seed, counter)
    state = cma_es.CmaEsState()
    for name in ("mean", "sigma", "axes", "lengths"):
        setattr(state, name, wp.array(given[name], dtype=wp.float32, device=device))
    state.z, state.x = (poisoned((runs, capacity or particles, dofs), wp.float32, device) for _ in range(2))
    cma_es.sample(space, particles, state)
    return state.z.numpy(), state.x.numpy(), counter.numpy()


def some_state(runs, dofs, seed=0):
    rng = np.random.default_rng(seed)
    axes = np.stack([np.linalg.qr(rng.normal(0, 1, (dofs, dofs)))[0] for _ in range(runs)])
    return {
        "mean": rng.normal(0, 1, (runs, dofs)),
        "sigma": rng.uniform(0.1, 2, runs),
        "axes": axes,
        "lengths": rng.uniform(0.2, 3, (runs, dofs)),
        "radius": rng.uniform(0.02, 0.5, dofs),
    }


def test_samples_are_the_sum_that_is_stated(device):
    state = some_state(3, 6)
    z, x, counter = sample([5, 6, 7], [0, 0, 9], 10, device, **state)
    y = np.einsum("rji,rj,rkj->rki", state["axes"], state["lengths"], z)
    expected = state["mean"][:, None] + state["sigma"][:, None, None] * state["radius"] * y
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-5)
    assert counter.tolist() == [10, 10, 19]


def test_z_is_standard_normal(device):
    """20,000 candidates in blocks of 10, as a long search does: normal, uncorrelated across dofs and in time."""
    state = some_state(1, 6)
    counter, blocks = [0], []
    for _ in range(400):
        z, _, counter = sample([3], counter, 50, device, **state)
        blocks.append(z[0])
    z = np.concatenate(blocks)
    assert scipy.stats.kstest(z.ravel(), "norm").pvalue > SIGNIFICANT
    assert scipy.stats.chi2.sf(len(z) * np.sum(np.mean(z, axis=0) ** 2), 6) > SIGNIFICANT
    following = np.concatenate([z[:-1], z[1:]], axis=1)  # with the next candidate
    correlation = np.corrcoef(following.T)[np.triu_indices(12, 1)]
    assert np.abs(correlation).max() * np.sqrt(len(z)) < scipy.stats.norm.isf(SIGNIFICANT / 2 / len(correlation))


def test_runs_differ_by_their_seeds_alone(device):
    state = {
        name: np.repeat(values[:1], 3, axis=0) if name != "radius" else values
        for name, values in some_state(1, 9).items()
    }
    x = sample([4, 4, 5], [20, 20, 20], 10, device, **state)[1]
    np.testing.assert_array_equal(x[0], x[1])
    assert not np.any(x[0] == x[2])


def test_searches_that_share_a_counter_never_sample_the_same_numbers(device):
    """The parts of a hierarchy have populations of different size, and the last generation of each is cut."""
    counter, sampled = [0], []
    for dofs, capacity, asked in ((6, 9, 9), (9, 10, 10), (6, 9, 4), (9, 10, 10), (4, 8, 8), (9, 10, 3), (6, 9, 9)) * 8:
        z, _, counter = sample([1], counter, asked, device, capacity=capacity, **some_state(1, dofs))
        assert np.isnan(z[:, asked:]).all()
        sampled += [tuple(row[:4]) for row in z[0, :asked]]
    assert len(set(sampled)) == len(sampled)
