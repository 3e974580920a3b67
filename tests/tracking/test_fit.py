"""The first frame without hand work."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from one_frame import QUICK, fit_observation
from person_skeleton import JOINTS
from random_scenes import perfect_masks
from synthetic import ring_rig, synthetic_body, synthetic_poses, synthetic_subject

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser, joint_positions
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.shape_space import ShapeSpace, heading_rotation, upright_base
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.fitting.clip_body import InClip
from mmocap_warp.fitting.frame_fit import Guess
from mmocap_warp.fitting.standing_search import NoSubjectError
from mmocap_warp.fitting.subject_fit import FitConfig, _first_frame, _Task, _verdict, fit, fit_clip
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.formats.usd.usd_body import read_subject, write_subject
from mmocap_warp.masks.observation import Observation, unpack_masks

LIMBS = ("LShoulder", "RShoulder", "LElbow", "RElbow", "LHip", "RHip", "LKnee", "RKnee", "LAnkle", "RAnkle")


@pytest.fixture(scope="module", params=["begun", pytest.param("whole", marks=pytest.mark.nightly)])
def subject(request, walk, man):
    """The man fitted to the walk, or to as much of it as tells his heading and height."""
    if request.param == "whole":
        return fit(walk, man, QUICK)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("mmocap_warp.fitting.subject_fit._ROUNDS", 1)  # searches of the limbs
        quick = replace(QUICK, headings=4, evaluations=300, finalists=1, frames=4)
        return fit(replace(walk, frame_count=12), man, quick)


def test_a_stranger_is_found_with_the_right_heading(walk, subject):
    truth = load_truth(walk.truth)
    joints = Poser(subject.body, subject.root_base).joint_transforms(subject.pose)[0, :, :3, 3]
    error = [np.linalg.norm(joints[JOINTS.index(n)] - truth.joints[0, truth.joint_names.index(n)]) for n in LIMBS]
    # Turned by 180 degrees, left and right limbs would be 0.2 m to 0.4 m apart.
    assert np.mean(error) < 0.08
    height = float(np.ptp(subject.body.skin.rest[:, 1]))
    assert height == pytest.approx(1.69, abs=0.06)  # the body that was recorded; the fit starts from 1.78 m
    assert abs(height - 1.69) < 3 * subject.provenance["body.height.sigma"]
    assert subject.provenance["fit.decided"] == "yes"


BODIES = ("boxes", pytest.param("adult_man", marks=pytest.mark.nightly))
"""A figure of boxes is posed sooner than a person."""


@pytest.fixture
def generic(request, monkeypatch):
    """A body of :data:`BODIES`, whose limbs are searched once."""
    monkeypatch.setattr("mmocap_warp.fitting.subject_fit._ROUNDS", 1)
    return synthetic_body() if request.param == "boxes" else request.getfixturevalue("man")


@pytest.fixture(scope="module")
def clip() -> tuple[CameraRig, list[Observation]]:
    """Two frames of a figure before three cameras."""
    rig, subject = ring_rig(3, (160, 120)), synthetic_subject()
    return rig, [Observation.from_masks(list(perfect_masks(subject, rig, pose))) for pose in synthetic_poses(2)]


@pytest.mark.parametrize("generic", BODIES, indirect=True)
def test_one_frame_is_enough(clip, generic):
    rig, frames = clip
    short = replace(QUICK, headings=2, evaluations=48, finalists=1)
    assert fit_clip(generic, rig, 30.0, frames[:1], short).provenance["fit.frames"] == 1


@pytest.mark.parametrize("generic", BODIES, indirect=True)
def test_a_fit_repeats_bit_by_bit_at_any_number_of_threads(clip, generic):
    rig, frames = clip
    short = replace(QUICK, headings=2, evaluations=48, finalists=1, frames=2)
    first, second = (fit_clip(generic, rig, 30.0, frames, replace(short, threads=threads)) for threads in (1, 2))
    np.testing.assert_array_equal(first.pose, second.pose)
    np.testing.assert_array_equal(first.body.skin.rest, second.body.skin.rest)
    np.testing.assert_array_equal(first.root_base, second.root_base)


def damaged(frame: Observation) -> Iterator[Observation]:
    yield frame
    raise InputError("0400.png", "cannot be decoded as an image", "convert it to PNG")


def test_later_frames_show_the_body_too(clip, monkeypatch):
    """Where nobody is seen, images cannot be read, or the body costs far more than before, a part shows nothing."""
    monkeypatch.setattr("mmocap_warp.fitting.subject_fit._ROUNDS", 1)
    rig, frames = clip
    short = replace(QUICK, headings=2, evaluations=48, finalists=1, frames=2)
    masks = [unpack_masks(each.words, rig.size) for each in frames]
    nobody = [Observation.from_masks([np.zeros_like(mask) for mask in each]) for each in masks]
    halves = [Observation.from_masks([mask & (np.arange(160) < 80) for mask in each]) for each in masks]
    alone, *others = (
        fit_clip(synthetic_body(), rig, 30.0, frames, short, later=later)
        for later in ([], [nobody], [halves], [frames[::-1], nobody], [damaged(frames[0]), frames])
    )
    assert [each.provenance["fit.frames"] for each in (alone, *others)] == [2, 2, 2, 4, 4]
    np.testing.assert_array_equal(others[1].body.skin.rest, alone.body.skin.rest)
    assert not np.array_equal(others[2].body.skin.rest, alone.body.skin.rest)
    given = fit_clip(alone.body, rig, 30.0, frames, replace(short, rigid=True), later=[frames])
    np.testing.assert_array_equal(given.body.skin.rest, alone.body.skin.rest)


@pytest.mark.parametrize(
    ("fps", "frames", "model", "starts"),
    [
        (8.0, 16, "gaussian", [0, 32]),
        (8.1, 16, "gaussian", [0]),
        (4.0, 16, "gaussian", [0, 21, 42]),
        (2.0, 16, "gaussian", [0, 16, 32]),  # thirds of the first 24 seconds
        (2.0, 1, "gaussian", [0]),
        (4.0, 16, "knn", [0]),  # whose masks have to be made of all frames before
    ],
)
def test_a_long_recording_is_seen_in_two_or_three_parts(walk, man, fps, frames, model, starts, monkeypatch):
    def numbers(subject, rig, rate, first, config, progress, start_poses, later):
        seen.extend(list(part) for part in (first, *later))
        return synthetic_subject()

    seen = []
    monkeypatch.setattr("mmocap_warp.fitting.subject_fit.fit_clip", numbers)
    monkeypatch.setattr(type(walk), "observations", lambda scene, scale, count: iter(scene.frames[:count]))
    scene = replace(walk, fps=fps, foreground=replace(walk.foreground, source="clean_plate", model=model))
    fit(scene, man, replace(QUICK, frames=frames))
    count = round(2 * fps) if frames > 1 else 1
    assert seen == [list(range(start, start + count)) for start in starts]


def test_a_fitted_subject_survives_its_file(subject, tmp_path):
    write_subject(tmp_path / "subject.usdc", subject)
    again = read_subject(tmp_path / "subject.usdc")
    np.testing.assert_array_equal(again.pose, subject.pose)
    np.testing.assert_array_equal(again.root_base, subject.root_base)
    np.testing.assert_array_equal(again.body.skin.rest, subject.body.skin.rest)
    assert again.provenance["fit.cost"] == subject.provenance["fit.cost"]


def test_silhouettes_that_do_not_meet_are_refused(walk, man):
    rig = walk.rig(0.25)
    masks = [np.zeros((height, width), bool) for width, height in rig.size]
    for k, mask in enumerate(masks):  # five specks in different corners of space
        mask[5 + 20 * k : 9 + 20 * k, 5:9] = True
    with pytest.raises(NoSubjectError, match="no point in space"):
        fit_observation(man, rig, Observation.from_masks(masks), QUICK)


def test_an_empty_first_frame_is_wrong_input(walk, man, monkeypatch):
    rig = walk.rig(0.25)
    nothing = Observation.from_masks([np.zeros((height, width), bool) for width, height in rig.size])
    monkeypatch.setattr(type(walk), "observations", lambda self, *a, **k: iter([nothing]))
    with pytest.raises(InputError, match="frame 0"):
        fit(walk, man, QUICK)


@pytest.mark.parametrize(("standing", "lying", "lies"), [(0.13, 0.06, True), (0.13, 0.11, False), (0.11, 0.02, False)])
def test_who_does_not_stand_is_searched_with_any_side_up(man, standing, lying, lies, monkeypatch):
    """Where a standing body fits badly; the other must fit clearly better."""
    guess = Guess(np.zeros(len(RestSpace(man).names)), np.eye(3), np.zeros(51))

    def first_frame(task: _Task, observation: object) -> tuple[Guess, dict[str, Guess]]:
        stands = task.body.skeleton.stands
        return replace(guess, pose=np.full(51, not stands), cost=standing if stands else lying), {}

    def in_clip(task: _Task, clip: object, fps: float, subjects: list[Subject]) -> list[InClip]:
        return [InClip(each, 0.0, np.zeros((8, 1, 3)), None) for each in subjects]

    monkeypatch.setattr("mmocap_warp.fitting.subject_fit._first_frame", first_frame)
    monkeypatch.setattr("mmocap_warp.fitting.subject_fit._with_clip_bodies", in_clip)
    subject = fit_clip(man, None, 30.0, [None], QUICK)
    assert bool(subject.pose[0]) is lies
    assert subject.body.skeleton.stands
    known = fit_clip(man, None, 30.0, [None], QUICK, start_poses=np.zeros((1, 51)))
    assert not known.pose.any()  # how it starts is said


@pytest.mark.nightly
def test_who_hangs_upside_down_is_found(man, monkeypatch):
    """No standing body fits."""
    rig, pose = ring_rig(4, (320, 240)), np.zeros(51)
    subject = Subject(man, upright_base("+y"), pose, {})
    pose[[1, 3]] = 1.0, np.pi
    seen = [Observation.from_masks(perfect_masks(subject, rig, pose))]

    def off() -> float:
        found = fit_clip(man, rig, 30.0, seen, FitConfig(frames=1))
        places = [joint_positions(each, at[None])[0] for each, at in ((subject, pose), (found, found.pose))]
        return float(np.linalg.norm(places[0] - places[1], axis=1).max())

    assert off() < 0.03
    monkeypatch.setattr(_Task, "lying", None)
    assert off() > 0.3


class PlannedFrame:
    """In place of a frame's fit: guesses cost what is planned, by the height that says which they are."""

    polished_cost, limbs_cost, swapped_cost, anew_cost, exchanged_cost = {}, {}, None, None, None
    most = np.inf  # cost that the last guess whose limbs were looked for might have

    def __init__(self, *_):
        self.searched = []

    def polished(self, guess):
        return replace(guess, cost=self.polished_cost[int(guess.pose[1])])

    def split_random(self):
        return None

    def with_limbs_found(self, guess, rounds, random=None, most=np.inf):
        PlannedFrame.most = most
        return replace(guess, cost=self.limbs_cost.get(int(guess.pose[1]), guess.cost))

    def with_sides_swapped(self, guess):
        """One pair ends where it was, the other elsewhere."""
        if self.swapped_cost is None:
            return [replace(guess, cost=0.0)]
        return [replace(guess, cost=0.0), replace(guess, pose=guess.pose + 100, cost=self.swapped_cost)]

    def with_pairs_anew(self, guess):
        return [] if self.anew_cost is None else [replace(guess, pose=guess.pose + 200, cost=self.anew_cost)]

    def with_places_exchanged(self, guess):
        return [] if self.exchanged_cost is None else [replace(guess, pose=guess.pose + 300, cost=self.exchanged_cost)]


