"""The penalty on accelerations is what it says, its derivatives too, and it follows the frame rate."""

from __future__ import annotations

import numpy as np
import pytest
from planted import dense, swung
from synthetic import synthetic_body

from mmocap_warp.contour.clip.motion_penalty import FAR, HELD, SPEED, UNSEEN, MotionPenalty
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.rooted import RootedPoses

BODY = synthetic_body()
POINTS = MotionPoints(BODY.skeleton, BODY.joint_rest, BODY.skeleton.searched())
SEEN = np.ones(6, bool)


def rooted(frames: int, rate: float) -> RootedPoses:
    return RootedPoses(np.tile(np.eye(3), (frames, 1, 1)), swung(BODY, frames, rate))


def terms(frames: int, rate: float, acceleration: float) -> list[np.ndarray]:
    """Differences (difference, frame) in units of what they usually are, of velocity and acceleration."""
    scales = (1, rate / SPEED), (2, rate**2 / acceleration)
    return [np.diff(np.eye(frames), n=order, axis=0) * scale for order, scale in scales]


def weights(error: np.ndarray) -> np.ndarray:
    """(difference, joint) of errors (difference, joint, value): Cauchy's, of the mean over five differences."""
    rows = len(error)
    mean = np.zeros((rows, rows))
    for row in range(rows):
        for beyond, weight in zip(range(-2, 3), (1, 4, 6, 4, 1), strict=True):
            mean[row, min(max(row + beyond, 0), rows - 1)] += weight / 16
    shared = np.einsum("lk,kjp->ljp", mean, error)
    return 1 / (1 + (shared**2).sum(axis=2) / FAR**2)


def test_a_joint_that_accelerates_costs_half_the_square_of_it_or_less():
    rate, acceleration = 60.0, 4.0
    time = np.arange(6) / rate
    points = np.zeros((6, 4, 3))  # one joint's
    points[:, :, 1] = 0.5 * acceleration * time[:, None] ** 2
    speed = acceleration * (time[1:] + time[:-1]) / 2 / SPEED
    steady = np.array([0, 0, *[FAR**2 / 2 * np.log1p((acceleration / 0.5 / FAR) ** 2)] * 4])
    weight = weights(speed[:, None, None])[:, 0]
    by_speed = (weight * speed**2 + FAR**2 * (weight - 1 - np.log(weight))) / 2
    cost = MotionPenalty(0.5, rate).around(points, np.zeros((6, 4, 3, 1)), SEEN[:6]).cost
    np.testing.assert_allclose(cost, steady + np.append(0.0, by_speed))
    np.testing.assert_allclose(
        MotionPenalty(400.0, rate).around(1e-3 * points, np.zeros((6, 4, 3, 1)), SEEN[:6]).cost,
        0.5e-6 * (np.append(0.0, speed) ** 2 + np.array([0, 0, *[acceleration / 400] * 4]) ** 2),
        rtol=1e-4,
    )


def test_its_derivatives_are_finite_differences_with_the_weights_held():
    poses, penalty = rooted(7, 60.0), MotionPenalty(3.0, 60.0)
    around = penalty.around(*POINTS.linearised(poses), np.ones(7, bool))
    direction = np.random.default_rng(0).normal(size=around.gradient.shape)

    def errors(poses: RootedPoses) -> list[np.ndarray]:
        place = POINTS.at(poses).reshape(7, -1, 12) / 2
        return [np.einsum("kf,fjp->kjp", differences, place) for differences in terms(7, 60.0, 3.0)]

    held = [weights(error) for error in errors(poses)]

    def cost(step: float) -> float:
        pose = poses.pose.copy()
        pose[:, BODY.skeleton.searched()] += step * direction
        squares = [(error**2).sum(axis=2) for error in errors(RootedPoses(poses.base, pose))]
        return 0.5 * sum((weight * square).sum() for weight, square in zip(held, squares, strict=True))

    slope = (cost(1e-6) - cost(-1e-6)) / 2e-6
    assert slope == pytest.approx(-(around.gradient * direction).sum(), rel=1e-6)


