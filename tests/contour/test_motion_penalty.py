"""The penalty on accelerations is what it says, its derivatives too, and it is the same at any frame rate."""

from __future__ import annotations

import numpy as np
import pytest
from planted import dense, swung
from synthetic import synthetic_body

from mmocap_warp.contour.motion_penalty import FAR, SPEED, MotionPenalty
from mmocap_warp.contour.motion_points import MotionPoints
from mmocap_warp.contour.rooted import RootedPoses

BODY = synthetic_body()
POINTS = MotionPoints(BODY.skeleton, BODY.joint_rest, BODY.skeleton.searched())
SEEN = np.ones(6, bool)


def rooted(frames: int, rate: float) -> RootedPoses:
    return RootedPoses(np.tile(np.eye(3), (frames, 1, 1)), swung(BODY, frames, rate))


def test_a_joint_that_accelerates_costs_half_the_square_of_it_or_less():
    rate, acceleration = 50.0, 4.0
    time = np.arange(6) / rate
    points = np.zeros((6, 4, 3))  # one joint's
    points[:, :, 1] = 0.5 * acceleration * time[:, None] ** 2
    speed = acceleration * (time[1:] + time[:-1]) / 2
    errors = np.append(0.0, speed / SPEED), np.array([0, 0, *[acceleration / 0.5] * 4])
    cost = MotionPenalty(0.5, rate).around(points, np.zeros((6, 4, 3, 1)), SEEN[:6]).cost
    np.testing.assert_allclose(cost, sum(FAR**2 / 2 * np.log1p((error / FAR) ** 2) for error in errors))
    np.testing.assert_allclose(
        MotionPenalty(400.0, rate).around(1e-3 * points, np.zeros((6, 4, 3, 1)), SEEN[:6]).cost,
        sum((1e-3 * error) ** 2 / 2 for error in (errors[0], errors[1] / 800)),
        rtol=1e-4,
    )


def test_its_derivatives_are_finite_differences():
    poses, penalty = rooted(5, 30.0), MotionPenalty(3.0, 30.0)
    around = penalty.around(*POINTS.linearised(poses), SEEN[:5])
    direction = np.random.default_rng(0).normal(size=around.gradient.shape)

    def cost(step: float) -> float:
        pose = poses.pose.copy()
        pose[:, BODY.skeleton.searched()] += step * direction
        return penalty.around(*POINTS.linearised(RootedPoses(poses.base, pose)), SEEN[:5]).cost.sum()

    slope = (cost(1e-6) - cost(-1e-6)) / 2e-6
    assert slope == pytest.approx(-(around.gradient * direction).sum(), rel=1e-6)


def test_its_matrix_is_that_of_the_linearised_points():
    frames, rate, acceleration = 6, 30.0, 3.0
    poses = rooted(frames, rate)
    _, derivative = POINTS.linearised(poses)
    around = MotionPenalty(acceleration, rate).around(*POINTS.linearised(poses), SEEN[:frames])
    rows = derivative.reshape(frames, -1, 12, derivative.shape[-1]) / 2
    place = POINTS.at(poses).reshape(frames, -1, 12) / 2
    expected = 0.0
    for order, scale in ((1, rate / SPEED), (2, rate**2 / acceleration)):
        differences = np.diff(np.eye(frames), n=order, axis=0) * scale  # (difference, frame)
        size = np.linalg.norm(np.einsum("kf,fjp->kjp", differences, place), axis=2)
        weighted = np.einsum("kf,kj,fjpd->kjpfd", differences, 1 / np.sqrt(1 + (size / FAR) ** 2), rows)
        jacobian = weighted.reshape(-1, frames * rows.shape[-1])
        expected = expected + jacobian.T @ jacobian
    np.testing.assert_allclose(dense(around.band), expected, atol=1e-9 * np.abs(expected).max())


def test_it_costs_the_same_a_second_at_any_frame_rate():
    def a_second(rate: float) -> float:
        points, derivative = POINTS.linearised(rooted(round(4 * rate), rate))
        return MotionPenalty(3.0, rate).around(points, derivative, np.ones(len(points), bool)).cost[2:].mean()

    np.testing.assert_allclose([a_second(rate) for rate in (15, 30, 120)], a_second(60), rtol=0.05)


def test_what_nothing_shows_costs_its_square():
    points = np.zeros((6, 4, 3))
    points[3] = 1.0
    derivative = np.zeros((6, 4, 3, 1))
    seen = np.arange(6) != 4
    cost = MotionPenalty(1e-3, 1.0).around(points, derivative, seen).cost
    np.testing.assert_allclose(cost[4:], [3 * 4e6 / 2 + 3 / SPEED**2 / 2, 3 * 1e6 / 2], rtol=1e-6)
    assert cost[3] < 100
