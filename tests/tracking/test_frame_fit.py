"""Limbs that hide are found, sides can be exchanged, and the body of many frames is the one that was seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from other_bodies import arm_robot, quadruped
from random_scenes import perfect_masks
from synthetic import ring_rig

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.shape_space import upright_base
from mmocap_warp.fitting.clip_body import follow, frames_to_follow, solve_body
from mmocap_warp.fitting.frame_fit import FrameFit, Guess, by_turns
from mmocap_warp.fitting.standing_search import FirstFrame
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.tracking.limb_pairs import limbs, mirrored
from mmocap_warp.tracking.track_config import TrackConfig

RIG = ring_rig(cameras=4, size=(320, 240), distance=3.5)
BASE = upright_base("+y")


@pytest.fixture(scope="module")
def man():
    return load_body("adult_man")


@pytest.fixture(scope="module")
def space(man):
    return RestSpace(man)


def standing(body, **angles) -> np.ndarray:
    """A pose above the ring's middle, with some joints' angles (3,) given [rad]."""
    pose = np.zeros(body.skeleton.coordinates)
    pose[1] = 1.0
    for joint, values in angles.items():
        pose[body.skeleton.angles(joint)] = values
    return pose


def seen(body, pose) -> Observation:
    return Observation.from_masks(perfect_masks(Subject(body, BASE, pose, {}), RIG, pose))


def joints(body, pose) -> dict[str, np.ndarray]:
    places = Poser(body, BASE).joint_transforms(pose)[0, :, :3, 3]
    return dict(zip(body.skeleton.joints, places, strict=True))


def test_fits_that_take_turns_find_what_one_finds(man, space):
    """Each guess has the random numbers that it would have in a row."""
    pose = standing(man, LElbow=[0.0, 0.9, 0.0])
    frame = FirstFrame(RIG, seen(man, pose))
    one, *_ = fits = [FrameFit(space, frame) for _ in range(3)]
    alone = FrameFit(space, frame)
    guesses = [Guess(np.zeros(len(space.names)), BASE, standing(man, LElbow=[0.0, turn, 0.0])) for turn in (0.0, 0.5)]
    in_a_row = [alone.with_limbs_found(guess, 1) for guess in guesses]
    at_once = by_turns(fits, FrameFit.with_limbs_found, guesses, [1, 1], [one.split_random() for _ in guesses])
    for each, other in zip(in_a_row, at_once, strict=True):
        assert each.cost == other.cost
        np.testing.assert_array_equal(each.pose, other.pose)


def test_limbs_are_the_parts_that_move_only_themselves(man):
    found = limbs(man.skeleton)
    assert [(limb.name, limb.other) for limb in found] == [
        ("left arm", "right arm"), ("right arm", "left arm"), ("left leg", "right leg"), ("right leg", "left leg")
    ]  # fmt: skip
    names = [man.skeleton.coordinate_names[i] for i in found[0].reach]
    assert names == ["LShoulder.Rx", "LShoulder.Ry", "LShoulder.Rz", "LElbow.Ry"]
    assert len(found[0].coordinates) == 9


@pytest.mark.parametrize("body", [quadruped(), arm_robot()], ids=["quadruped", "arm"])
def test_limbs_of_other_bodies_are_theirs(body):
    for limb in limbs(body.skeleton):
        assert limb.name in body.skeleton.parts
        assert len(limb.reach)


def test_a_mirrored_pose_is_the_mirror_image(man):
    pose = standing(man, LShoulder=(0.3, -0.4, 0.5), LElbow=(0, -0.8, 0), RHip=(-0.5, 0.1, 0.2), RKnee=(0.6, 0, 0))
    there, here = joints(man, mirrored(man.skeleton, pose)), joints(man, pose)
    middle = here["Root"]
    for _, left, right in man.skeleton.pairs:
        for one, other in ((left, right), (right, left)):
            expected = (here[other] - middle) * (-1, 1, 1)
            # The body's own sides differ by a few millimetres.
            np.testing.assert_allclose((there[one] - middle) @ BASE, expected @ BASE, atol=0.01)
    np.testing.assert_allclose(mirrored(man.skeleton, mirrored(man.skeleton, pose)), pose, atol=1e-6)


def test_an_arm_inside_the_trunk_is_found(man, space):
    """A raised arm, from a guess that has it across the body: contours alone leave it there."""
    pose = standing(man, LShoulder=(0, 0, 1.2), LElbow=(0, -0.9, 0))
    hidden = standing(man, LShoulder=(0, -1.2, -1.2), LElbow=(0, -1.5, 0))
    frame = FrameFit(space, FirstFrame(RIG, seen(man, pose)))
    guess = frame.polished(Guess(np.zeros(len(space.names)), BASE, hidden))
    truth, stuck = joints(man, pose), joints(space.model(guess.beta), guess.pose)
    assert np.linalg.norm(stuck["LWrist"] - truth["LWrist"]) > 0.2
    found = frame.with_limbs_found(guess, rounds=4)
    assert found.cost < guess.cost
    places = joints(space.model(found.beta), found.pose)
    assert max(np.linalg.norm(places[name] - truth[name]) for name in ("LWrist", "RWrist", "LAnkle", "RAnkle")) < 0.05


def test_a_guess_that_costs_too_much_after_a_round_over_the_limbs_is_given_up(man, space, monkeypatch):
    rounds, solved = [], FrameFit._solved
    monkeypatch.setattr(FrameFit, "_solved", lambda *args: rounds.append(0) or solved(*args))
    frame = FrameFit(space, FirstFrame(RIG, seen(man, standing(man))))
    guess = Guess(np.zeros(len(space.names)), BASE, standing(man, LHip=(-0.9, 0, 0)))
    frame.with_limbs_found(guess, rounds=3, most=0.0)
    assert len(rounds) == 1


def test_legs_that_are_swapped_are_told_from_those_that_are_not(man, space):
    pose = standing(man, LHip=(-0.5, 0, 0), LKnee=(0.3, 0, 0), RHip=(0.4, 0, 0), RKnee=(0.3, 0, 0))
    frame = FrameFit(space, FirstFrame(RIG, seen(man, pose)))
    right = frame.polished(Guess(np.zeros(len(space.names)), BASE, pose))
    arms, legs = frame.with_sides_swapped(right)
    away = joints(space.model(legs.beta), legs.pose)["LAnkle"] - joints(man, pose)["LAnkle"]
    assert np.linalg.norm(away) > 0.2
    assert legs.cost > right.cost
    assert arms.cost == pytest.approx(right.cost, abs=0.005)  # they hang alike


WALK_POSE = {
    "Root": (-0.03, -1.1, 0), "BottomSpine": (0.09, -0.02, -0.04), "UpperSpine": (-0.09, -0.16, 0.11),
    "Neck": (0.01, 0.06, -0.1), "LHip": (0.14, -0.11, -0.15), "LKnee": (0.55, 0, 0), "LAnkle": (-0.31, 0.06, 0),
    "RHip": (-0.33, -0.04, 0.13), "RKnee": (0.18, 0, 0), "RAnkle": (-0.17, -0.03, 0),
}  # fmt: skip
"""Of the shipped walk's first frame, all but the arms [rad]."""