def test_its_matrix_is_that_of_the_linearised_points():
    frames, rate, acceleration = 6, 60.0, 3.0
    poses = rooted(frames, rate)
    _, derivative = POINTS.linearised(poses)
    around = MotionPenalty(acceleration, rate).around(*POINTS.linearised(poses), SEEN[:frames])
    rows = derivative.reshape(frames, -1, 12, derivative.shape[-1]) / 2
    place = POINTS.at(poses).reshape(frames, -1, 12) / 2
    expected = 0.0
    for differences in terms(frames, rate, acceleration):
        root = np.sqrt(weights(np.einsum("kf,fjp->kjp", differences, place)))
        jacobian = np.einsum("kf,kj,fjpd->kjpfd", differences, root, rows).reshape(-1, frames * rows.shape[-1])
        expected = expected + jacobian.T @ jacobian
    np.testing.assert_allclose(dense(around.band), expected, atol=1e-9 * np.abs(expected).max())


def test_later_frames_need_no_more_of_those_before_than_are_held():
    points, derivative = POINTS.linearised(rooted(12, 30.0))
    penalty, first = MotionPenalty(3.0, 30.0), 12 - 5
    whole = penalty.around(points, derivative, np.ones(12, bool)).without_first(first)
    tail = slice(first - HELD, None)
    part = penalty.around(points[tail], derivative[tail], np.ones(5 + HELD, bool)).without_first(HELD)
    np.testing.assert_array_equal(part.gradient, whole.gradient)
    np.testing.assert_array_equal(dense(part.band), dense(whole.band))
    np.testing.assert_array_equal(part.cost, whole.cost)


def test_it_costs_the_same_a_second_for_an_acceleration_that_falls_by_the_root_of_a_low_rate():
    def a_second(rate: float) -> float:
        acceleration = 3.0 * max(1.0, 60.0 / rate) ** 0.5
        points, derivative = POINTS.linearised(rooted(round(4 * rate), rate))
        return MotionPenalty(acceleration, rate).around(points, derivative, np.ones(len(points), bool)).cost[2:].mean()

    np.testing.assert_allclose([a_second(rate) for rate in (15, 30, 120)], a_second(60), rtol=0.05)


@pytest.mark.parametrize("acceleration", [1e-3, 400.0])
def test_what_nothing_shows_costs_its_square(acceleration):
    points = np.zeros((6, 4, 3))
    points[:, :, 0] = 500.0 * np.arange(6)[:, None] ** 2
    derivative = np.zeros((6, 4, 3, 1))
    seen = np.arange(6) != 4
    cost = MotionPenalty(acceleration, 1.0).around(points, derivative, seen).cost
    speed = 1000.0 * np.array([3.5, 4.5])
    squares = (1000.0 / max(acceleration / 60.0**0.5, UNSEEN)) ** 2 + (speed / SPEED) ** 2
    np.testing.assert_allclose(cost[4:], squares / 2, rtol=1e-12)
    assert cost[3] < 100


def test_a_motion_that_lasts_weighs_less_than_noise_that_is_as_large():
    def pull(second_difference: np.ndarray) -> float:
        points = np.zeros((12, 4, 3))
        points[2:, :, 0] = np.cumsum(np.cumsum(second_difference))[:, None]
        derivative = np.zeros((12, 4, 3, 1))
        derivative[:, :, 0] = 1.0
        coupled = MotionPenalty(1.0, 1.0).around(points, derivative, np.ones(12, bool)).band.blocks[2]
        return float(np.abs(coupled).mean())

    assert pull(np.full(10, 5.0)) < 0.1 * pull(5.0 * (-1.0) ** np.arange(10))


def test_what_nothing_shows_is_as_fast_as_hands_and_feet():
    """Half for an acceleration of 14.4 m/s^2, and half for a speed of 3 m/s."""
    rate = 24.0
    place = np.array([0.0, 0.0, 14.4 / rate**2])
    points = np.zeros((3, 4, 3))
    points[:, :, 2] = place[:, None]
    cost = MotionPenalty(1e-3, rate).around(points, np.zeros((3, 4, 3, 1)), np.zeros(3, bool)).cost
    np.testing.assert_allclose(cost, [0.0, 0.0, 0.5 + 0.5 * (14.4 / rate / 3.0) ** 2])
