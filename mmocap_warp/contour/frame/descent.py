"""Damped Gauss-Newton steps that are taken back where the cost would rise (Levenberg-Marquardt).

A rise within the noise of matching is let pass. Where none was, bodies got stuck far from the best one: on
``scenes/walk`` hips stayed 21 mm off, and with it 4 mm.
"""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np

RAISE = 10.0
_NOISE = 0.1  # by so much of the lowest the objective may rise: a step matches outlines anew, and some find none
STOP = 1e-4  # the largest step that is not worth another [m, rad]


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

    A step that would raise it is not taken; the next is damped ten times as much in the frames whose own cost rose,
    and in all frames where that is not enough. A step taken lowers the damping again, as far as 1.

    Args:
        problem: what is minimised.
        state: where to start.
        equations: the problem around it.
        steps: how many are tried at most; fewer where a step becomes tiny.
    """
    damping = np.ones(len(equations.cost))
    refused = False
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