@pytest.fixture
def planned(man, monkeypatch):
    """The first frame's best guess and its rivals, where four headings and what follows cost what is planned."""

    def run(polished, limbs, swapped=None, anew=None, exchanged=None, kinds=((0, 1, 2, 3),), **settings):
        base = [upright_base("+z") @ heading_rotation(turn * np.pi / 2) for turn in range(4)]
        poses = np.zeros((4, man.skeleton.coordinates))
        poses[:, 1] = range(4)
        guesses = [Guess(np.zeros(len(RestSpace(man).names)), *both) for both in zip(base, poses, strict=True)]
        monkeypatch.setattr(
            "mmocap_warp.fitting.subject_fit._headings", lambda *_: [[guesses[i] for i in kind] for kind in kinds]
        )
        monkeypatch.setattr("mmocap_warp.fitting.subject_fit.FrameFit", PlannedFrame)
        costs = {"polished": polished, "limbs": limbs, "swapped": swapped, "anew": anew, "exchanged": exchanged}
        for name, cost in costs.items():
            monkeypatch.setattr(PlannedFrame, f"{name}_cost", cost)
        task = _Task(man, None, replace(QUICK, device="cpu", **settings), lambda *_: None)
        return _first_frame(task, None)

    return run


def test_the_best_finalist_is_the_answer(planned):
    best, _ = planned({0: 0.3, 1: 0.2, 2: 0.4, 3: 0.5}, {0: 0.11, 1: 0.15, 3: 0.05}, finalists=2)
    assert best.pose[1] == 0
    assert best.cost == 0.11  # the last heading was no finalist


