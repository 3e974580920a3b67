"""Steps that kernels solve are those of NumPy's band."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from other_bodies import arm_robot
from planted import Planted, swung
from synthetic import synthetic_body

from mmocap_warp.contour.clip.clip_problem import ClipProblem
from mmocap_warp.contour.clip.device_band import DeviceBand, Motion
from mmocap_warp.contour.clip.motion_penalty import HELD, MotionPenalty
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.clip.uncertainty import Deviations
from mmocap_warp.contour.frame.normal_equations import NormalEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting

BODIES = {"person": synthetic_body(), "arm": arm_robot()}
ROOM, RATE = 13, 30.0
PENALTY = MotionPenalty(3.0, RATE)
OUTPUTS = "panel", "solution", "given", "covariance"


class Case:
    """A body that moves, room for its frames, and what each frame says."""

    def __init__(self, name: str, device: str) -> None:
        body = BODIES[name]
        self.points = MotionPoints(body.skeleton, body.joint_rest, body.skeleton.searched())
        rows, dof = ROOM + HELD, len(self.points.searched)
        rng = np.random.default_rng(0)
        self.rooted = RootedPoses(np.tile(np.eye(3), (rows, 1, 1)), swung(body, rows, RATE))
        jacobian = rng.normal(size=(ROOM, 2 * dof, dof))
        self.own = NormalEquations(
            20.0 * np.swapaxes(jacobian, 1, 2) @ jacobian, rng.normal(size=(ROOM, dof)), np.zeros(ROOM)
        )
        self.band = DeviceBand(self.points, ROOM, device)
        for array in (self.band._course.slope, *(getattr(self.band._band, name) for name in OUTPUTS)):
            array.fill_(np.nan)

    def solved(self, held: int, frames: int) -> np.ndarray:
        """The kernels' step."""
        rooted, seen = self.rooted[: held + frames], np.arange(held + frames) != 4
        return self.band.solved(Motion(self.points, rooted, PENALTY, seen), held, self.own[:frames])

    def expected(self, held: int, frames: int) -> np.ndarray:
        """NumPy's."""
        rooted, seen = self.rooted[: held + frames], np.arange(held + frames) != 4
        motion = PENALTY.around(*self.points.linearised(rooted), seen).without_first(held)
        own = self.own[:frames]
        return (motion.band + own.matrix).solved(own.gradient + motion.gradient)


@pytest.mark.parametrize("name", BODIES)
def test_steps_are_those_of_the_band(name, device):
    case = Case(name, device)
    for held, frames in [(HELD, ROOM), (2, 8), (0, 2), (0, 1)] * 2:  # the second time from graphs
        step, expected = case.solved(held, frames), case.expected(held, frames)
        np.testing.assert_allclose(step, expected, rtol=1e-8, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("name", BODIES)
def test_inverses_are_those_of_the_band(name, device):
    case = Case(name, device)
    for frames in [ROOM, 1, 2, 8] * 2:
        rooted, own = case.rooted[:frames], case.own.matrix[:frames]
        seen = np.arange(frames) != 4
        inverse = case.band.inverse_diagonal(Motion(case.points, rooted, PENALTY, seen), own)
        motion = PENALTY.around(*case.points.linearised(rooted), seen)
        expected = (motion.band + own).inverse_diagonal()
        np.testing.assert_allclose(inverse, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())


def test_a_clip_and_its_deviations_are_those_of_the_host(device):
    """In two windows, over frames that show nothing."""
    body, frames = BODIES["arm"], 34
    rooting = Rooting(body.skeleton, np.eye(3), body.skeleton.searched())
    rooted = rooting.enter(swung(body, frames, 10.0))
    planted = Planted(body, rooting, np.zeros((frames, 1)), np.where(np.arange(frames) % 9 < 2, np.inf, 0.004))
    planted.target = planted.points.at(rooted) + np.random.default_rng(1).normal(0, 0.004, (frames, 1, 3))
    on_host = ClipProblem(planted, rooting, planted.points, 10.0)
    poses, sigma = [], []
    for problem in (on_host, replace(on_host, band=DeviceBand(planted.points, 26, device))):
        windows, deviations = list(problem.windows(rooted)), Deviations(problem, 4.0)
        assert len(windows) == 2
        poses.append(np.concatenate([window.rooted.pose[: window.final] for window in windows]))
        sigma.append(np.concatenate([deviations.of(window).joint for window in windows]))
    np.testing.assert_allclose(*poses, atol=1e-9)
    np.testing.assert_allclose(*sigma, rtol=1e-6)
    assert not np.allclose(poses[0], rooted.pose, atol=1e-6)


def test_steps_are_the_same_bits_however_often_they_are_asked_for(device):
    case = Case("arm", device)
    first, *others = (case.solved(HELD, ROOM) for _ in range(4))
    assert all((other == first).all() for other in others)


def test_a_matrix_that_is_not_positive_definite_is_refused(device):
    case = Case("arm", device)
    case.own.matrix[3] = -1e9 * np.eye(case.own.matrix.shape[1])
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        case.solved(0, ROOM)
