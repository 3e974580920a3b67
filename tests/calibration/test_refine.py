"""A camera that was turned is found by the person before it, and only that one changes; what is sound stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from moving_person import BODY, FPS, RIG, subject, write_scene

from mmocap_warp.body.model import Subject
from mmocap_warp.calibration import camera_check
from mmocap_warp.calibration.adjust.adjustment import AdjustConfig, Adjustment, Person
from mmocap_warp.calibration.adjust.camera_changes import KINDS, OFFSET, ROTATION, Deviations, changed, difference
from mmocap_warp.calibration.adjust.silhouette_agreement import landmarks
from mmocap_warp.calibration.camera_check import CameraCheck, check, gross_mistake
from mmocap_warp.calibration.first_look import FirstLook
from mmocap_warp.calibration.refine.refinement import Refinement, refine
from mmocap_warp.errors import InputError

CONFIG = AdjustConfig(frames=7, judges=3, scale=0.35, device="cpu")
FRAMES = 10
WRONG = 2


@pytest.fixture(autouse=True)
def known_subject(monkeypatch):
    """The first pose is known: fitting it is tested elsewhere."""

    def fit_body(self: Adjustment, change: np.ndarray) -> Subject:
        return subject()

    monkeypatch.setattr(Adjustment, "fit_body", fit_body)


def planted(**by: float) -> np.ndarray:
    change = np.zeros((len(RIG), len(KINDS)))
    for kind, value in by.items():
        change[WRONG, KINDS.index(kind)] = value
    return change


def refined(tmp_path, change: np.ndarray, **settings) -> Refinement:
    scene = write_scene(tmp_path, changed(RIG, change), FRAMES)
    return refine(scene, BODY, replace(CONFIG, **settings))


@pytest.mark.parametrize("found", [8, 12, 15, 40])
def test_frames_are_left_to_judge_however_few_there_are(found):
    person = Person(subject(), [], None, np.arange(found))
    taken = person.spread(CONFIG.frames)
    judges = person.between(CONFIG.judges, taken)
    assert len(taken) == min(CONFIG.frames, found - 4)
    assert taken[[0, -1]].tolist() == [0, found - 1]
    assert len(judges) == min(CONFIG.judges, found - len(taken))
    assert not np.isin(judges, taken).any()


def test_a_turned_camera_is_turned_back_and_the_others_stay(tmp_path):
    found = refined(tmp_path, planted(tilt=0.10, pan=-0.12))
    left = difference(RIG, found.rig)
    assert np.degrees(np.linalg.norm(left[WRONG, ROTATION])) < 0.2
    others = np.arange(len(RIG)) != WRONG
    assert not found.moved[others].any()
    np.testing.assert_array_equal(found.rig.K[others], RIG.K[others])
    assert found.better
    assert found.after.together.mean() > found.before.together.mean() + 0.1
    assert found.after.apart[WRONG] > found.before.apart[WRONG] + 0.1
    assert found.fixed != WRONG


def test_a_sound_rig_is_left_alone_and_not_called_better(tmp_path):
    found = refined(tmp_path, planted())
    assert not found.moved.any()
    assert not found.better
    np.testing.assert_allclose(found.rig.t, RIG.t, atol=1e-12)


def test_a_late_camera_is_found_by_whole_frames_and_the_rest(tmp_path):
    scene = write_scene(tmp_path, frames=FRAMES, late=(0, 0, 2, 0))  # three are found with one seed of five
    held = Deviations(rotation=0.0, position=0.0, focal=0.0, centre=0.0)
    found = refine(scene, BODY, replace(CONFIG, scale=0.5, deviations=held))
    assert found.change[WRONG, OFFSET] * FPS == pytest.approx(2.0, abs=0.25)
    assert not found.change[:, :OFFSET].any()
    assert found.better


def checked(tmp_path, change: np.ndarray) -> CameraCheck:
    return check(write_scene(tmp_path, changed(RIG, change), FRAMES), BODY, CONFIG)


@pytest.mark.parametrize(
    ("cause", "by"),
    [
        pytest.param("rotation", {"roll": 0.12}, marks=pytest.mark.nightly),
        pytest.param("focal length", {"focal": 0.06}, marks=pytest.mark.nightly),
        ("position", {"ahead": 0.4, "down": 0.2}),
    ],
)
def test_the_camera_that_disagrees_is_named_with_its_cause(tmp_path, cause, by):
    found = checked(tmp_path, planted(**by))
    assert [(each.camera, each.cause) for each in found.findings[:1]] == [(RIG.names[WRONG], cause)]
    assert found.views[0].camera == RIG.names[WRONG]
    mask, before, after = (getattr(found.views[0], name) for name in ("mask", "before", "after"))
    assert (mask & after).sum() / (mask | after).sum() > (mask & before).sum() / (mask | before).sum()


def test_a_camera_alone_is_compared_with_nothing(tmp_path):
    scene = write_scene(tmp_path, RIG, 2)
    alone = replace(scene, cameras=scene.cameras[:1], calibrated=scene.calibrated.select(RIG.names[:1]))
    for compare in (check, refine):
        with pytest.raises(InputError, match="names one camera, and comparing needs two views"):
            compare(alone, BODY, CONFIG)


def test_a_body_whose_root_is_held_shows_nothing_of_the_cameras(tmp_path):
    skeleton = BODY.skeleton
    searched = skeleton.searched()[1:]  # without the translation along x
    held = replace(skeleton, models={len(searched): searched})
    for compare in (check, refine):
        with pytest.raises(InputError, match=r"scene\.toml.* held at the root"):
            compare(write_scene(tmp_path / compare.__name__, RIG, 2), replace(BODY, skeleton=held), CONFIG)


@pytest.mark.filterwarnings("error")
def test_two_cameras_start_from_where_they_are(tmp_path):
    scene = write_scene(tmp_path, changed(RIG, planted(roll=0.12)), 2)
    two = replace(scene, cameras=scene.cameras[1:3], calibrated=scene.calibrated.select(RIG.names[1:3]))
    assert not Adjustment(two, BODY, CONFIG).start().any()


def test_no_camera_of_a_sound_rig_disagrees(tmp_path):
    found = checked(tmp_path, planted())
    assert found.findings == ()
    assert found.covered.min() > 0.95
    assert found.overlap is not None
    assert found.overlap.min() > 0.8


def test_a_view_of_something_else_is_named(tmp_path, monkeypatch):
    """It adds nothing to the errors of the cameras."""
    problem = f"{RIG.names[1]} shows something else than the others"
    monkeypatch.setattr(camera_check, "look", lambda scene, body, views: FirstLook(problem))
    assert [finding.words for finding in checked(tmp_path, planted()).findings] == [problem]


def test_mirrored_swapped_and_wrongly_sized_pictures_are_told_by_points(tmp_path):
    scene = write_scene(tmp_path)
    seen = landmarks(RIG, list(scene.observations()))
    assert gross_mistake(RIG, seen, FPS) is None
    flipped = seen.copy()
    flipped[:, 1, :, 0] = RIG.size[1, 0] - 1 - flipped[:, 1, :, 0]
    mirrored = gross_mistake(RIG, flipped, FPS)
    swapped = gross_mistake(RIG, seen[:, [0, 3, 2, 1]], FPS)
    K = RIG.K.copy()
    K[0, :2] *= 2
    sized = gross_mistake(replace(RIG, K=K), seen, FPS)
    assert mirrored is not None
    assert (mirrored.cameras, mirrored.cause) == ((RIG.names[1],), "mirrored")
    assert swapped is not None
    assert (swapped.cameras, swapped.cause) == ((RIG.names[1], RIG.names[3]), "wrong file")
    assert sized is not None
    assert (sized.cameras, sized.cause, sized.size) == ((RIG.names[0],), "image size", 0.5)