def test_each_kind_of_start_has_its_finalists(planned):
    best, _ = planned({0: 0.3, 1: 0.2, 2: 0.4, 3: 0.5}, {1: 0.15, 2: 0.05, 3: 0.2}, kinds=((0, 1), (2, 3)), finalists=1)
    assert best.pose[1] == 2


def test_the_margin_is_how_far_the_next_explanation_is_behind(planned):
    best, rivals = planned({0: 0.3, 1: 0.2, 2: 0.4, 3: 0.5}, {0: 0.11, 1: 0.12, 2: 0.15})
    found = _verdict(best, rivals)
    assert found["fit.alternative"] == "turned"  # the second heading differs too little to be a rival
    assert found["fit.margin"] == pytest.approx(0.04)
    best, rivals = planned({0: 0.3, 1: 0.2, 2: 0.4, 3: 0.5}, {0: 0.11, 1: 0.12, 2: 0.15}, swapped=0.13)
    assert _verdict(best, rivals)["fit.alternative"] == "swapped"
    assert np.isnan(_verdict(best, {})["fit.margin"])


def test_limbs_of_a_body_that_is_turned_round_are_looked_for_while_it_is_not_far_behind(planned):
    best, rivals = planned({0: 0.3, 1: 0.2, 2: 0.4, 3: 0.5}, {0: 0.11, 1: 0.12, 2: 0.15})
    assert rivals["turned"].pose[1] == 2
    assert PlannedFrame.most == pytest.approx(best.cost + 0.06)


