"""The annealed particle filter as a tracker runs it: whole frames, their budget and their answer."""

import numpy as np
import pytest
from annealed_twin import Twin
from tracked_motion import motion, track_motion, tracker_of

from mmocap_warp.tracking.tracker import TrackState

TWIN = 1e-5  # of coordinates about 1, over a whole search in single precision
TRACKED = {"apf": 0.025, "psapf": 0.035}  # [m], mean marker error


@pytest.mark.parametrize(("algorithm", "partitions"), [("apf", [39]), ("psapf", [6, 9, 6, 6, 6, 6])])
def test_ten_frames_are_the_twins(device, monkeypatch, algorithm, partitions):
    """The hand-over from frame to frame included, in which the root's angles come to be counted from elsewhere.

    With 7 and 43 particles, as half of an even number may share the best cost: then many exponents solve Eq. 8.
    """
    tracker, _calls = tracker_of(algorithm, device, evaluations=430, runs=2)
    search = tracker.search
    search._replays = False
    (optimizer,) = search._optimizers
    index, scale = optimizer.space.index.numpy(), optimizer.space.radius.numpy().astype(float)
    twins = [Twin(scale, optimizer.particles, partitions) for _ in (0, 1)]
    start, tell = optimizer.start, optimizer.tell
    layers = []

    def started(pose):
        for twin, own in zip(twins, pose.numpy(), strict=True):
            twin.start(own[index].astype(float))
        start(pose)

    def told(cost):
        x, costs = optimizer.population.numpy(), cost.numpy()[: 2 * optimizer.particles].reshape(2, -1).astype(float)
        tell(cost)
        for run, twin in enumerate(twins):
            noise, uniform = (getattr(optimizer.state, name).numpy()[run] for name in ("noise", "uniform"))
            assert np.abs(x[run] - twin.ask(noise.astype(float))).max() < TWIN
            twin.tell(costs[run], uniform.astype(float))
            np.testing.assert_array_equal(optimizer.state.parent.numpy()[run], twin.parent)
        layers.append(len(costs))

    monkeypatch.setattr(optimizer, "start", started)
    monkeypatch.setattr(optimizer, "tell", told)
    _truth, seen = motion(device)
    for frame in range(10):
        answer = tracker.step(seen[frame % 6])
        means = optimizer.state.mean.numpy()
        for run, twin in enumerate(twins):
            assert np.abs(means[run] - twin.mean).max() < TWIN
        there = np.clip(means, search._limits.lower.numpy()[index], search._limits.upper.numpy()[index])
        still = ~np.isin(index, [3, 4, 5])
        np.testing.assert_array_equal(answer.pose[:, index][:, still], there[:, still])
    assert len(layers) == 10 * 10 * len(partitions)


@pytest.mark.parametrize("algorithm", ["apf", "psapf"])
def test_a_motion_is_tracked(device, algorithm):
    result, errors = track_motion(algorithm, device, runs=2)
    assert np.all(errors < TRACKED[algorithm])
    assert np.all(result.evaluations == {"apf": 500, "psapf": 480}[algorithm])
    single, _ = track_motion(algorithm, device, frames=2, seed=1)
    np.testing.assert_array_equal(result.pose[1, :2], single.pose[0])
    assert not np.array_equal(result.pose[0], result.pose[1])


@pytest.mark.parametrize(
    ("algorithm", "evaluations", "spent"),
    [
        ("apf", 1, 0),
        ("apf", 7, 6),
        ("apf", 500, 500),
        ("psapf", 1, 0),
        ("psapf", 5, 4),
        ("psapf", 83, 82),
        ("psapf", 500, 480),
    ],
)
def test_a_frame_costs_whole_layers_within_its_budget(device, algorithm, evaluations, spent):
    tracker, calls = tracker_of(algorithm, device, evaluations=evaluations, runs=2)
    truth, seen = motion(device)
    answer = tracker.step(seen[1])
    assert answer.evaluations == spent
    assert calls.pop() == 2  # the cost of the answer, which was none of the particles
    assert sum(calls) == 2 * spent
    assert np.isfinite(answer.cost).all()
    if spent == 0:
        np.testing.assert_array_equal(answer.pose, np.tile(truth[0].astype(np.float32), (2, 1)))


def test_the_answer_is_the_estimate_within_the_limits_and_its_own_cost(device):
    """Not the best particle, and not what an earlier frame found."""
    tracker, _calls = tracker_of("apf", device, evaluations=100, rotation_radius=0.8)
    _truth, seen = motion(device)
    tracker.step(seen[0])
    answer = tracker.step(seen[1])
    search = tracker.search
    optimizer = search._optimizers[0]
    estimate = optimizer.state.mean.numpy()[0]
    lower, upper = search._limits.lower.numpy(), search._limits.upper.numpy()
    index = optimizer.space.index.numpy()
    np.testing.assert_array_equal(answer.pose[0][index], np.clip(estimate, lower[index], upper[index]))
    assert np.any(estimate != answer.pose[0][index])
    other, _calls = tracker_of("h-cmaes", device, evaluations=1)
    other.state = TrackState(answer.pose, np.zeros(1, np.int32))
    assert other.step(seen[1]).cost[0] == answer.cost[0]
