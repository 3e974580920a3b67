"""Label images by role: who is tracked, what may be in front, and several people in one scene."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from small_scene import FRAMES, SCENE, make_scene
from synthetic import synthetic_subject

from mmocap_warp.calibration.first_look import FirstLook
from mmocap_warp.commands import mask
from mmocap_warp.commands.inputs import look_first, scene_from, scene_of, scene_reference
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.masks import mask_files
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.scene.mask_writing import write_masks
from mmocap_warp.scene.scene_toml import load_scene

PEOPLE = """
[people.anna]
label = 1
body = "adult_woman"
[people.ben]
label = { cam01 = 2, cam02 = 2, cam03 = 5 }
"""


@pytest.fixture
def folder(tmp_path):
    """Two people, 1 and 2, or in the last view 1 and 5, and a table, 3, before the first of them."""
    make_scene(tmp_path)
    for camera in ("cam01", "cam02", "cam03"):
        labels = np.zeros((48, 64), np.uint8)
        labels[10:40, 10:24] = 1
        labels[10:40, 30:44] = 5 if camera == "cam03" else 2
        labels[30:44, 8:20] = 3
        for frame in range(FRAMES):
            cv2.imwrite(str(tmp_path / "masks" / camera / f"{frame:04d}.png"), labels)
    return tmp_path


def scene_with(folder, text):
    (folder / "scene.toml").write_text(SCENE + text)
    return load_scene(folder)


def seen(scene):
    """Masks and what is in front of the last frame: both (camera, height, width) bool."""
    *_, last = scene.observations()
    assert last.hidden is not None
    return [np.array(unpack_masks(words, scene.rig().size)) for words in (last.words, last.hidden)]


def test_a_thing_and_what_is_ignored_may_be_in_front_of_the_person(folder):
    scene = scene_with(folder, "[labels]\nperson = 1\nthing = 3\nignore = { cam03 = [5] }\n")
    assert scene.foreground.keep == "all"
    own, hidden = seen(scene)
    worn = seen(scene_with(folder, "[labels]\nperson = 1\ngarment = 3\nignore = { cam03 = [5] }\n"))
    np.testing.assert_array_equal(worn[1], hidden)
    assert own.sum(axis=(1, 2)).tolist() == [30 * 14 - 10 * 10] * 3
    assert hidden.sum(axis=(1, 2)).tolist() == [14 * 12, 14 * 12, 14 * 12 + 30 * 14]


def test_an_image_is_read_once_for_a_person_and_for_what_hides_them(folder, monkeypatch):
    scene = scene_with(folder, PEOPLE + "[labels]\nthing = 3\n").of_person("anna")
    read, decode = [], mask_files.decode_mask_image
    monkeypatch.setattr(mask_files, "decode_mask_image", lambda *image: read.append(1) or decode(*image))
    both, alone = list(scene.observations(first=1)), list(scene.masks(first=1))
    assert len(read) == 2 * 3 * (FRAMES - 1)
    *_, in_front = scene.hidden(1.0)
    for of_frame, masks in zip(both, alone, strict=True):
        again = Observation.from_masks(masks, None, in_front)
        np.testing.assert_array_equal(of_frame.words, again.words)
        np.testing.assert_array_equal(of_frame.hidden, again.hidden)


@pytest.mark.parametrize(("gap", "hides"), [(8, True), (9, False)])
def test_what_is_far_from_a_mask_in_a_view_hides_nothing_there(gap, hides):
    mask, other = np.zeros((2, 48, 64), bool)
    mask[10:40, 10:20] = True
    other[10:40, 19 + gap : 40] = True
    seen = Observation.from_masks([mask, mask], None, [other, np.zeros_like(other)])
    assert (seen.hidden is not None) == hides
    if hides:
        np.testing.assert_array_equal(unpack_masks(seen.hidden, np.array([[64, 48]] * 2))[0], other)


def test_without_labels_nothing_is_in_front(folder):
    scene = scene_with(folder, "[foreground]\nidentity = 1\n")
    assert all(observation.hidden is None for observation in scene.observations())


def test_each_person_is_tracked_with_the_others_in_front(folder):
    scene = scene_with(folder, "[labels]\nthing = 3\n" + PEOPLE)
    anna, ben = (seen(scene.of_person(name)) for name in ("anna", "ben"))
    assert anna[0].sum(axis=(1, 2)).tolist() == [320, 320, 320]
    assert ben[0].sum(axis=(1, 2)).tolist() == [420, 420, 420]
    assert (anna[1] & ben[0]).sum() == ben[0].sum()
    assert (ben[1] & anna[0]).sum() == anna[0].sum()
    assert scene.of_person("anna").body == "adult_woman"
    assert next(iter(scene.masks()))[2].sum() == 740  # where nobody is chosen, everybody is shown


def test_what_may_be_anybodys_hides_each_person_until_they_are_told_apart(folder):
    scene = scene_with(folder, "[labels]\nseveral = 3\n" + PEOPLE)
    assert [source.several for source in scene.cameras] == [(3,)] * 3
    for name in ("anna", "ben"):
        assert seen(scene.of_person(name))[1][:, 35:40, 8:10].all()
    with pytest.raises(InputError, match="labels are those of given masks"):
        scene_with(folder, "[foreground]\nsource = 'recording'\n[labels]\nseveral = 3\n")


def test_who_is_tracked_is_not_said_twice(folder):
    with pytest.raises(InputError, match=r"identity and labels of people both say who is tracked; .*--person"):
        scene_with(folder, "[foreground]\nidentity = 1\n" + PEOPLE)
    (folder / "scene.toml").write_text(SCENE + PEOPLE)
    with pytest.raises(InputError, match="labels of people both say"):
        load_scene(folder, identity=1)
    with pytest.raises(UsageError, match="this scene's have labels of people; person chooses"):
        scene_from(load_scene(folder), identity=1)


def test_people_without_a_table_each_are_told(folder):
    with pytest.raises(InputError, match=r"\[people\].*'anna'"):
        scene_with(folder, "[people]\nanna = 1\n")


def test_a_result_finds_its_person_again(folder):
    scene = scene_with(folder, PEOPLE)
    ben = scene_from(scene, person="ben")
    assert scene_reference(ben, None)["person"] == "ben"

    made = SimpleNamespace(provenance={f"fit.{name}": value for name, value in scene_reference(ben, None).items()})
    assert scene_of(made, None, None).cameras == ben.cameras
    with pytest.raises(UsageError, match="person carl is not one of anna, ben"):
        scene_from(scene, person="carl")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[labels]\nperson = 0\n", "person = 0 is no label"),
        ("[labels]\nperson = [1, 2]\n", "several labels"),
        ("[labels]\nthing = { cam9 = 1 }\n", "'cam9', which is no camera"),
        ("[labels]\nperson = 1\n[foreground]\nidentity = 1\n", "both say who"),
        ("[labels]\nperson = 9\n", "no mask shows identity 9"),
        ("[people.anna]\nbody = 'adult_man'\n", "'label' is missing"),
        ("[people.anna]\nlabel = { cam01 = 1 }\n", "not one number for each camera"),
        ("[people.anna]\nlabel = 1\n[people.ben]\nlabel = 1\n", "'ben' and 'anna' have the same label"),
        ("[people.anna]\nlabel = 8\n", r"no mask shows label 8; .* name the blob's under \[labels\] as several"),
        ("[people.anna]\nlabel = 1\nsubject = 'none.usdc'\n", "none.usdc does not exist"),
        ("[people.anna]\nlabel = 1\nheight = 2\n", "height"),
        ("[labels]\nseveral = 3\nperson = 1\n", "several is of two people or more"),
        ("[labels]\nseveral = 3\n[people.anna]\nlabel = 1\n", "several is of two people or more"),
        ("[labels]\nseveral = 3\nthing = [3, 4]\n" + PEOPLE, "several and another key name label 3"),
        ("[labels]\nthing = [1]\n" + PEOPLE, r"'anna' has a label of \[labels\]; leave it out of one of them"),
        ("[labels]\nseveral = 9\n[people.anna]\nlabel = 8\n[people.ben]\nlabel = 2\n", "no mask shows label 8"),
    ],
)
def test_tables_that_cannot_be_are_refused(folder, text, message):
    with pytest.raises(InputError, match=message):
        scene_with(folder, text)


def test_views_that_differ_by_what_is_in_front_are_no_reason_to_refuse(folder, monkeypatch):
    """Without things in front the same problem is refused."""
    monkeypatch.setattr(
        "mmocap_warp.calibration.first_look.look", lambda *_, **__: FirstLook("no common hull", "check")
    )
    notes = []
    reporter = SimpleNamespace(note=notes.append)
    assert look_first(scene_with(folder, PEOPLE).of_person("anna"), None, reporter, False) == {}
    assert notes == ["cameras: no common hull, and what is in front of the subject may be why"]
    with pytest.raises(InputError, match="no common hull"):
        look_first(scene_with(folder, "[labels]\nperson = 1\n"), None, reporter, False)


def test_masks_of_one_person_that_are_written_keep_what_may_be_in_front(folder, tmp_path):
    scene = scene_with(folder, "[labels]\nperson = 1\nthing = 3\nignore = { cam03 = [5] }\n")
    made = load_scene(write_masks(scene, tmp_path / "made"))
    assert made.foreground.keep == "all"
    for mine, theirs in zip(seen(made), seen(scene), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_masks_around_one_persons_body_are_of_nobody_else(folder, monkeypatch):
    scene = scene_with(folder, PEOPLE)
    filmed = replace(scene, cameras=tuple(replace(camera, video=camera.masks) for camera in scene.cameras))
    subject = synthetic_subject()
    pose, numbers = np.tile(subject.pose, (1, FRAMES, 1)), np.arange(FRAMES)
    result = SimpleNamespace(config={"person": "anna"}, frame_numbers=numbers, subject=subject, pose=pose, best_run=0)
    monkeypatch.setattr(mask, "result_from", lambda given: (given, None))
    monkeypatch.setattr(mask, "check_same_recording", lambda *_: None)
    _, alone = mask._around_body(filmed, result, 1.0)
    assert (alone.people, alone.person, alone.has_others) == ({}, "", False)
