"""The functions for cameras take and give objects, and name wrong arguments as in Python."""

from __future__ import annotations

import numpy as np
import pytest
from moving_person import BODY, FPS, RIG, write_scene

import mmocap_warp as mm
from mmocap_warp.calibration import camera_check
from mmocap_warp.calibration.adjust.camera_changes import KINDS, OFFSET, changed
from mmocap_warp.calibration.camera_check import BodyInView, CameraCheck, Finding
from mmocap_warp.calibration.refine import refinement
from mmocap_warp.calibration.refine.refinement import Overlaps
from mmocap_warp.calibration.solve import solution
from mmocap_warp.calibration.sync import synchronise
from mmocap_warp.calibration.sync.lag_course import LagCourse
from mmocap_warp.calibration.sync.synchronise import ViewOffset
from mmocap_warp.scenes import ROOT


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> mm.Scene:
    folder = tmp_path_factory.mktemp("scene")
    write_scene(folder, frames=2)
    return mm.load_scene(folder)


def refined(gain: float) -> mm.Refinement:
    """The third camera late; frames that had no part are explained better by ``gain``."""
    change = np.zeros((len(RIG), len(KINDS)))
    change[2, OFFSET] = 0.05
    before, after = (Overlaps(np.full(len(RIG), iou), np.full(len(RIG), iou - 0.1)) for iou in (0.8, 0.8 + gain))
    sigma, moved = np.full(change.shape, 0.01), change != 0
    return mm.Refinement(changed(RIG, change), change, sigma, moved, ~moved, 0, before, after)


def test_cameras_are_described_and_drawn(tmp_path):
    shown = mm.show_cameras(ROOT / "walk", tmp_path / "axes")
    assert shown.plausible
    assert shown.mean_height > 0
    assert [row.split()[0] for row in repr(shown).splitlines()[2:]] == [row.name for row in shown.rows]
    assert [file.name for file in shown.pictures] == [f"{row.name}.png" for row in shown.rows]
    assert all(file.is_file() for file in shown.pictures)
    assert not [file for file in (tmp_path / "axes").iterdir() if file.name.endswith(".lock")]


def test_a_refinement_is_written_only_if_it_is_better(scene, tmp_path, monkeypatch):
    given = []

    def refine(recording, body, config, progress) -> mm.Refinement:
        given.append((recording, body, config))
        return refined(0.05 if config.seed == 0 else -0.05)

    monkeypatch.setattr(refinement, "refine", refine)
    better = mm.refine_cameras(scene, tmp_path / "better.toml", body=BODY, height=1.8, rotation=0.0)
    worse = mm.refine_cameras(scene.path, tmp_path / "worse.toml", body=BODY, seed=1)
    recording, body, config = given[0]
    assert recording is scene
    assert body is BODY
    assert (config.height, config.deviations.rotation, config.deviations.position) == (1.8, 0.0, 0.2)
    assert better.offsets(scene)["cam03"] == 0.05
    assert (tmp_path / "better.toml").is_file()
    assert not (tmp_path / "worse.toml").exists()
    assert repr(better) == "Refinement: cam03 moved, held-out IoU 0.800 to 0.850, better"
    assert repr(worse).endswith("not better")


