import numpy as np
import pytest
import warp as wp
from poisoned import poisoned

from mmocap_warp.kernels.optimizers.populations import keep_best, make_limits, place


@pytest.mark.parametrize("particles", [1, 3, 4])
def test_candidates_are_placed_within_limits_over_their_runs_base(device, particles):
    """Of the four particles that the population holds, only the first ``particles`` are placed."""
    rng = np.random.default_rng(0)
    population, base = rng.normal(0, 2, (3, 4, 2)).astype(np.float32), rng.normal(0, 9, (3, 6)).astype(np.float32)
    index = np.array([4, 1])
    lower, upper = np.full(6, -np.inf, np.float32), np.full(6, np.inf, np.float32)
    lower[4], upper[4], upper[1] = -1.0, 0.5, 1.0
    pose = poisoned((12, 6), wp.float32, device)
    place(
        wp.array(population, device=device),
        wp.array(index, dtype=wp.int32, device=device),
        wp.array(base, device=device),
        make_limits(np.stack([lower, upper], axis=1), device),
        particles,
        pose,
    )
    expected = np.repeat(base, particles, axis=0)
    expected[:, index] = np.clip(population, lower[index], upper[index])[:, :particles].reshape(-1, 2)
    found = pose.numpy()
    np.testing.assert_array_equal(found[: 3 * particles], expected)
    assert np.isnan(found[3 * particles :]).all()


def after_keeping_best(costs, best, device):
    """Best costs and which candidate is kept, -1 for the incumbent; costs are (run, particle)."""
    costs = np.asarray(costs, np.float32)
    runs, particles = costs.shape
    pose = wp.array(np.arange(costs.size, dtype=np.float32)[:, None] + np.zeros((1, 2), np.float32), device=device)
    best_cost = wp.array(np.asarray(best, np.float32), device=device)
    best_pose = wp.array(np.full((runs, 2), -1, np.float32), device=device)
    keep_best(wp.array(costs.ravel(), device=device), pose, particles, best_cost, best_pose)
    assert np.ptp(best_pose.numpy(), axis=1).max() == 0
    return best_cost.numpy().tolist(), best_pose.numpy()[:, 0].tolist()


def test_each_run_keeps_its_strictly_best(device):
    found = after_keeping_best([[3, 2, 4], [0.5, 9, 0.25]], [2.5, 0.125], device)
    assert found == ([2.0, 0.125], [1.0, -1.0])


def test_the_incumbent_wins_ties_and_so_does_the_first_of_equals(device):
    found = after_keeping_best([[2, 2, 2], [1, 0.5, 0.5]], [2.0, 2.0], device)
    assert found == ([2.0, 0.5], [-1.0, 4.0])


def test_infinite_costs_never_win(device):
    found = after_keeping_best([[np.inf, np.inf], [np.inf, 7]], [np.inf, np.inf], device)
    assert found == ([np.inf, 7.0], [-1.0, 3.0])
