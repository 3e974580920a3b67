"""How parts are turned in the bind pose: about their joints, both sides alike, thick ones more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from other_bodies import arm_robot, quadruped

from mmocap_warp.body.bind_pose import bind_pose_turns, thickness
from mmocap_warp.body.mirroring import mirrored_joints, mirrored_weights
from mmocap_warp.body.model import BodyModel
from mmocap_warp.rigging.shipped import load_body

MIRROR = np.array([-1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def man() -> BodyModel:
    return load_body("adult_man")


def test_thick_limbs_are_thick(man):
    thick = dict(zip(man.skeleton.joints, thickness(man, mirrored_weights(man)), strict=True))
    assert thick["LWrist"] < thick["LElbow"] < thick["LKnee"] < thick["LHip"] < thick["BottomSpine"]
    assert 0.02 < thick["LWrist"] < 0.04
    assert thick["LKnee"] == pytest.approx(thick["RKnee"], rel=1e-3)
    dog = quadruped()
    assert not thickness(dog, mirrored_weights(dog)).any()  # its parts are rigid: nothing bends


def test_a_part_turns_about_its_joint(man):
    _, skin, centre = bind_pose_turns(man)
    rest, parent = man.joint_rest.astype(float), list(man.skeleton.parent[1:])
    bone = rest[1:] - rest[parent]
    for moved in centre:  # which changes no bone's length
        np.testing.assert_allclose(((moved[1:] - moved[parent]) * bone).sum(axis=1), 0.0, atol=1e-6)
    wrist = man.skeleton.index("LWrist")
    own = man.skin.heaviest_joint == wrist
    only_the_hand = [one for one, moved in zip(skin, centre, strict=True) if not moved.any() and one[own].any()]
    assert len(only_the_hand) == 3
    arm = np.linalg.norm(man.skin.rest[own] - rest[wrist], axis=1)
    assert (np.linalg.norm(only_the_hand[0][own], axis=1) <= arm + 1e-6).all()


def test_parts_of_a_person_are_turned_by_about_a_degree(man):
    turn = np.degrees(bind_pose_turns(man).sigma)
    assert (turn > 0.2).all()
    assert (turn < 2.0).all()


def test_sides_are_turned_alike(man):
    _, skin, centre = bind_pose_turns(man)
    across = np.arange(len(man.joint_rest))
    for group in mirrored_joints(man).values():
        across[list(group)] = group[::-1]
    np.testing.assert_allclose(centre[:, across] * MIRROR, centre, atol=0.02)
    assert (np.abs(skin.mean(axis=1)[:, 0]) <= 1e-3).all()  # the mesh as a whole goes to neither side


def test_a_body_without_sides_turns_about_all_axes(man):
    alone = replace(man, skeleton=replace(man.skeleton, joints=tuple("abcdefghijklmnop"), pairs=()))
    sigma, skin, centre = bind_pose_turns(alone)
    assert len(sigma) == 3 * len(man.joint_rest)
    assert skin.shape == (len(sigma), *man.skin.rest.shape)
    assert centre.shape == (len(sigma), *man.joint_rest.shape)


def test_where_nothing_bends_nothing_is_turned():
    arm = arm_robot()
    sigma, skin, centre = bind_pose_turns(arm)
    assert sigma.shape == (0,)
    assert skin.shape == (0, *arm.skin.rest.shape)
    assert centre.shape == (0, *arm.joint_rest.shape)
