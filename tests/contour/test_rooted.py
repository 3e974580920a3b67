"""Rooted poses are the same poses, and come back as they went."""

from __future__ import annotations

import numpy as np
from other_bodies import arm_robot
from synthetic import SKELETON, synthetic_body

from mmocap_warp.body.rotations import turn
from mmocap_warp.contour.frame.rooted import Neighbours, RootedPoses, Rooting
from mmocap_warp.synthesis.exact_posing import ExactPoser

HOME = turn("x", 1.3) @ turn("z", 0.4)
SEARCHED = SKELETON.searched()


def poses(frames: int, seed: int = 0) -> np.ndarray:
    """Someone who turns round more than once, by way of a quarter turn about the root's second axis."""
    rng = np.random.default_rng(seed)
    pose = np.zeros((frames, SKELETON.coordinates))
    pose[:, :3] = rng.normal(size=(frames, 3))
    pose[:, 6:] = rng.normal(0, 0.3, (frames, SKELETON.coordinates - 6))
    pose[:, 3] = np.linspace(0.2, -0.1, frames)
    pose[:, 5] = np.linspace(-2, 7, frames)
    return pose


def transforms(rooted: RootedPoses) -> np.ndarray:
    """World transforms of the joints, posed frame by frame."""
    body = synthetic_body()
    each = zip(rooted.base, rooted.pose, strict=True)
    return np.concatenate([ExactPoser(body, base).joint_transforms(pose[None]) for base, pose in each])


def test_entering_changes_no_joint_and_leaves_the_roots_angles_at_zero():
    pose = poses(7)
    rooted = Rooting(SKELETON, HOME, SEARCHED).enter(pose)
    assert not rooted.pose[:, 3:6].any()
    expected = transforms(RootedPoses(np.tile(HOME, (7, 1, 1)), pose))
    np.testing.assert_allclose(transforms(rooted), expected, atol=1e-12)


def test_leaving_gives_back_what_entered_over_whole_turns():
    pose = poses(40)
    rooting = Rooting(SKELETON, HOME, SEARCHED)
    np.testing.assert_allclose(rooting.leave(rooting.enter(pose), pose[0, 3:6]), pose, atol=1e-12)


def test_leaving_is_the_same_rotation_at_a_quarter_turn():
    pose = poses(5)
    pose[:, 4] = np.pi / 2 + np.array([-1e-9, 0.0, 1e-12, 1e-7, 0.0])
    rooting = Rooting(SKELETON, HOME, SEARCHED)
    rooted = rooting.enter(pose)
    back = rooting.leave(rooted, pose[0, 3:6])
    np.testing.assert_allclose(transforms(rooting.enter(back)), transforms(rooted), atol=1e-9)


def test_a_step_is_folded_in_and_stops_at_limits():
    pose = poses(3)
    rooting = Rooting(SKELETON, HOME, SEARCHED)
    rooted = rooting.enter(pose)
    step = np.full((3, len(SEARCHED)), 0.02)
    step[:, 10] = 100.0
    moved = rooting.stepped(rooted, step)
    assert not moved.pose[:, 3:6].any()
    assert (moved.pose[:, SEARCHED[10]] == SKELETON.coordinate_limits[SEARCHED[10], 1]).all()
    unfolded = rooted.pose.copy()
    unfolded[:, 3:6] = 0.02
    expected = transforms(RootedPoses(rooted.base, unfolded))[:, 0, :3, :3]
    np.testing.assert_allclose(transforms(moved)[:, 0, :3, :3], expected, atol=1e-12)


def test_a_root_that_is_not_searched_keeps_its_base():
    skeleton = arm_robot().skeleton
    rooting = Rooting(skeleton, HOME, skeleton.searched())
    pose = np.random.default_rng(0).normal(0, 0.1, (4, skeleton.coordinates))
    rooted = rooting.enter(pose)
    assert (rooted.base == HOME).all()
    assert (rooting.leave(rooted, np.zeros(3)) == pose).all()


def test_what_is_known_of_nothing_but_limits_is_wide():
    wide = Rooting(SKELETON, HOME, SEARCHED).anywhere
    assert (wide[:3] == 10).all()
    np.testing.assert_allclose(wide[3:6], 2 * np.pi / np.sqrt(12))
    assert (wide[6:] > 0).all()
    assert (wide[6:] < 2).all()


def test_how_coordinates_leave_is_by_finite_differences():
    pose = poses(4)
    rooting = Rooting(SKELETON, HOME, SEARCHED)
    rooted = rooting.enter(pose)
    derivative = rooting.leaving(rooted)
    for number in range(len(SEARCHED)):
        step = np.zeros((4, len(SEARCHED)))
        step[:, number] = 1e-6
        ahead, behind = (rooting.leave(rooting.stepped(rooted, s), pose[0, 3:6]) for s in (step, -step))
        slope = (ahead - behind)[:, SEARCHED] / 2e-6
        np.testing.assert_allclose(derivative[:, :, number], slope, atol=1e-6)


def test_leaving_goes_on_beyond_a_quarter_turn():
    """Two triples of angles mean each rotation; the one that is nearest to the frame before is beyond its quarter."""
    pose = poses(12)
    pose[:, 4] = np.linspace(1.2, 2.1, 12)
    rooting = Rooting(SKELETON, HOME, SEARCHED)
    np.testing.assert_allclose(rooting.leave(rooting.enter(pose), pose[0, 3:6]), pose, atol=1e-9)


def test_the_first_and_the_last_pose_have_a_neighbour_on_one_side():
    course = Rooting(SKELETON, HOME, SEARCHED).enter(poses(4))
    around = Neighbours.of(course, np.arange(4), 30.0)
    np.testing.assert_array_equal(around.sides, [2, 3, 3, 1])
    np.testing.assert_array_equal(around.before.pose[1:], course.pose[:-1])
    np.testing.assert_array_equal(around.after.pose[:-1], course.pose[1:])