def test_what_disagrees_is_said_in_a_line_and_drawn(scene, tmp_path, monkeypatch):
    mask = np.zeros((40, 60), bool)
    mask[10:30, 20:40] = True
    share, view = np.ones(len(RIG)), BodyInView("cam02", mask, mask, ~mask)
    result = CameraCheck(RIG.names, share, share, (Finding("cam02", "mirrored"),), 1.0, (view,))
    monkeypatch.setattr(camera_check, "check", lambda *_: result)
    checked = mm.check_cameras(scene, body=BODY, pictures=tmp_path / "views")
    assert repr(checked) == "CameraCheck: cam02 (mirrored) disagrees"
    assert [file.name for file in checked.pictures] == ["cam02.png"]
    assert checked.pictures[0].is_file()


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ([("cam02", "rotation"), ("cam02", "focal length")], "cam02 (rotation), cam02 (focal length) disagrees"),
        ([("cam01", "rotation"), ("cam02", "position")], "cam01 (rotation), cam02 (position) disagree"),
        ([("all cameras", "graphics axes")], "all cameras (graphics axes) disagree"),
        ([], f"all {len(RIG)} cameras agree"),
    ],
)
def test_one_camera_disagrees_and_several_disagree(found, said):
    findings = tuple(Finding(*each) for each in found)
    assert repr(CameraCheck(RIG.names, np.ones(len(RIG)), None, findings, 1.0)) == f"CameraCheck: {said}"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"fixed": "cam9"}, r"^fixed must name one of cam01"),
        ({"height": 0.0}, r"^height must be in \(0, 3\) m"),
        ({"height": 17.0}, r"^height must be in \(0, 3\) m"),
        ({"distance": ("cam01", "cam01", 3.0)}, r"^distance must be of two cameras, got cam01 twice"),
        ({"rotation": -1.0}, r"^rotation must be finite and not negative"),
        ({"scale": 2.0}, r"^scale must be in"),
        ({"device": "cuda:99"}, r"^device must be"),
        ({"seed": -1}, r"^seed must be in 0"),
        ({"threads": 0}, r"^threads must be at least 1, got 0"),
    ],
)
def test_wrong_settings_are_named_as_in_python(scene, arguments, message):
    with pytest.raises(mm.UsageError, match=message):
        mm.refine_cameras(scene, body=BODY, **arguments)
    with pytest.raises(TypeError, match="heigth"):
        mm.refine_cameras(scene, body=BODY, heigth=1.8)


def test_only_wrong_arguments_are_told_as_such(scene, monkeypatch):
    def singular(*_: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("mmocap_warp.commands.calibrate.look_first", lambda *_, **__: None)
    monkeypatch.setattr(synchronise, "synchronise", singular)
    monkeypatch.setattr(solution, "solve_cameras", singular)
    with pytest.raises(np.linalg.LinAlgError):
        mm.sync(scene)
    with pytest.raises(np.linalg.LinAlgError):
        mm.solve_cameras(scene, 1.8)


def test_a_rig_is_written_for_another_program(tmp_path):
    rig = mm.convert_cameras(RIG, tmp_path / "rig.toml")
    assert rig is RIG
    again = mm.convert_cameras(tmp_path / "rig.toml", tmp_path / "intri.yml", up=RIG.up)
    np.testing.assert_allclose(again.R, RIG.R, atol=1e-9)
    assert (tmp_path / "extri.yml").is_file()
    with pytest.raises(mm.UsageError, match=r"^size must be such as 1920x1080, got 'large'"):
        mm.convert_cameras(RIG, tmp_path / "other.toml", size="large")


def test_offsets_say_what_the_scene_file_needs_and_what_is_in_doubt(scene):
    sure, doubtful = ViewOffset(0, 0.1, 0, 1.0, True), ViewOffset(3, 0.9, 33, 1.0, False)
    faster = ViewOffset(0, 0.1, 0, 1.0, True, LagCourse(slope=0.01))
    views = dict(zip(RIG.names, (sure, sure, doubtful, faster), strict=True))
    offsets = mm.Synchronisation(FPS, views, None)
    assert not offsets.sure
    assert offsets.timing(scene)["cam03"] == {"offset": round(3 / FPS, 6)}
    assert offsets.timing(scene)["cam04"]["fps"] == pytest.approx(1.01 * FPS)
    motion, rate = offsets.faults(scene)
    assert "cam03 fits 90 % as well 30 frames later: the motion repeats itself every 30 frames" in motion
    assert f"cam04 runs 1.0 % faster than it says, or dropped frames here and there: set fps = {1.01 * FPS:g}" in rate
    assert repr(offsets).endswith("cam01 +0, cam02 +0, cam03 +3?, cam04 +0")
