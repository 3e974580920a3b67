"""A clip as one problem: found where the answer is known, in windows as in one, and where frames show nothing."""

from __future__ import annotations

import numpy as np
import pytest
from other_bodies import arm_robot, quadruped
from planted import Planted, swung
from synthetic import synthetic_body

from mmocap_warp.body.rotations import turn
from mmocap_warp.contour.clip import ClipProblem, ClipSolution
from mmocap_warp.contour.rooted import Rooting

HOME = turn("x", 1.3) @ turn("z", 0.4)
BODIES = {"person": synthetic_body(), "dog": quadruped(), "arm": arm_robot()}


class Case:
    """A body that swings, points that show it with noise, and poses to start from."""

    def __init__(self, body=BODIES["person"], frames=40, rate=60.0, noise=0.0, sigma=0.002, hidden=(), off=0.03):
        rng = np.random.default_rng(7)
        self.pose = swung(body, frames, rate)
        self.rooting = Rooting(body.skeleton, HOME, body.skeleton.searched())
        self.rooted = self.rooting.enter(self.pose)
        shown = np.full(frames, sigma)
        shown[list(hidden)] = np.inf
        planted = Planted(body, self.rooting, np.zeros((frames, 1)), shown)
        self.truth = planted.points.at(self.rooted)
        planted.target = self.truth + rng.normal(0, noise, self.truth.shape)
        self.problem = ClipProblem(planted, self.rooting, planted.points, rate)
        self.planted = planted
        self.start = self.rooting.stepped(self.rooted, rng.normal(0, off, (frames, len(self.rooting.searched))))

    def error(self, solution: ClipSolution) -> np.ndarray:
        """(frame,) how far the furthest point is from the truth [m]."""
        return np.linalg.norm(self.planted.points.at(solution.rooted) - self.truth, axis=2).max(axis=1)


@pytest.mark.parametrize("name", BODIES)
def test_what_is_seen_well_is_found_for_any_skeleton(name):
    case = Case(BODIES[name])
    solution = case.problem.solved(case.start)
    assert solution.observed.all()
    assert case.error(solution).max() < 0.001
