"""Damped steps never raise the objective, and only frames that rose are held back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.contour.frame.descent import descend, objective


@dataclass
class Around:
    """What the steps need to know of a state."""

    cost: np.ndarray
    slope: np.ndarray
    shared_cost: float = 0.0


class Valleys:
    """A number for each frame, whose cost is ``size(x)``; steps believe that its curvature is ``curvature``."""

    def __init__(self, curvature: np.ndarray, shared: float = 0.0) -> None:
        self.curvature, self.shared = curvature, shared
        self.damping: list[np.ndarray] = []
        self.objectives: list[float] = []

    def linearised(self, state: np.ndarray) -> Around:
        around = Around(np.sqrt(1 + state**2), state / np.sqrt(1 + state**2), self.shared * float(state.sum()))
        self.objectives.append(objective(around))
        return around

    def stepped(self, state: np.ndarray, equations: Around, damping: np.ndarray) -> tuple[np.ndarray, float]:
        self.damping.append(damping)
        step = -equations.slope / (self.curvature * damping)
        return state + step, float(np.abs(step).max())


def fallen(problem: Valleys, start: np.ndarray, steps: int) -> tuple[np.ndarray, Around]:
    return descend(problem, start, problem.linearised(start), steps)


def test_a_step_that_would_raise_the_objective_beyond_its_noise_is_not_taken():
    problem = Valleys(np.array([0.01, 1.0]))  # the first frame's steps are far too long
    state, around = fallen(problem, np.array([3.0, 3.0]), 20)
    assert objective(around) <= 1.1 * min(problem.objectives)
    assert np.abs(state).max() < 0.2
    assert len(problem.damping) <= 20


def test_only_the_frame_that_rose_is_damped_and_is_let_go_again():
    problem = Valleys(np.array([0.1, 1.0]))
    fallen(problem, np.array([3.0, 3.0]), 3)
    assert problem.damping[0].tolist() == [1, 1]
    assert problem.damping[1].tolist() == [10, 1]
    assert problem.damping[2].max() <= 10


def test_all_frames_are_damped_where_none_rose_by_itself():
    problem = Valleys(np.array([1.0, 1.0]), shared=-10.0)
    state, _ = fallen(problem, np.array([3.0, 3.0]), 4)
    assert (state == 3.0).all()
    assert [damping.tolist() for damping in problem.damping] == [[10**k, 10**k] for k in range(4)]


def test_it_stops_where_steps_are_tiny():
    problem = Valleys(np.array([1.0]))
    fallen(problem, np.array([1e-6]), 50)
    assert len(problem.damping) == 1
