import numpy as np
import pytest
import scipy.stats
import warp as wp
from poisoned import poisoned

from mmocap_warp.kernels import cma_es, eigen

ORTHONORMAL = 1e-5
DECOMPOSED = 1e-5  # of the largest eigenvalue
SIGNIFICANT = 1e-3  # a right sampler fails one in a thousand seeds


def sample(seeds, draws, particles, device, mean, sigma, axes, lengths, scale, capacity=None):
    """z, y, x (run, particle, dof) of the kernel, and the counters afterwards."""
    runs, dofs = mean.shape
    z, y, x = (poisoned((runs, capacity or particles, dofs), wp.float32, device) for _ in range(3))
    draw = wp.array(draws, dtype=wp.int32, device=device)
    floats = [wp.array(values, dtype=wp.float32, device=device) for values in (mean, sigma, axes, lengths, scale)]
    cma_es.sample(wp.array(seeds, dtype=wp.int32, device=device), draw, *floats, particles, z, y, x)
    return z.numpy(), y.numpy(), x.numpy(), draw.numpy()


def some_state(runs, dofs, seed=0):
    rng = np.random.default_rng(seed)
    axes = np.stack([np.linalg.qr(rng.normal(0, 1, (dofs, dofs)))[0] for _ in range(runs)])
    return {
        "mean": rng.normal(0, 1, (runs, dofs)),
        "sigma": rng.uniform(0.1, 2, runs),
        "axes": axes,
        "lengths": rng.uniform(0.2, 3, (runs, dofs)),
        "scale": rng.uniform(0.02, 0.5, dofs),
    }


def test_samples_are_the_sum_that_is_stated(device):
    state = some_state(3, 6)
    z, y, x, _ = sample([5, 6, 7], [0, 0, 9], 10, device, **state)
    expected_y = np.einsum("rij,rj,rkj->rki", state["axes"], state["lengths"], z)
    np.testing.assert_allclose(y, expected_y, rtol=0, atol=1e-5)
    expected_x = state["mean"][:, None] + state["sigma"][:, None, None] * state["scale"] * expected_y
    np.testing.assert_allclose(x, expected_x, rtol=0, atol=1e-5)


def test_z_is_standard_normal(device):
    """20,000 candidates in blocks of 10, as a long search draws them: normal, uncorrelated across dofs and in time."""
    state = some_state(1, 6)
    draw, blocks = [0], []
    for _ in range(400):
        z, _, _, draw = sample([3], draw, 50, device, **state)
        blocks.append(z[0])
    z = np.concatenate(blocks)
    assert scipy.stats.kstest(z.ravel(), "norm").pvalue > SIGNIFICANT
    assert scipy.stats.chi2.sf(len(z) * np.sum(np.mean(z, axis=0) ** 2), 6) > SIGNIFICANT
    following = np.concatenate([z[:-1], z[1:]], axis=1)  # with the next candidate
    correlation = np.corrcoef(following.T)[np.triu_indices(12, 1)]
    assert np.abs(correlation).max() * np.sqrt(len(z)) < scipy.stats.norm.isf(SIGNIFICANT / 2 / len(correlation))


def test_runs_differ_by_their_seeds_alone(device):
    state = {
        name: np.repeat(values[:1], 3, axis=0) if name != "scale" else values
        for name, values in some_state(1, 9).items()
    }
    x = sample([4, 4, 5], [20, 20, 20], 10, device, **state)[2]
    np.testing.assert_array_equal(x[0], x[1])
    assert not np.any(x[0] == x[2])


def test_searches_that_share_a_counter_never_draw_the_same_numbers(device):
    """The parts of a hierarchy have populations of different size, and the last generation of each is cut."""
    draw, drawn = [0], []
    for dofs, capacity, asked in ((6, 9, 9), (9, 10, 10), (6, 9, 4), (9, 10, 10), (4, 8, 8), (9, 10, 3), (6, 9, 9)) * 8:
        z, _, _, draw = sample([1], draw, asked, device, capacity=capacity, **some_state(1, dofs))
        assert np.isnan(z[:, asked:]).all()
        drawn += [tuple(row[:4]) for row in z[0, :asked]]
    assert len(set(drawn)) == len(drawn)


def test_candidates_are_ranked_stably(device):
    cost = np.array([[3, 1, 2, 1, np.inf], [0, 0, 0, 0, 0]], np.float32)
    order = poisoned((2, 5), wp.int32, device)
    wp.launch(cma_es._rank, dim=(2, 5), inputs=[wp.array(cost.ravel(), device=device)], outputs=[order], device=device)
    np.testing.assert_array_equal(order.numpy(), np.argsort(cost, axis=1, kind="stable"))


def decompose(covariance, axes, device):
    runs, dofs, _ = covariance.shape
    lengths = poisoned((runs, dofs), wp.float32, device)
    work, product = (poisoned(covariance.shape, wp.float32, device) for _ in range(2))
    turn, swept = poisoned((runs, (dofs + 1) // 2), wp.vec2, device), poisoned(runs, wp.int32, device)
    matrices = [wp.array(values, dtype=wp.float32, device=device) for values in (covariance, axes)]
    eigen.decompose(*matrices, lengths, work, product, turn, swept)
    return matrices[1].numpy().astype(float), lengths.numpy().astype(float)


@pytest.mark.parametrize("dofs", [4, 6, 9, 28, 39])
@pytest.mark.parametrize("condition", [1.0, 1e2, 1e4])
def test_covariances_are_decomposed(device, dofs, condition):
    rng = np.random.default_rng(dofs)
    turn = np.stack([np.linalg.qr(rng.normal(0, 1, (dofs, dofs)))[0] for _ in range(2)])
    eigenvalues = np.geomspace(1, condition, dofs)
    covariance = np.einsum("rij,j,rkj->rik", turn, eigenvalues, turn).astype(np.float32)
    axes, lengths = decompose(covariance, np.tile(np.eye(dofs), (2, 1, 1)), device)
    np.testing.assert_allclose(axes.transpose(0, 2, 1) @ axes, np.tile(np.eye(dofs), (2, 1, 1)), atol=ORTHONORMAL)
    again = np.einsum("rij,rj,rkj->rik", axes, lengths**2, axes)
    np.testing.assert_allclose(again, covariance, rtol=0, atol=DECOMPOSED * condition)
    by_lapack = np.sqrt(np.linalg.eigvalsh(covariance.astype(float)))
    np.testing.assert_allclose(np.sort(lengths), by_lapack, rtol=0, atol=DECOMPOSED * np.sqrt(condition) * 10)
