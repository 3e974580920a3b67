"""The first frame without hand work."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mmocap_warp.bodies.human import JOINTS
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.shape_space import ShapeSpace, heading_rotation, upright_base
from mmocap_warp.errors import InputError
from mmocap_warp.formats.truth import load_truth
from mmocap_warp.formats.usd.body import read_body, read_subject, write_subject
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
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


@pytest.mark.parametrize(
    "settings",
    [{"headings": 0}, {"scale": 0.0}, {"scale": 1.5}, {"winner_cycles": 0}, {"shape_prior": -1.0}],
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
