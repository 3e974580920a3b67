"""Pixels that may be of several people are given to whoever's body explains them."""

import os
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from boxed_figure import FIGURE, rig_of, seen
from synthetic import synthetic_result

import mmocap_warp as mm
from mmocap_warp.cli import main
from mmocap_warp.commands import mask as mask_command
from mmocap_warp.commands import track as track_command
from mmocap_warp.commands import track_people as people_command
from mmocap_warp.commands.caller import Reporter
from mmocap_warp.commands.mask import mask
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.attachments import Attachment
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.formats.usd.usd_people import results_in
from mmocap_warp.formats.usd.usd_result import read_result, write_result
from mmocap_warp.result.verdict import verdict
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.synthesis.writing import write_made_scene
from mmocap_warp.tracking import telling_apart
from mmocap_warp.tracking.telling_apart import doubted_together, told_apart
from mmocap_warp.tracking.track_config import TrackConfig

VIEWS, UNTOLD = 5, 255
TABLES = """[foreground]
source = "masks"
keep = "all"
[labels]
several = {}
[people.anna]
label = 1
[people.ben]
label = 2
"""


class Boxes:
    """Two figures that walk towards each other and are one blob, or have labels 1 and 2, for a scene."""

    fps, rig = 30.0, rig_of(VIEWS)

    def __init__(self, places: list[tuple[float, float]], label: int | None) -> None:
        self.places, self.label = places, label

    def __len__(self) -> int:
        return len(self.places)

    def masks(self, frame: int) -> list[np.ndarray]:
        both = zip(*(seen(self.rig, FIGURE, place) for place in self.places[frame]), strict=True)
        if self.label is None:
            return [np.where(first, np.uint8(1), 2 * np.uint8(second)) for first, second in both]
        return [np.uint8(self.label) * np.logical_or(*pair) for pair in both]


def made(folder, places, several=UNTOLD):
    tables = TABLES.format(several) if several else TABLES.replace("several = {}", "told_apart = true")
    boxes = Boxes(places, several)
    return load_scene(write_made_scene(folder, boxes, None, name="boxes", about="Boxes.", foreground=tables))


def test_everybodys_subject_is_asked_for(tmp_path):
    with pytest.raises(InputError, match="anna has none"):
        mask(made(tmp_path / "scene", [(-0.8, 0.8)]).path, tmp_path / "masks")
    assert not (tmp_path / "masks").exists()


