"""Contacts and steps against the schedule of a made walk."""

from dataclasses import replace

import numpy as np
import pytest
from character_motions import anymal_motions
from measured import answer, known_events, made_walk
from other_bodies import quadruped
from walk_scene import walker

from mmocap_warp.biomechanics import steps as contacts
from mmocap_warp.biomechanics.measure_all import measure
from mmocap_warp.biomechanics.steps import feet_of, feet_on_floor, walking
from mmocap_warp.rigging.shipped import load_body

BODY = walker()


@pytest.mark.parametrize("fps", [25.0, 60.0, 120.0])
def test_contacts_are_within_a_frame_of_the_walks_own(fps):
    poses, phase = made_walk(BODY, cycles=4.2, fps=fps)
    found = measure(answer(BODY, poses, fps=fps)).runs[0].feet
    for side, foot in found.items():
        strikes, offs, standing = known_events(phase, side)
        assert len(foot.strikes) == len(strikes) >= 4
        assert len(foot.offs) == len(offs) >= 4
        assert np.abs(foot.strikes - strikes).max() <= 1
        assert np.abs(foot.offs - offs).max() <= 1
        assert (foot.on_floor != standing).mean() < 0.02
        assert np.abs(foot.height[standing]).max() < 0.002


def test_contacts_of_a_walk_with_a_trackers_errors_are_within_two_frames():
    """Off by 4 mm and 0.7 degrees, as standard deviations, that change over some tenths of a second."""
    poses, phase = made_walk(BODY, cycles=4.2, fps=60.0)
    rng, searched = np.random.default_rng(1), BODY.skeleton.searched(39)
    width = np.exp(-0.5 * (np.arange(-40, 41) / 10.0) ** 2)
    noise = rng.normal(size=(len(searched), len(poses) + 80))
    smooth = np.stack([np.convolve(row, width / np.linalg.norm(width), "valid") for row in noise], axis=1)
    poses[:, searched] += np.where(searched < 3, 0.004, np.radians(0.7)) * smooth
    for side, foot in measure(answer(BODY, poses)).runs[0].feet.items():
        strikes, offs, standing = known_events(phase, side)
        assert len(foot.strikes) == len(strikes)
        assert np.abs(foot.strikes - strikes).max() <= 2
        assert np.abs(foot.offs - offs).max() <= 2
        assert (foot.on_floor != standing).mean() < 0.05


def test_contacts_depend_on_neither_the_floors_height_nor_the_world():
    poses, _ = made_walk(BODY, cycles=1.5, fps=60.0)
    here = measure(answer(BODY, poses)).runs[0]
    poses[:, 1] += 0.7
    there = measure(answer(BODY, poses, up="-z", heading=2.0)).runs[0]
    for side, foot in here.feet.items():
        np.testing.assert_array_equal(foot.on_floor, there.feet[side].on_floor)
        np.testing.assert_allclose(foot.height, there.feet[side].height, atol=2e-6)
    lengths = [[step.length for step in run.walking.steps] for run in (here, there)]
    np.testing.assert_allclose(*lengths, atol=1e-5)


def test_frames_found_in_blocks_are_the_same(monkeypatch):
    poses, _ = made_walk(BODY, cycles=0.8, fps=60.0)
    whole = measure(answer(BODY, poses)).runs[0].feet
    monkeypatch.setattr(contacts, "_FRAMES_AT_ONCE", 7)
    for side, foot in measure(answer(BODY, poses)).runs[0].feet.items():
        np.testing.assert_allclose(foot.speed, whole[side].speed, rtol=1e-12)
        np.testing.assert_array_equal(foot.height, whole[side].height)


def test_somebody_who_stands_has_contacts_and_no_steps():
    poses = np.zeros((20, BODY.skeleton.coordinates))
    run = measure(answer(BODY, poses)).runs[0]
    assert all(foot.on_floor.all() for foot in run.feet.values())
    assert not run.walking.steps
    assert not run.walking.strides
    assert np.isnan(run.walking.cadence)


def test_a_lifted_foot_is_off_the_floor_even_where_it_is_still():
    poses = np.zeros((20, BODY.skeleton.coordinates))
    poses[:, BODY.skeleton.angles("LKnee").start] = 1.0
    feet = measure(answer(BODY, poses)).runs[0].feet
    assert not feet["left"].on_floor.any()
    assert feet["right"].on_floor.all()


def test_a_jump_leaves_the_floor_with_both_feet():
    poses = np.zeros((60, BODY.skeleton.coordinates))
    air = np.clip(np.arange(60) - 20, 0, 20) / 60.0  # a third of a second
    poses[:, 1] = np.maximum(9.81 / 2 * air * (20 / 60.0 - air), 0)
    for foot in measure(answer(BODY, poses)).runs[0].feet.values():
        assert foot.offs.tolist() == [20]
        assert foot.strikes.tolist() == [41] or foot.strikes.tolist() == [40]
    walking = measure(answer(BODY, poses)).runs[0].walking
    assert np.isnan(walking.cadence) or all(step.seconds > 0 for step in walking.steps)


def test_of_a_single_frame_no_contact_is_known():
    feet = measure(answer(BODY, np.zeros((1, BODY.skeleton.coordinates)))).runs[0].feet
    assert not any(foot.on_floor.any() for foot in feet.values())
    assert np.isnan(feet["left"].speed).all()


