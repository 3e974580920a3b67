"""The first frame without hand work."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import perfect_masks
from synthetic import ring_rig

from mmocap_warp.bodies.human import JOINTS
from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.shape_space import ShapeSpace, heading_rotation, upright_base
from mmocap_warp.errors import InputError
from mmocap_warp.formats.truth import load_truth
from mmocap_warp.formats.usd.body import read_body, read_subject, write_subject
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.synthesis.walk import walking
from mmocap_warp.tracking.fit import FitConfig, NoSubjectError, fit, fit_observation
from mmocap_warp.views.observation import Observation

QUICK = FitConfig(scale=0.25, start_evaluations=2500, final_cycles=2, winner_cycles=3, cycle_evaluations=1500)
LIMBS = ("LShoulder", "RShoulder", "LElbow", "RElbow", "LHip", "RHip", "LKnee", "RKnee", "LAnkle", "RAnkle")


@pytest.fixture(scope="module")
def walk():
    return load_scene(ROOT / "walk")


@pytest.fixture(scope="module")
def man():
    return read_body(ROOT / "bodies" / "adult_man.usdc")


@pytest.fixture(scope="module")
def subject(walk, man):
    return fit(walk, man, QUICK)


def test_a_stranger_is_found_with_the_right_heading(walk, subject):
    truth = load_truth(walk.truth)
    joints = Poser(subject.body, subject.root_base).joint_transforms(subject.pose)[0, :, :3, 3]
    error = [np.linalg.norm(joints[JOINTS.index(n)] - truth.joints[0, truth.joint_names.index(n)]) for n in LIMBS]
    # Turned by 180 degrees, left and right limbs would be 0.2 m to 0.4 m apart.
    assert np.mean(error) < 0.08
    height = float(np.ptp(subject.body.skin.rest[:, 1]))
    assert height == pytest.approx(1.69, abs=0.06)  # the body that was recorded; the fit starts from 1.78 m


def test_a_fit_repeats_bit_by_bit_at_any_number_of_threads(walk, man):
    short = replace(QUICK, start_evaluations=100, cycle_evaluations=60, winner_cycles=1)
    first, second = (fit(walk, man, replace(short, threads=threads)) for threads in (1, 2))
    np.testing.assert_array_equal(first.pose, second.pose)
    np.testing.assert_array_equal(first.body.skin.rest, second.body.skin.rest)
    np.testing.assert_array_equal(first.root_base, second.root_base)


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
    with pytest.raises(NoSubjectError, match="do not meet"):
        fit_observation(man, rig, Observation.from_masks(masks), QUICK)


def test_an_empty_first_frame_is_wrong_input(walk, man, monkeypatch):
    rig = walk.rig(0.25)
    nothing = Observation.from_masks([np.zeros((height, width), bool) for width, height in rig.size])
    monkeypatch.setattr(type(walk), "observations", lambda self, *a, **k: iter([nothing]))
    with pytest.raises(InputError, match="frame 0"):
        fit(walk, man, QUICK)


class PlannedSearch:
    """In place of a search: keeps how it is run, and finds the costs that are planned for it, one for each start."""

    made: list[PlannedSearch]
    planned: list[list[float]]

    def __init__(self, task, starts, parts, evaluations, population):
        self.starts, self.cycles = starts, []
        self.costs = np.array(self.planned[len(self.made)])
        self.found = starts.copy()
        self.found[:, 1] = 10 * len(self.made) + np.arange(len(starts))  # a height that says which it is
        self.made.append(self)

    def run(self, prior, narrowing):
        self.cycles.append((prior, narrowing))

    def best(self):
        return self.found, self.costs


HEADINGS = [0.5, 0.3, 0.9, 0.2, 0.8, 0.4, 0.7, 0.6]


@pytest.fixture
def planned(walk, man, monkeypatch):
    """Fits with the costs of each search given; returns the subject and the searches."""
    rig = walk.rig(0.25)
    observation = next(iter(walk.observations(0.25, count=1)))

    def run(*costs, **settings):
        monkeypatch.setattr("mmocap_warp.tracking.fit._ShapeSearch", PlannedSearch)
        PlannedSearch.made, PlannedSearch.planned = [], list(costs)
        subject = fit_observation(man, rig, observation, replace(QUICK, **settings))
        return subject, PlannedSearch.made

    return run


def test_the_best_headings_go_on_and_of_the_winners_runs_the_best_is_the_answer(planned):
    subject, (headings, finals, winner) = planned(HEADINGS, [0.15, 0.11, 0.18], [0.10, 0.07, 0.09])
    np.testing.assert_array_equal(finals.starts, headings.found[[3, 1, 5]])
    np.testing.assert_array_equal(winner.starts, finals.found[[1, 1, 1]])
    assert subject.pose[1] == winner.found[1, 1]
    assert subject.provenance["fit.cost"] == pytest.approx(0.07)


def test_the_margin_is_how_far_the_second_best_finalist_is_behind(planned):
    subject, _ = planned(HEADINGS, [0.15, 0.11, 0.18], [0.10, 0.07, 0.09])
    assert subject.provenance["fit.margin"] == pytest.approx(0.04)
    alone, _ = planned(HEADINGS, [0.15], [0.10], finalists=1, winner_runs=1)
    assert np.isnan(alone.provenance["fit.margin"])


def test_headings_are_spread_evenly(planned, man):
    """All of them start at one place, upright, in the rest pose."""
    _, (headings, *_) = planned(HEADINGS, [0.1, 0.2, 0.3], [0.1, 0.2, 0.3])
    heading = ShapeSpace(man, "+z").heading_index
    np.testing.assert_allclose(headings.starts[:, heading], np.arange(8) * np.pi / 4)
    assert np.ptp(np.delete(headings.starts, heading, axis=1), axis=0).max() == 0
    assert not headings.starts[:, 3 : heading - 1].any()


@pytest.mark.parametrize("spoilt", [False, True], ids=["all views", "a view that shows something else"])
def test_the_start_stands_where_the_subject_stands_and_is_as_tall(spoilt, man, monkeypatch):
    """A body of 110 % in the rest pose; one view may be wrong without a trace in the start."""
    rig, scale, pose = ring_rig(cameras=6, size=(320, 240)), 1.1, np.zeros(man.skeleton.coordinates)
    soles = man.skin.rest[:, 1].min()
    pose[:3] = 0.3, 0.05 + scale * (man.joint_rest[0, 1] - soles), -0.2
    true = Subject(man.shaped({}, scale), upright_base(rig.up), pose, {})
    masks = list(perfect_masks(true, rig, pose))
    if spoilt:
        masks[2] = np.zeros_like(masks[2])
        masks[2][:9, :9] = True
    monkeypatch.setattr("mmocap_warp.tracking.fit._ShapeSearch", PlannedSearch)
    PlannedSearch.made, PlannedSearch.planned = [], [HEADINGS, [0.1, 0.2, 0.3], [0.1, 0.2, 0.3]]
    fit_observation(man, rig, Observation.from_masks(masks), QUICK)
    start = PlannedSearch.made[0].starts[0]
    np.testing.assert_allclose(start[:3], pose[:3], rtol=0, atol=0.04)
    assert np.exp(start[ShapeSpace(man, rig.up).scale_index]) == pytest.approx(scale, rel=0.05)  # of voxels of 30 mm


@pytest.mark.parametrize(("scale", "longest"), [(None, 480), (0.25, 160)])
def test_masks_are_480_pixels_long_unless_told(scale, longest, walk, man, monkeypatch):
    seen = []
    monkeypatch.setattr("mmocap_warp.tracking.fit.fit_observation", lambda body, rig, *rest: seen.append(rig.size))
    fit(walk, man, QUICK, scale=scale)
    assert seen[0].max() == longest


def test_the_prior_pulls_to_the_rest_pose_and_fades(planned, man):
    """It is what tells a person seen from behind from one seen from the front: angles weigh by how far joints turn."""
    _, (headings, finals, winner) = planned(HEADINGS, [0.1, 0.2, 0.3], [0.1, 0.2, 0.3], winner_cycles=18)
    space = ShapeSpace(man, "+z")
    expected = np.zeros(len(space))
    expected[3 : man.skeleton.coordinates] = 0.001 / np.repeat(man.skeleton.spread, 3) ** 2
    assert (expected[3 : man.skeleton.coordinates] > 0).all()
    expected[space.slider_index] = 0.003
    ((prior, narrowing),) = headings.cycles
    np.testing.assert_allclose(prior, expected)
    assert narrowing == 1.0
    cycles = finals.cycles + winner.cycles
    assert [len(finals.cycles), len(winner.cycles)] == [QUICK.final_cycles, 18]
    for cycle, (prior, narrowing) in enumerate(cycles):
        left = 1 - cycle / len(cycles)
        np.testing.assert_allclose(prior[3], max(left, 0.1) * expected[3])
        np.testing.assert_array_equal(prior[space.slider_index], expected[space.slider_index])
        assert narrowing == pytest.approx(max(0.6 * left, 0.1))


@pytest.fixture(scope="module")
def from_behind(man):
    """A walking man whom two cameras see from behind: his masks, the cameras, and himself."""
    ring = ring_rig(cameras=8, size=(160, 120))
    rig = ring.select(ring.names[:2])
    pose = walking().poses[25].copy()
    pose[:6] = 0.0, 0.95, 0.0, 0.0, 0.0, 0.0
    true = Subject(man, upright_base(rig.up) @ heading_rotation(np.pi + 0.5), pose, {})
    return Observation.from_masks(list(perfect_masks(true, rig, pose))), rig, true


def left(subject):
    """Where the left hip is, seen from the right one: a unit vector (3,)."""
    joints = Poser(subject.body, subject.root_base).joint_transforms(subject.pose)[0, :, :3, 3]
    across = joints[JOINTS.index("LHip")] - joints[JOINTS.index("RHip")]
    return across / np.linalg.norm(across)


def test_a_person_seen_from_behind_is_not_taken_for_one_seen_from_the_front(from_behind, man):
    """It is the prior that decides: without it, one of two fits at least has its left on the right."""
    observation, rig, true = from_behind
    assert (rig.R[:, 2] @ true.root_base[:, 2] > 0.7).all()  # his face is turned away from both cameras
    brief = replace(QUICK, headings=4, start_evaluations=3000, finalists=2, winner_cycles=2, winner_runs=1)
    found = {}
    for prior in (FitConfig.pose_prior, 0.0):
        settings = [replace(brief, seed=seed, pose_prior=prior, device="cpu") for seed in (0, 2)]
        found[prior] = [left(fit_observation(man, rig, observation, each)) @ left(true) for each in settings]
    assert min(found[FitConfig.pose_prior]) > 0.8
    assert min(found[0.0]) < -0.5


@pytest.mark.parametrize(
    "settings",
    [
        {"headings": 0},
        {"scale": 0.0},
        {"scale": 1.5},
        {"winner_cycles": 0},
        {"shape_prior": -0.1},
        {"pose_prior": np.inf},
    ],
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
