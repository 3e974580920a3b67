"""The search of a frame: the budget's order, and that neither renderer, threads nor held parts change its answer."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from body_parts import hierarchical, holistic
from synthetic import SKELETON, synthetic_subject
from tracked_motion import FPS, RIG, motion

from mmocap_warp.kernels.optimizers.populations import make_space
from mmocap_warp.optimizers.minimize import minimize
from mmocap_warp.optimizers.pso import Pso
from mmocap_warp.optimizers.search import Search, share_budget
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker

ROOT = np.arange(3, 6)  # its angles
HIERARCHICAL = [name for name, algorithm in ALGORITHMS.items() if algorithm.hierarchical]


def tracked(device: str, change=None, frames: int = 2, **settings) -> list[np.ndarray]:
    """Poses and costs of each frame; ``change`` may alter the tracker before."""
    tracker = Tracker(
        synthetic_subject(),
        RIG,
        TrackConfig(**({"algorithm": "h-cmaes", "device": device, "threads": 1} | settings)),
        FPS,
    )
    if change:
        change(tracker)
    answers = [tracker.step(observation) for observation in motion(device)[1][1 : 1 + frames]]
    return [value for answer in answers for value in (answer.pose, answer.cost)]


def assert_same_bits(some: list[np.ndarray], others: list[np.ndarray]) -> None:
    for one, other in zip(some, others, strict=True):
        np.testing.assert_array_equal(one, other)


def never_hold(tracker: Tracker) -> None:
    tracker.search.objective.hold = lambda base, index: None


@pytest.mark.parametrize("algorithm", HIERARCHICAL)
def test_holding_what_stays_does_not_change_the_answer(device, algorithm):
    """Several runs; 340 evaluations are 57 or 56 a part, so that generations of ten, or nine, are cut at the end."""
    settings = {"algorithm": algorithm, "runs": 3, "evaluations": 340}
    assert_same_bits(tracked(device, **settings), tracked(device, never_hold, **settings))


@pytest.mark.parametrize("dof", [39, 28])
@pytest.mark.parametrize("algorithm", ["h-cmaes", "cmaes"])
def test_the_renderer_does_not_change_the_answer(device, algorithm, dof):
    settings = {"algorithm": algorithm, "runs": 2, "dof": dof, "evaluations": 200}
    assert_same_bits(*(tracked(device, renderer=renderer, **settings) for renderer in ("raycast", "raster")))


@pytest.mark.parametrize("renderer", ["raycast", "raster"])
def test_threads_do_not_change_the_answer(renderer):
    settings = {"runs": 3, "evaluations": 150, "renderer": renderer}
    one = tracked("cpu", **settings)
    for threads in (2, 5):
        assert_same_bits(tracked("cpu", threads=threads, **settings), one)


def calls_of(tracker: Tracker) -> list[tuple]:
    """What the objective is told from now on: parts held with their bases, candidates judged, and parts released."""
    calls, objective = [], tracker.search.objective
    hold, evaluate, release = objective.hold, objective.evaluate, objective.release

    def held(base: wp.array, index: np.ndarray) -> None:
        calls.append(("hold", tuple(index), base.numpy().copy()))
        hold(base, index)

    def evaluated(candidates: int) -> wp.array:
        calls.append(("evaluate", candidates))
        return evaluate(candidates)

    def released() -> None:
        calls.append(("release",))
        release()

    objective.hold, objective.evaluate, objective.release = held, evaluated, released
    return calls


@pytest.mark.parametrize(("algorithm", "strategy"), [("h-cmaes", hierarchical), ("cmaes", holistic)])
def test_parts_are_held_one_after_the_other_at_the_best_so_far(device, algorithm, strategy):
    tracker = Tracker(synthetic_subject(), RIG, TrackConfig(algorithm, evaluations=100, device=device), FPS)
    tracker.step(motion(device)[1][0])
    start = tracker.state.pose
    tracker.search._replays = False
    calls = calls_of(tracker)
    answer = tracker.step(motion(device)[1][1])
    parts = [part.index for part in strategy(SKELETON, 39)]
    held = [call for call in calls if call[0] == "hold"]
    assert [call[1] for call in held] == [tuple(index) for index in parts]
    assert calls[0] == ("evaluate", 1)  # the pose carried over, before anything is held
    bases = [call[2] for call in held]
    np.testing.assert_array_equal(np.delete(bases[0], ROOT, axis=1), np.delete(start, ROOT, axis=1))
    assert not bases[0][:, ROOT].any()  # counted from where they were
    for index, before, after in zip(parts[:-1], bases[:-1], bases[1:], strict=True):
        np.testing.assert_array_equal(np.delete(before, index, axis=1), np.delete(after, index, axis=1))
    kept = np.r_[ROOT, parts[-1]]
    np.testing.assert_array_equal(np.delete(answer.pose, kept, axis=1), np.delete(bases[-1], kept, axis=1))
    assert calls[-2:] == [("release",), ("evaluate", 1)]  # the answer is looked at as a whole


@pytest.mark.parametrize("evaluations", [0, 1, 5, 6, 499, 2999])
@pytest.mark.parametrize("parts", [1, 6])
def test_budgets_are_shared_evenly_and_wholly(evaluations, parts):
    shares = share_budget(evaluations, parts)
    assert sum(shares) == evaluations
    assert len(shares) == parts
    assert max(shares) - min(shares) <= 1
    assert shares == sorted(shares, reverse=True)


class Nowhere:
    """An objective that is never evaluated."""

    device = "cpu"

    def prepare(self, runs, index):
        pass


@pytest.mark.parametrize("parts", [1, 6])
def test_inertia_falls_over_exactly_the_moves_of_every_budget(parts):
    """From 60 to 3000 evaluations, whatever the swarms were made for: its last move weighs by the least inertia."""
    seed, counter = (wp.zeros(1, dtype=wp.int32, device="cpu") for _ in range(2))
    swarms = [Pso(make_space(np.array([i]), np.ones(1), seed, counter), 3000) for i in range(parts)]
    limits = np.tile([-np.inf, np.inf], (parts, 1))
    for evaluations in range(60, 3001):
        search = Search(Nowhere(), swarms, evaluations, limits)
        assert search.evaluations == evaluations
        for swarm, sizes in zip(swarms, search._sizes, strict=True):
            moves = len(sizes) - 1  # one between two generations, the last of which may be cut
            assert swarm._parameters.inertia_changes == max(1, moves - 1), evaluations


@pytest.mark.parametrize("plan", [[10] * 40, [50, 50]], ids=["the budget", "room"])
def test_a_plan_beyond_what_it_may_be_is_refused(plan):
    class Beyond(Pso):
        def plan(self, evaluations: int) -> list[int]:
            return plan

    with pytest.raises(ValueError, match=r"Beyond.plan may have at most 199 candidates, 10 at a time, got \["):
        minimize(lambda points: (points**2).sum(axis=1), np.ones(3), 1.0, 200, optimizer=Beyond)


def test_seeds_that_no_run_can_have_are_refused():
    for seed in (-1, 2**31):
        with pytest.raises(ValueError, match="seed must be in 0"):
            minimize(lambda x, out: None, np.zeros(2), 1.0, 10, seed=seed, device="cpu")
