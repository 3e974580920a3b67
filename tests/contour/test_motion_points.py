"""Points that ride on the joints are where the joints are, and their derivatives are those of small steps."""

from __future__ import annotations

import numpy as np
import pytest
from other_bodies import arm_robot, burdened, quadruped
from synthetic import synthetic_body

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import turn
from mmocap_warp.contour.clip.motion_points import ARM, MotionPoints
from mmocap_warp.contour.frame.rooted import RootedPoses
from mmocap_warp.synthesis.exact_posing import ExactPoser

HOME = turn("x", 1.3) @ turn("z", 0.4)
BODIES = {"person": synthetic_body(), "dog": quadruped(), "arm": arm_robot(), "burdened": burdened()}


@pytest.fixture(params=BODIES.values(), ids=BODIES)
def body(request) -> BodyModel:
    return request.param


def points_of(body: BodyModel) -> MotionPoints:
    return MotionPoints(body.skeleton, body.joint_rest, body.skeleton.searched())


def anywhere(body: BodyModel, frames: int = 3) -> RootedPoses:
    pose = np.random.default_rng(1).normal(0, 0.5, (frames, body.skeleton.coordinates))
    return RootedPoses(np.tile(HOME, (frames, 1, 1)), pose)


def test_points_are_centres_and_places_on_the_axes(body):
    rooted = anywhere(body)
    transforms = ExactPoser(body, HOME).joint_transforms(rooted.pose)
    points = points_of(body).at(rooted).reshape(len(rooted), -1, 4, 3)
    np.testing.assert_allclose(points[:, :, 0], transforms[..., :3, 3], atol=1e-12)
    for axis in range(3):
        on_axis = transforms[..., :3, 3] + ARM * transforms[..., :3, axis]
        np.testing.assert_allclose(points[:, :, 1 + axis], on_axis, atol=1e-12)


def test_poses_are_apart_by_the_joint_that_moved_most(body):
    one, other, of_body = anywhere(body), anywhere(body, frames=4)[3:], points_of(body)
    centres, others = (of_body.at(poses)[:, ::4] for poses in (one, other))
    np.testing.assert_allclose(of_body.apart(one, one), 0.0, atol=0.0)
    farthest = np.linalg.norm(centres - others, axis=2).max(axis=1)
    np.testing.assert_allclose(of_body.apart(one, other), farthest, atol=1e-12)


def test_derivatives_are_finite_differences(body):
    rooted = anywhere(body)
    of_body = points_of(body)
    points, derivative = of_body.linearised(rooted)
    assert (points == of_body.at(rooted)).all()
    assert derivative.shape == (*points.shape, len(body.skeleton.searched()))
    step = 1e-6
    for number, coordinate in enumerate(body.skeleton.searched()):
        moved = np.zeros_like(rooted.pose)
        moved[:, coordinate] = step
        ahead = of_body.at(RootedPoses(rooted.base, rooted.pose + moved))
        behind = of_body.at(RootedPoses(rooted.base, rooted.pose - moved))
        np.testing.assert_allclose(derivative[..., number], (ahead - behind) / (2 * step), atol=1e-8)


def test_centres_move_with_the_rest_body(body):
    rooted = anywhere(body)
    change = np.random.default_rng(2).normal(0, 0.1, (3, len(body.skeleton.joints), 3))
    derivative = points_of(body).centres_by_rest(rooted, change)
    before = points_of(body).at(rooted)[:, ::4]
    for number, each in enumerate(change):
        moved = MotionPoints(body.skeleton, body.joint_rest + each, body.skeleton.searched()).at(rooted)[:, ::4]
        np.testing.assert_allclose(derivative[..., number], moved - before, atol=1e-7)