def test_sides_that_fit_better_swapped_are_swapped(planned):
    best, rivals = planned({0: 0.3, 1: 0.2, 2: 0.4, 3: 0.5}, {0: 0.11, 1: 0.12, 2: 0.15}, swapped=0.10)
    assert best.cost == 0.10
    assert rivals["swapped"].cost == 0.11


def test_limbs_drawn_anew_are_kept_where_they_fit_better(planned):
    polished, limbs = {0: 0.3, 1: 0.2, 2: 0.4, 3: 0.5}, {0: 0.11, 1: 0.12, 2: 0.15}
    best, rivals = planned(polished, limbs, anew=0.10)
    assert (best.cost, best.pose[1]) == (0.10, 200)
    assert rivals["swapped"].cost == 0.11  # what was best before: motion may still decide for it
    best, rivals = planned(polished, limbs, anew=0.12)
    assert (best.cost, best.pose[1]) == (0.11, 0)
    assert rivals["swapped"].cost == 0.12


def test_limbs_in_each_others_place_are_kept_where_they_fit_better_and_weighed_where_they_fit_as_well(planned):
    polished, limbs = {0: 0.3, 1: 0.2, 2: 0.4, 3: 0.5}, {0: 0.11, 1: 0.12, 2: 0.15}
    best, rivals = planned(polished, limbs, exchanged=0.10)
    assert (best.cost, best.pose[1]) == (0.10, 300)
    assert rivals["swapped"].cost == 0.11
    best, rivals = planned(polished, limbs, exchanged=0.112)
    assert (best.cost, best.pose[1]) == (0.11, 0)
    assert rivals["swapped"].cost == 0.112  # the frame cannot tell: motion may
    _, rivals = planned(polished, limbs, exchanged=0.12)
    assert "swapped" not in rivals


