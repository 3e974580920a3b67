"""Damped Gauss-Newton steps that are taken back where the cost would rise (Levenberg-Marquardt).

A rise within the noise of matching is allowed. Without that, bodies got stuck far from the best one: on
``scenes/walk`` hips stayed 21 mm off, and with it 4 mm.
"""

from typing import Protocol, TypeVar

import numpy as np

from mmocap_warp.contour.frame.normal_equations import NormalEquations

RAISE = 10.0  # factor by which damping grows after a step that was not taken, and falls after one that was
STOP = 1e-4  # a descent ends after a step that moved no coordinate further than this [m, rad]
_NOISE = 0.1  # share of the lowest objective that a step may add: it matches outlines anew, and some find none
LARGEST_STEP = 0.2  # no coordinate moves further in a step [m, rad]

_STEP_LENGTH, _STEP_ANGLE = 0.05, 0.15  # standard deviations of a step, of lengths [m] and angles [rad]
_DIAGONAL_SHARE = 1e-3  # share of the diagonal that damping adds, so that what is seen well is damped too
_UNSEEN = 1e-3  # damping of a frame that shows nothing, as a share: it follows its neighbours and may move far


class Linearised(Protocol):
    """A problem around one state."""

    @property
    def cost(self) -> np.ndarray:
        """(frame,) the objective's share of each frame."""

    @property
    def shared_cost(self) -> float:
        """What of the objective belongs to no frame."""


State = TypeVar("State")
Equations = TypeVar("Equations", bound=Linearised)


class Problem(Protocol[State, Equations]):
    """What is minimised."""

    def linearised(self, state: State) -> Equations:
        """The problem around a state."""

    def stepped(self, state: State, equations: Equations, damping: np.ndarray) -> tuple[State, float]:
        """The state after a step with damping (frame,), 1 or more, and the step's largest coordinate."""


def objective(equations: Linearised) -> float:
    """The whole cost."""
    return float(equations.cost.sum()) + equations.shared_cost


def descend(
    problem: Problem[State, Equations], state: State, equations: Equations, steps: int
) -> tuple[State, Equations]:
    """The state after some steps, none of which raised the objective beyond its noise, and the problem around it.

    A step that would raise it is not taken; the next is damped ten times as much in the frames whose own cost rose, and
    in all frames where that is not enough. A step that is taken lowers the damping again, at least to 1. There are
    fewer steps where one becomes tiny.
    """
    damping, refused = np.ones(len(equations.cost)), False
    lowest = objective(equations)
    for _ in range(steps):
        moved, largest = problem.stepped(state, equations, damping)
        there = problem.linearised(moved)
        if objective(there) <= lowest * (1.0 + _NOISE):
            state, equations = moved, there
            lowest = min(lowest, objective(there))
            damping = np.maximum(damping / RAISE, 1.0)
            refused = False
            if largest < STOP:
                break
        else:
            rose = there.cost > equations.cost
            damping = np.where(rose | refused | ~rose.any(), damping * RAISE, damping)
            refused = True
    return state, equations


class Trust:
    """What damping adds to each frame's normal equations, of lengths and angles (dof,): a weak pull to where it is."""

    def __init__(self, is_length: np.ndarray) -> None:
        self._information = np.where(is_length, _STEP_LENGTH, _STEP_ANGLE) ** -2.0
        self._dof = len(is_length)

    def alone(self, damping: float) -> np.ndarray:
        """(dof, dof) of coordinates that all frames share, whatever is seen of them."""
        return np.asarray(np.diag(damping * self._information))

    def matrix(self, contour: NormalEquations, damping: np.ndarray) -> np.ndarray:
        """(frame, dof, dof) diagonal matrices to add to normal matrices, for damping (frame,), 1 or more."""
        seen = np.einsum("fdd->fd", contour.matrix)[:, : self._dof]
        information = np.where(contour.observed[:, None], 1.0, _UNSEEN) * self._information
        pull = damping[:, None] * (information + _DIAGONAL_SHARE * (seen + information))
        return np.asarray(pull[:, :, None] * np.eye(self._dof))
