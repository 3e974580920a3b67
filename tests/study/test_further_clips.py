"""The clips beyond the nine: somebody who turns fast, and people unlike the tracker's bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_spins import SPINS

from mmocap_warp.cameras.rig import project
from mmocap_warp.cli import main
from mmocap_warp.masks.observation import unpack_masks
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.study.sequences import CLIP_PLANS, CLIPS, FPS, FURTHER_PLANS, SEQUENCES, make_sequence
from mmocap_warp.study.source import Clip, clip_facts, open_clip
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.footage.together import places, shifted_truth
from mmocap_warp.synthesis.walkers import PEOPLE

FLOOR = 2e-3  # [m]


@pytest.fixture(scope="module", params=FURTHER_PLANS)
def short(request):
    """The first 12 frames of a clip."""
    return make_sequence(request.param, replace(FURTHER_PLANS[request.param], frames=12))


@pytest.fixture(scope="module", params=SPINS)
def spin(request):
    """Who spins, and the pose vectors of the whole clip."""
    plan = FURTHER_PLANS[f"{request.param}/Spin"]
    body = PEOPLE[request.param].true_body()
    return request.param, body, plan.motion(body, plan.frames, plan.seed)


def test_they_are_none_of_the_nine():
    assert not set(FURTHER_PLANS) & set(SEQUENCES)
    assert set(CLIPS) == set(CLIP_PLANS) == set(SEQUENCES) | set(FURTHER_PLANS)


def test_cameras_see_all_of_the_body_and_no_joint_is_beyond_its_limits(short):
    assert len(short.rig) == (5 if short.name.endswith("Spin") else 7)
    body, poses = short.recording.body, short.recording.poses
    limits = body.skeleton.limits.reshape(-1, 2)
    assert (poses[:, 3:] >= limits[:, 0]).all()
    assert (poses[:, 3:] <= limits[:, 1]).all()
    for frame in (0, 11):
        pixel = project(short.rig, short.recording.vertices(frame))
        assert (pixel > 0).all()
        assert (pixel < np.asarray(short.rig.size)[:, None] - 1).all()
        assert abs(short.recording.vertices(frame)[:, 2].min()) < FLOOR


def test_the_truth_is_of_the_skin_and_the_start_is_near_it(short):
    skin = short.recording.vertices(7)[short.recording.body.marker_vertex]
    assert np.linalg.norm(short.truth.markers[7] - skin, axis=1).mean() < 0.005
    subject = short.subject
    start = ExactPoser(subject.body, subject.root_base).joint_transforms(subject.pose[None])[0, :, :3, 3]
    error = np.linalg.norm(start - short.truth.joints[0, : len(start)], axis=1)
    assert 0.005 < error.mean() < 0.04
    assert error.max() < 0.12


def test_masks_are_the_same_when_made_again(short):
    again = make_sequence(short.name, replace(FURTHER_PLANS[short.name], frames=9))
    np.testing.assert_array_equal(again.observation(8).words, short.observation(8).words)
    np.testing.assert_array_equal(again.truth.joints, short.truth.joints[:9])
    np.testing.assert_array_equal(again.subject.pose, short.subject.pose)


# Turning


def test_a_spin_is_as_fast_as_it_says_and_leaves_time_before_and_after(spin):
    person, body, poses = spin
    ahead = ExactPoser(body, np.eye(3)).joint_transforms(poses)[:, 0, :3, 2]
    heading = np.degrees(np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 2])))
    rate = np.diff(heading) * FPS
    wanted = SPINS[person]
    assert rate.max() == pytest.approx(wanted.rate, rel=1e-3)
    fast = np.flatnonzero(rate > 0.97 * wanted.rate)
    assert len(fast) == fast[-1] - fast[0] + 1 > 1.4 * FPS
    assert np.abs(rate[: int(1.0 * FPS)]).max() < 40  # a walk's pelvis turns by so much
    assert np.abs(rate[-int(0.4 * FPS) :]).max() < 40
    assert heading[-1] - heading[0] == pytest.approx(360 * wanted.turns, abs=15)


def test_a_spin_is_on_one_foot_with_the_arms_out(spin):
    person, body, poses = spin
    index, poser = body.skeleton.index, ExactPoser(body, np.eye(3))
    middle = int((SPINS[person].begin + SPINS[person].end) / 2 * FPS)
    joints = poser.joint_transforms(poses)[..., :3, 3]
    for side in "LR":
        reach = joints[middle, index(f"{side}Wrist")] - joints[middle, index(f"{side}Shoulder")]
        assert np.linalg.norm(reach[[0, 2]]) > 0.4
        assert abs(reach[1]) < 0.1
    turning = slice(int((SPINS[person].begin + 0.3) * FPS), int(SPINS[person].end * FPS))
    ankles = joints[turning][:, [index("LAnkle"), index("RAnkle")]]
    assert np.ptp(ankles[:, 0, 1]) < 1e-9  # stands
    assert ankles[:, 1, 1].min() > ankles[0, 0, 1] + 0.15  # in the air
    assert np.hypot(*ankles[:, 0, [0, 2]].T).max() < 0.1  # about its ball
    assert np.linalg.norm(np.diff(joints, 2, axis=0), axis=-1).max() < 0.03
    lowest = [poser.vertices(poses[frame : frame + 1])[0, :, 1].min() for frame in range(0, len(poses), 24)]
    assert np.abs(lowest).max() < FLOOR


# Two who meet, and what is worn


def wrists_and_necks(action, apart):
    """(person, frame, 3) right wrists and necks of S1 and S2, who are put so far apart."""
    pair = [CLIPS[f"{person}/{action}"] for person in ("S1", "S2")]
    shifts = places([each.recording.poses[:, :2] for each in pair], apart)
    truths = [shifted_truth(each.truth, shift) for each, shift in zip(pair, shifts, strict=True)]
    return [
        np.stack([truth.joints[:, truth.joint_names.index(joint)] for truth in truths]) for joint in ("RWrist", "Neck")
    ]


def test_hands_meet_in_a_handshake():
    (one, other), _ = wrists_and_necks("Handshake", 0.82)
    between = np.linalg.norm(one - other, axis=1)
    shaken = slice(int(1.1 * FPS), int(2.5 * FPS))
    assert between[shaken].min() > 0.13
    assert between[shaken].max() < 0.20  # a palm in a palm
    assert np.ptp(one[shaken, 2]) > 0.08
    assert min(between[0], between[-1]) > 0.7


def test_punches_of_a_fight_reach_the_other_and_stay_outside():
    wrists, necks = wrists_and_necks("Fight", 0.9)
    nearest = np.linalg.norm(wrists - necks[::-1], axis=2).min(axis=1)
    assert (nearest > 0.2).all()
    assert nearest.min() < 0.4


def test_a_garment_has_a_label_where_it_is_nearer_than_the_skin():
    coat = make_sequence("Coat/Walking", replace(FURTHER_PLANS["Coat/Walking"], frames=1))
    whole, seen = coat.observation(0), coat.observation(0, labelled=True)
    size = coat.rig.size
    unpacked = coat.recording.masks(0), unpack_masks(seen.words, size), seen.unpacked_hidden(size)
    masks, skin, cloth = map(np.array, unpacked)
    np.testing.assert_array_equal(skin | cloth, masks)
    assert not (skin & cloth).any()
    assert 0.6 < cloth.sum() / masks.sum() < 0.9
    index = coat.recording.body.skeleton.index
    for joint, worn in (("UpperSpine", True), ("Neck", False), ("LAnkle", False)):
        place = coat.truth.joints[0, index(joint)] + (0.0, 0.0, 0.1 * (joint == "Neck"))
        pixel = np.rint(project(coat.rig, place[None])[:, 0]).astype(int)
        shown = np.array([cloth[k, y, x] for k, (x, y) in enumerate(pixel)])
        assert shown.mean() > 0.8 if worn else shown.mean() < 0.2, joint
    bare = make_sequence("Child/Walking", replace(FURTHER_PLANS["Child/Walking"], frames=1))
    assert bare.observation(0, labelled=True).hidden is None
    assert whole.hidden is None


# Where they are made by name


def test_a_study_opens_them_by_name(monkeypatch):
    name = "S1/Spin"
    assert clip_facts(Clip(name, frames=7)).frames == 7
    assert clip_facts(Clip(name)).frames == FURTHER_PLANS[name].frames
    monkeypatch.setitem(CLIP_PLANS, name, replace(CLIP_PLANS[name], frames=5))
    opened = open_clip(Clip(name, frames=3))
    assert (opened.frames, len(opened.rig), len(list(opened.observations))) == (3, 5, 3)


def test_make_writes_one_as_a_scene(tmp_path, monkeypatch, capsys):
    name = "Skirt/Walking"
    monkeypatch.setitem(CLIP_PLANS, name, replace(CLIP_PLANS[name], frames=2))
    assert main(["study", "make", str(tmp_path / "made"), "--sequence", name, "--quiet"]) == 0
    scene = load_scene(tmp_path / "made" / name / "scene.toml")
    assert (scene.frame_count, len(scene.cameras)) == (2, 7)
    np.testing.assert_array_equal(next(scene.observations()).words, CLIPS[name].observation(0).words)
    labelled = ["--sequence", name, "--degrade", "labelled", "--quiet"]
    assert main(["study", "make", str(tmp_path / "worn"), *labelled]) == 0
    scene = load_scene(tmp_path / "worn" / name / "scene.toml")
    seen, wanted = next(scene.observations()), CLIPS[name].observation(0, labelled=True)
    np.testing.assert_array_equal(seen.words, wanted.words)
    np.testing.assert_array_equal(seen.hidden, wanted.hidden)
    assert "garment = 2" in scene.path.read_text()
    bare = ["--sequence", "S1/Spin", "--frames", "1", "--degrade", "labelled", "--quiet"]
    assert main(["study", "make", str(tmp_path / "bare"), *bare]) == 0
    assert "thing = 2" in (tmp_path / "bare" / "S1" / "Spin" / "scene.toml").read_text()


def test_a_clip_moves_the_nine_alone(tmp_path, capsys):
    flags = ["--sequence", "S1/Spin", "--clip", "walk.bvh"]
    assert main(["study", "make", str(tmp_path / "made"), *flags]) == 2
    assert "S1/Walking" in capsys.readouterr().err