@pytest.mark.parametrize(
    ("margin", "costs", "apart", "answer", "decided"),
    [
        (0.05, [3.0], 8, 0, "yes"),  # the frame decides
        (0.01, [3.0, 4.0], 8, 0, "yes"),
        (0.01, [4.0, 3.0], 8, 1, "yes"),  # motion decides otherwise
        (0.01, [3.0, 3.03], 8, 0, "no"),
        (0.01, [3.0, 3.03], 3, 0, "no"),
        (0.01, [3.0, 3.03], 2, 0, "yes"),  # the ways meet after two frames
    ],
)
def test_motion_decides_where_the_first_frame_does_not(man, margin, costs, apart, answer, decided, monkeypatch):
    guesses = [Guess(np.zeros(len(RestSpace(man).names)), np.eye(3), np.full(51, i), 0.1 + i * margin) for i in (0, 1)]
    asked, places = iter(costs), [np.zeros((8, 1, 3)) for _ in costs]
    places[-1][:apart] = 0.2
    monkeypatch.setattr(
        "mmocap_warp.fitting.subject_fit._with_clip_bodies",
        lambda task, clip, fps, subjects: [InClip(each, next(asked), places.pop(0), None) for each in subjects],
    )
    monkeypatch.setattr(
        "mmocap_warp.fitting.subject_fit._first_frame", lambda task, observation: (guesses[0], {"turned": guesses[1]})
    )
    subject = fit_clip(man, None, 30.0, [None], QUICK)
    assert subject.pose[0] == answer
    assert subject.provenance["fit.decided"] == decided
    assert next(asked, None) is None


@pytest.mark.parametrize(
    "settings",
    [{"headings": 0}, {"scale": 0.0}, {"scale": 1.5}, {"evaluations": 0}, {"finalists": 0}, {"frames": 0}],
)
def test_settings_are_checked(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        FitConfig(**settings)


@pytest.mark.parametrize("up", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_bodies_stand_along_any_up_axis(up):
    base = upright_base(up)
    np.testing.assert_allclose(base @ base.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(base) == pytest.approx(1.0)
    axis = "xyz".index(up[1])
    np.testing.assert_array_equal(base[:, 1], (1.0 if up[0] == "+" else -1.0) * np.eye(3)[axis])
    np.testing.assert_allclose((base @ heading_rotation(1.0))[:, 1], base[:, 1])


def test_sliders_pair_the_targets_of_a_body(man):
    space = ShapeSpace(man, "+y")
    by_name = {name: (positive, negative) for name, positive, negative in space.sliders}
    assert by_name["height"] == ("height_incr", "height_decr")
    assert by_name["gender_female"] == ("gender_female", None)
    targets = [name for _, *pair in space.sliders for name in pair if name]
    assert sorted(targets) == sorted(man.shape_names)


def test_a_subject_of_coordinates_is_the_shaped_body(man):
    space = ShapeSpace(man, "+z")
    coordinates = np.zeros(len(space))
    names = [name for name, *_ in space.sliders]
    coordinates[space.slider_index[names.index("height")]] = -0.4
    coordinates[space.slider_index[names.index("weight")]] = 0.3
    coordinates[space.scale_index] = np.log(1.1)
    coordinates[space.heading_index] = 0.7
    subject = space.subject(coordinates, {})
    expected = man.shaped({"height_decr": 0.4, "weight_incr": 0.3}, 1.1)
    np.testing.assert_allclose(subject.body.skin.rest, expected.skin.rest, atol=1e-6)
    np.testing.assert_allclose(subject.root_base, upright_base("+z") @ heading_rotation(0.7))