def test_short_gaps_and_short_contacts_do_not_count():
    """A foot that jerks for a frame of sixty, and one in the air that is slow and low for a frame."""
    poses = np.zeros((30, BODY.skeleton.coordinates))
    knee = BODY.skeleton.angles("LKnee").start
    poses[14:, knee] = 1.0
    poses[7, knee] = 0.3
    foot = measure(answer(BODY, poses)).runs[0].feet["left"]
    assert foot.strikes.size == 0
    assert len(foot.offs) == 1


def test_steps_of_a_straight_walk_have_the_length_they_were_made_with():
    poses, _ = made_walk(BODY, cycles=4.2, fps=120.0, radius=1e5, stride=1.2)
    run = measure(answer(BODY, poses, fps=120.0)).runs[0]
    assert len(run.walking.steps) >= 7
    np.testing.assert_allclose([step.length for step in run.walking.steps], 0.6, atol=0.015)
    np.testing.assert_allclose([stride.length for stride in run.walking.strides], 1.2, atol=0.015)
    np.testing.assert_allclose([stride.stance_share for stride in run.walking.strides], 0.62, atol=0.02)
    np.testing.assert_allclose(run.walking.cadence, 112, atol=1)


def test_steps_on_the_spot_have_no_length():
    up = np.array([0.0, 0.0, 1.0])
    poses, _ = made_walk(BODY, cycles=2.2, fps=60.0)
    result = answer(BODY, poses, up="+z")
    run, seconds = measure(result).runs[0], np.arange(len(poses)) / 60.0
    heel = {side: np.zeros((len(poses), 3)) for side in run.feet}
    steps = walking(run.feet, heel, np.zeros((len(poses), 3)), seconds, up).steps
    assert len(steps) >= 3
    assert np.isnan([step.length for step in steps]).all()


def test_a_foot_without_skin_has_no_contacts():
    ankle = BODY.skeleton.index("LAnkle")
    skin = replace(BODY.skin, joint=np.where(BODY.skin.joint == ankle, ankle - 1, BODY.skin.joint))
    result = answer(replace(BODY, skin=skin), np.zeros((5, BODY.skeleton.coordinates)))
    feet = feet_on_floor(result.subject, result.pose[0], np.arange(5) / 60.0, np.array([0.0, 1.0, 0.0]))
    assert list(feet) == ["right"]


def test_a_robot_that_trots_stands_on_diagonal_feet_and_has_strides_but_no_steps():
    robot = load_body("anymal")
    trot = anymal_motions(robot)["Trot"]
    run = measure(answer(robot, trot.pose, fps=trot.fps)).shown
    assert list(run.feet) == ["LF_KFE", "RF_KFE", "LH_KFE", "RH_KFE"]
    for one, other in (("LF_KFE", "RH_KFE"), ("RF_KFE", "LH_KFE")):
        assert (run.feet[one].on_floor != run.feet[other].on_floor).mean() < 0.1
    assert (run.feet["LF_KFE"].on_floor | run.feet["RF_KFE"].on_floor).all()
    assert run.walking.steps == []
    assert [stride.length for stride in run.walking.strides] == pytest.approx([0.4] * 4, abs=0.01)


@pytest.mark.parametrize(("name", "feet"), [("fox", 4), ("hand", 0), ("panda", 0), ("adult_man", 2)])
def test_paws_are_feet_and_fingers_are_none(name, feet):
    assert len(feet_of(load_body(name))) == feet


@pytest.mark.parametrize("wide", [0.05, 1.0, 20.0])
def test_limbs_that_end_over_the_ground_are_no_feet_however_wide_the_body_is(wide):
    dog = quadruped()
    joint, rest = dog.skin.heaviest_joint, dog.skin.rest * np.float32([wide, 1, 1])
    lifted = np.isin(joint, [dog.skeleton.index(f"{side}ForeKnee") for side in "LR"])
    rest[lifted, 1] += 0.15
    assert list(feet_of(replace(dog, skin=replace(dog.skin, rest=rest)))) == ["LHindKnee", "RHindKnee"]
    rest[lifted, 1] -= 0.15
    assert len(feet_of(replace(dog, skin=replace(dog.skin, rest=rest)))) == 4


def test_a_foot_stands_up_to_three_centimetres_and_half_a_metre_a_second():
    """Another foot is the floor; this one is slowly lifted, then slides faster by 1 cm/s in each."""
    still, knee = np.zeros((80, BODY.skeleton.coordinates)), BODY.skeleton.angles("LKnee").start
    still[:, knee] = np.linspace(0.0, 1.0, 80)
    foot = measure(answer(BODY, still, fps=1.0)).runs[0].feet["left"]
    assert foot.height[0] < 0.02 < 0.05 < foot.height[-1]
    np.testing.assert_array_equal(foot.on_floor, foot.height < 0.03)
    sliding = np.zeros((80, BODY.skeleton.coordinates))
    sliding[:, 0] = 0.005 * np.arange(80) ** 2
    foot = measure(answer(BODY, sliding, fps=1.0)).runs[0].feet["left"]
    np.testing.assert_array_equal(foot.on_floor, foot.speed < 0.5)
    assert foot.on_floor[40]
    assert not foot.on_floor[60]