def test_people_are_told_apart_in_their_own_measure_with_what_they_carry(tmp_path, monkeypatch):
    scene, large = made(tmp_path, [(-0.8, 0.8)]), synthetic_result(1).subject.in_unit(0.05)
    (tmp_path / "bat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    scene, asked = replace(scene, attached=(Attachment("Bat", tmp_path / "bat.obj", "RWrist"),)), []
    monkeypatch.setattr(telling_apart, "make_tracker", lambda *of: asked.append(of))
    monkeypatch.setattr(telling_apart, "body_silhouettes", None)  # here it ends
    with pytest.raises(TypeError, match="not callable"):
        next(told_apart(scene, [large, large], TrackConfig(device="cpu")))
    for subject, rig, _, _ in asked:
        assert "Bat" in subject.body.skeleton.joints
        assert subject.body.unit == pytest.approx(1)
        np.testing.assert_allclose(rig.t, scene.rig().t / large.body.unit)


def test_a_fit_where_labels_tell_nobody_apart_says_where_to_fit(tmp_path):
    scene = made(tmp_path, [(-0.8, 0.8)])
    with pytest.raises(InputError, match=r"fit each person in frames .* in which labels tell them apart"):
        mm.fit(scene, person="anna", device="cpu")


def test_people_are_told_apart_once_and_again_after_anything_has_changed(tmp_path, monkeypatch):
    """Whatever a stopped run has left is no reason to refuse, and one person can be asked for."""
    scene, subject, notes = made(tmp_path, [(-0.8, 0.8)] * 2), tmp_path / "ben.usdc", []
    subject.touch()
    asked = replace(scene, people={**scene.people, "ben": replace(scene.people["ben"], subject=subject)})
    sizes = [tuple(size[::-1]) for size in scene.rig().size]
    split = [[(np.arange(wide) < wide / 2) == (np.full((high, 1), n) == 0) for high, wide in sizes] for n in range(2)]
    nothing = [np.zeros(size, bool) for size in sizes]
    monkeypatch.setattr(mask_command, "_told_apart", lambda *_, **__: iter([(split, nothing)] * 2))
    (tmp_path / "apart").mkdir()
    (tmp_path / "apart" / "left").touch()
    reporter = SimpleNamespace(note=notes.append, warn=pytest.fail, stage=Reporter().stage)
    told = [
        mask_command.with_masks(each, reporter, TrackConfig())
        for each in (asked, asked.of_person("ben"), asked.of_frames(range(1, 2)))
    ]
    assert [(each.path, each.person, each.frame_count) for each in told] == [
        (tmp_path / "apart" / "scene.toml", person, count) for person, count in (("", 2), ("ben", 2), ("", 1))
    ]
    assert told[0].told_apart
    assert not told[0].of_several
    assert len(notes) == 1
    assert "overlay.webm" in notes[0]
    assert all(np.array_equal(a, b) for a, b in zip(next(told[0].of_person("anna").masks()), split[0], strict=True))
    for number, changed in enumerate((subject, scene.path, scene.calibration, scene.cameras[1].masks.files[0]), 2):
        later = (tmp_path / "apart" / "scene.toml").stat().st_mtime + 1
        os.utime(changed, (later, later))
        mask_command.with_masks(asked, reporter, TrackConfig())
        assert len(notes) == number
        os.utime(changed, (0, 0))


def test_subjects_are_those_of_the_first_frame(tmp_path):
    """Wherever they stand later, the trackers would start there."""
    scene, late = made(tmp_path / "scene", [(-0.8, 0.8)] * 3), synthetic_result(2).subject
    write_subject(tmp_path / "late.usdc", replace(late, provenance=late.provenance | {"fit.first_frame": 1}))
    subject = tmp_path / "late.usdc"
    everybody = {name: replace(person, subject=subject) for name, person in scene.people.items()}
    with pytest.raises(InputError, match="fitted to frame 1, but tracking begins with frame 0"):
        mask(replace(scene, people=everybody), tmp_path / "masks")
    assert not (tmp_path / "masks").exists()


def two_results() -> dict[str, mm.Result]:
    """Of anna, who is in doubt in the second frame, and of ben, who is lost in the fourth."""
    rows = {"anna": [0, 1, 0, 0], "ben": [0, 0, 0, 2]}
    results = {
        name: replace(synthetic_result(4, runs=1), status=np.array([row], np.int8)) for name, row in rows.items()
    }
    sigma = np.full((1, 4, len(results["anna"].subject.body.skeleton.joints), 3), 0.01)
    unsure = sigma.copy()
    unsure[0, 1, 3] = 0.22, 0.12, 0.06
    return {"anna": replace(results["anna"], joint_sigma=unsure), "ben": replace(results["ben"], joint_sigma=sigma)}


IN_DOUBT = {"anna": [[0, 1, 0, 1]], "ben": [[0, 1, 0, 2]]}


def test_a_frame_in_which_one_is_in_doubt_is_in_doubt_for_all():
    """Also for the verdict, which trusts a frame that is partial for want of a view alone."""
    results = two_results()
    done, frames = doubted_together(results)
    assert frames == 2
    for name, status in IN_DOUBT.items():
        np.testing.assert_array_equal(done[name].status, status)
    size = np.linalg.norm(results["anna"].joint_sigma[0, 1, 3])
    np.testing.assert_allclose(np.linalg.norm(done["ben"].joint_sigma[0, 1], axis=-1), size)
    np.testing.assert_array_equal(done["ben"].joint_sigma[0, [0, 2]], 0.01)
    assert verdict(done["ben"])["trusted"] == verdict(results["ben"])["trusted"] - 1
    again, _ = doubted_together(done)
    for name in done:
        np.testing.assert_array_equal(again[name].joint_sigma, done[name].joint_sigma)


def tracking(monkeypatch, failing=()):
    """Let everybody be tracked at once; gives who was asked for, and with what."""
    asked = []

    def track(person, *, output=None, **arguments):
        asked.append((person.person, arguments))
        if person.person in failing:
            raise InputError("masks", "are empty", "make them anew")
        result = two_results()[person.person]
        if output:
            write_result(output, result)
        return result

    monkeypatch.setattr(people_command, "track", track)
    monkeypatch.setattr(track_command, "track", lambda scene, output, **_: track(scene, output=output))
    return asked


@pytest.mark.parametrize("by", ["command", "function", "neither"])
def test_people_whom_poses_told_apart_are_doubted_together_however_they_are_tracked(tmp_path, monkeypatch, by, capsys):
    scene, output = made(tmp_path, [(-0.8, 0.8)] * 4, several=None), tmp_path / "result.usdc"
    asked = tracking(monkeypatch)
    if by == "command":
        main(["track", str(scene.path), "-o", str(output)])
        assert "in 2 frames one is in doubt, and so are all" in capsys.readouterr().err
    else:
        known = {} if by == "neither" else {"output": output}
        results = mm.track_people(scene.path, **known, device="cpu", trust_cameras=True)
        assert [*results] == ["anna", "ben"]
        assert asked[1][0] == "ben"
        assert {"device": "cpu", "trust_cameras": True}.items() <= asked[1][1].items()
    if by != "neither":
        results = {name: read_result(file) for name, file in results_in(output).items()}
    for name, status in IN_DOUBT.items():
        np.testing.assert_array_equal(results[name].status, status)


def test_who_cannot_be_tracked_is_left_out_with_a_warning(tmp_path, monkeypatch):
    scene = made(tmp_path, [(-0.8, 0.8)] * 4, several=None)
    tracking(monkeypatch, failing=["anna"])
    with pytest.warns(match="anna: masks: are empty"):
        assert [*mm.track_people(scene.path, output=tmp_path / "result.usdc")] == ["ben"]
    assert [*results_in(tmp_path / "result.usdc")] == ["ben"]
    tracking(monkeypatch, failing=["anna", "ben"])
    with pytest.warns(match="are empty"), pytest.raises(InputError, match="are empty"):
        mm.track_people(scene.path)
    with pytest.raises(UsageError, match="names no people"):
        mm.track_people(replace(scene, people={}))


def test_what_is_of_one_person_is_not_given_for_several(tmp_path, monkeypatch, capsys):
    scene = made(tmp_path, [(-0.8, 0.8)] * 4, several=None)
    asked = tracking(monkeypatch)
    for name in ("subject", "again"):
        assert main(["track", str(scene.path), "-o", str(tmp_path / "r.usdc"), f"--{name}", "one.usdc"]) == 2
        assert f"--{name} is of one person: choose one of anna, ben by --person" in capsys.readouterr().err
        with pytest.raises(UsageError, match=f"{name} is of one person"):
            mm.track_people(scene, **{name: "one.usdc"})
    assert not asked


@pytest.mark.parametrize("command", [["track"], ["track", "--person", "ben"], ["mask"]])
def test_the_device_reaches_the_telling_apart(tmp_path, monkeypatch, command):
    """Also from the command line, where the scene's own [track] would have it elsewhere."""
    scene, used = made(tmp_path, [(-0.8, 0.8)]), []
    with scene.path.open("a") as file:
        file.write('[track]\ndevice = "auto"\nseed = 7\n')
    subject = str(tmp_path / "s.usdc")
    write_subject(subject, synthetic_result(1).subject)
    scene.path.write_text(re.sub("(label = .)", rf"\1\nsubject = '{subject}'", scene.path.read_text()))

    def stop(scene, subjects, config):
        used.append((config.device, config.threads, config.seed))
        raise InputError("here", "it stops", "go on")

    monkeypatch.setattr(mask_command, "told_apart", stop)
    flags = ["-o", str(tmp_path / "masks")] if command == ["mask"] else ["-o", str(tmp_path / "r.usdc")]
    assert main([command[0], str(scene.path), *command[1:], *flags, "--device", "cpu", "--threads", "3"]) == 3
    assert used == [("cpu", 3, 7)]


def test_blobs_are_split_by_where_everybody_was_in_the_frame_before(tmp_path, monkeypatch):
    """Stand-ins for bodies and trackers: a pose is a place along x, and each tracker is told where it goes next."""
    places = [(-0.4, 0.4), (-0.36, 0.36), (-0.32, 0.32)]
    scene, told = made(tmp_path, places), {0: [], 1: []}

    class Tracker:
        def __init__(self, subject, rig, config, fps):
            self.person, self.state = subject, SimpleNamespace(pose=places[0][subject])

        def step(self, observation):
            told[self.person].append(observation)
            self.state = SimpleNamespace(pose=places[len(told[self.person]) - 1][self.person])

    monkeypatch.setattr(telling_apart, "make_tracker", Tracker)
    monkeypatch.setattr(telling_apart, "subject_carrying", lambda subject, things: (subject, ()))
    monkeypatch.setattr(telling_apart, "in_own_unit", lambda *of: of)
    monkeypatch.setattr(telling_apart, "body_silhouettes", lambda _, rig: lambda place: seen(rig, FIGURE, place))
    shared = undecided = 0
    for frame, (people, unsure) in enumerate(told_apart(scene, [0, 1], TrackConfig(device="cpu"))):
        figures = [seen(scene.rig(), FIGURE, place) for place in places[frame]]
        for k in range(VIEWS):
            both = figures[0][k] & figures[1][k]
            parts = [people[0][k], people[1][k], unsure[k]]
            np.testing.assert_array_equal(np.sum(parts, axis=0), figures[0][k] | figures[1][k])
            for n, own in enumerate((people[0][k], people[1][k])):
                wrong = own & ~figures[n][k]
                assert wrong.sum() < 0.12 * figures[n][k].sum()
            shared += both.sum()
            undecided += (unsure[k] & both).sum()
    assert undecided > 0.5 * shared > 0
    assert [len(each) for each in told.values()] == [3, 3]
    assert any(each.hidden is not None for each in told[0])