class FourViewsOfTheWalk:
    """The walk's first frame in four of its five views, and the truth of it."""

    def __init__(self, man, space) -> None:
        walk = load_scene(ROOT / "walk")
        whole, (seen_by_all,) = walk.rig(0.5), walk.observations(0.5, count=1)
        four = Observation.from_masks(unpack_masks(seen_by_all.words, whole.size)[1:])
        self.frame = FrameFit(space, FirstFrame(whole.select(whole.names[1:]), four))
        self._man, self._space, self._truth = man, space, load_truth(walk.truth)
        self._base = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])

    def guess(self, **arms) -> Guess:
        """What contours make of the walker's pose with these arms (3,) [rad]."""
        pose = standing(self._man, **WALK_POSE, **arms)
        pose[:3] = -0.51, -0.26, 0.87
        return self.frame.polished(Guess(np.zeros(len(self._space.names)), self._base, pose))

    def off(self, guess: Guess) -> float:
        """How far the wrist that is further off is from where it is [m]."""
        places = Poser(self._space.model(guess.beta), self._base).joint_transforms(guess.pose)[0, :, :3, 3]
        wrists = [
            (self._man.skeleton.index(name), self._truth.joint_names.index(name)) for name in ("LWrist", "RWrist")
        ]
        return max(float(np.linalg.norm(places[found] - self._truth.joints[0, true])) for found, true in wrists)


