"""Limbs that exchange places: crossed arms uncross."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mmocap_warp.contour.clip.motion_points import POINTS_A_JOINT, MotionPoints
from mmocap_warp.contour.frame.rooted import Rooting
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.tracking.limb_pairs import limb_pairs, limbs, places_exchanged

BODY = load_body("adult_man")
SKELETON = BODY.skeleton
ROOTING = Rooting(SKELETON, np.eye(3), SKELETON.searched())
POINTS = MotionPoints(SKELETON, BODY.joint_rest, SKELETON.searched())
ARMS, LEGS = [(left.coordinates, right.coordinates) for left, right in limb_pairs(SKELETON)]


def posed(**angles: tuple[float, float, float]) -> np.ndarray:
    """(1, coordinate)"""
    pose = np.zeros((1, SKELETON.coordinates))
    for joint, values in angles.items():
        pose[0, SKELETON.angles(joint)] = values
    return pose


CROSSED = posed(
    Root=(0.1, 0.8, 0),
    LShoulder=(-1.2, 0.4, -2.0),
    LElbow=(0, 0.1, 0),
    RShoulder=(-1.5, -0.1, 2.2),
    RElbow=(0, -0.1, 0),
)
LEGS_APART = posed(LHip=(-0.5, 0, 0.1), LKnee=(0.3, 0, 0), RHip=(0.4, 0, -0.1), RKnee=(0.3, 0, 0))


def joints(rooted) -> np.ndarray:
    """(frame, joint, 3)"""
    return POINTS.at(rooted)[:, ::POINTS_A_JOINT]


@pytest.mark.parametrize(
    ("pose", "pair", "ends"),
    [(CROSSED, ARMS, ("LWrist", "RWrist")), (LEGS_APART, LEGS, ("LAnkle", "RAnkle"))],
    ids=["arms", "legs"],
)
def test_each_ends_where_the_other_was(pose, pair, ends):
    there = ROOTING.enter(pose)
    exchanged = places_exchanged(there, pair, POINTS, ROOTING)
    left, right = map(SKELETON.index, ends)
    was, became = joints(there)[0], joints(exchanged)[0]
    assert np.linalg.norm(was[left] - was[right]) > 0.2
    assert max(np.linalg.norm(became[left] - was[right]), np.linalg.norm(became[right] - was[left])) < 0.1
    others = np.setdiff1d(np.arange(SKELETON.coordinates), np.concatenate(pair))
    np.testing.assert_array_equal(exchanged.pose[:, others], there.pose[:, others])
    low, high = SKELETON.coordinate_limits.T
    assert (np.clip(exchanged.pose, low, high) == exchanged.pose)[:, np.concatenate(pair)].all()


def test_many_frames_are_as_each_alone():
    there = ROOTING.enter(np.concatenate([CROSSED, LEGS_APART]))
    both = places_exchanged(there, ARMS, POINTS, ROOTING)
    for frame in range(2):
        alone = places_exchanged(there[frame : frame + 1], ARMS, POINTS, ROOTING)
        np.testing.assert_allclose(both.pose[frame], alone.pose[0], atol=1e-9)


@pytest.mark.parametrize(("searched", "limb"), [(False, "left arm"), (True, "left hand")])
def test_an_arm_whose_hand_is_held_is_a_limb(searched, limb):
    """Fingers that an import holds are parts of their own: the arm that carries them is drawn anew all the same."""
    hand = SKELETON.index("LWrist")
    part = tuple(len(SKELETON.parts) if joint == hand else own for joint, own in enumerate(SKELETON.part))
    free = SKELETON.searched()[(SKELETON.searched() - 3) // 3 != hand]
    free = np.union1d(free, np.arange(3 * hand + 3, 3 * hand + 6)).astype(np.int32) if searched else free
    skeleton = replace(SKELETON, parts=(*SKELETON.parts, "left hand"), part=part, models={len(free): free})
    names = {each.name for each in limbs(SKELETON)}
    assert {each.name for each in limbs(skeleton)} == names - {"left arm"} | {limb}