def test_folded_hands_are_unfolded(man, space):
    """With its hand folded an arm explains the masks from elsewhere, a little longer: both have to move at once."""
    walk = FourViewsOfTheWalk(man, space)
    folded = walk.guess(
        LShoulder=(0.23, -0.04, -0.55), LElbow=(0, -0.1, 0), LWrist=(0, 1.1, -1.0),
        RShoulder=(0.09, -0.56, 0.51), RElbow=(0, -0.29, 0), RWrist=(0, 1.1, 1.0),
    )  # fmt: skip
    assert walk.off(folded) > 0.06
    assert walk.off(walk.frame.with_limbs_found(folded, rounds=6)) < 0.05


def test_crossed_arms_are_uncrossed(man, space):
    """Each arm explains the other's mask: no limb alone gets out of that, nor do exchanged angles; places do."""
    walk = FourViewsOfTheWalk(man, space)
    crossed = walk.guess(
        LShoulder=(-1.67, 0.36, -2.06), LElbow=(0, -0.23, 0), LWrist=(0, 0.23, -1.03),
        RShoulder=(-0.93, -0.22, 2.02), RElbow=(0, 0.54, 0), RWrist=(0, -0.22, 0.04),
    )  # fmt: skip
    crossed = walk.frame.with_limbs_found(crossed, rounds=2)
    assert walk.off(crossed) > 0.4
    assert min(walk.off(guess) for guess in walk.frame.with_sides_swapped(crossed)) > 0.3
    for found in walk.frame.with_pairs_anew(crossed), walk.frame.with_places_exchanged(crossed):
        best = min(found, key=lambda guess: guess.cost)
        assert best.cost < crossed.cost
        assert walk.off(best) < 0.1


@pytest.fixture(scope="module")
def clip(man):
    """Another body than the generic one, its poses and masks: it walks on the spot."""
    space = RestSpace(man)
    beta = np.zeros(len(space.names))
    beta[space.names.index("bone.LKnee+RKnee")] = 0.03
    beta[space.names.index("log_scale")] = -0.05
    body = space.model(beta)
    poses = []
    for phase in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        swing, lift = 0.5 * np.sin(phase), 0.4 * (1 - np.cos(phase))
        legs = {"LHip": (-swing, 0, 0), "LKnee": (lift, 0, 0), "RHip": (swing, 0, 0), "RKnee": (0.8 - lift, 0, 0)}
        poses.append(standing(body, **legs, LShoulder=(0, swing / 2, -0.6), RShoulder=(0, swing / 2, 0.6)))
    return body, np.array(poses), [seen(body, pose) for pose in poses]


def test_the_body_of_many_frames_is_the_one_that_was_seen(man, clip):
    body, poses, observations = clip
    start = Subject(man, BASE, poses[0], {"fit.seed": 0, "scale": 1.0})
    followed = follow(start, RIG, observations, 30.0, TrackConfig(device="cpu", threads=1))
    assert len(followed.rooted) == len(poses)
    solved, _ = solve_body(start, man, RIG, followed.spread(8), "cpu", 1)
    again = follow(solved, RIG, observations, 30.0, TrackConfig(device="cpu", threads=1))
    assert again.cost.mean() < followed.cost.mean()
    found, truth = joints(solved.body, solved.pose), joints(body, poses[0])
    assert np.mean([np.linalg.norm(found[name] - truth[name]) for name in truth]) < 0.015
    values = solved.provenance
    for bone, (above, below) in {"LKnee+RKnee": ("LHip", "LKnee"), "LAnkle+RAnkle": ("LKnee", "LAnkle")}.items():
        error = values[f"body.bone.{bone}"] - np.linalg.norm(truth[below] - truth[above])
        assert abs(error) < 3 * values[f"body.bone.{bone}.sigma"] < 0.1
    assert abs(values["body.height"] - np.ptp(body.skin.rest[:, 1])) < 2 * values["body.height.sigma"]
    assert values["fit.frames"] == 8
    assert "scale" not in values


def test_following_ends_where_nobody_is_seen(man, clip):
    _, poses, observations = clip
    nobody = replace(observations[0], words=0 * observations[0].words, foreground=0 * observations[0].foreground)
    followed = follow(
        Subject(man, BASE, poses[0], {}),
        RIG,
        [*observations[:3], nobody, *observations],
        30.0,
        TrackConfig(device="cpu", threads=1),
    )
    assert len(followed.rooted) == len(followed.observation) == len(followed.cost) == 3


def test_frames_are_followed_at_thirty_a_second_for_two_seconds():
    assert frames_to_follow(60.0, 1000) == range(0, 120, 2)
    assert frames_to_follow(25.0, 1000) == range(0, 50, 1)
    assert frames_to_follow(60.0, 1) == range(0, 1, 2)
