"""What ``mm.track`` hands on to the fit before it, and the cameras that it tracks with."""

from __future__ import annotations

import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from other_bodies import write_box
from walk_scene import walking

import mmocap_warp as mm
from mmocap_warp.calibration import first_look
from mmocap_warp.calibration.adjust.camera_changes import KINDS, OFFSET, changed
from mmocap_warp.calibration.refine import refinement
from mmocap_warp.calibration.refine.refinement import Overlaps, Refinement
from mmocap_warp.commands import track
from mmocap_warp.commands.inputs import scene_of, track_settings
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.attachments import Attachment
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.scenes import ROOT

SETTINGS = {"algorithm": "contour", "scale": 0.5, "device": "cpu", "threads": 1}


class Fitted(Exception):
    """Ends a run where its fit would begin."""


@pytest.mark.parametrize(("given", "used"), [({}, 4), ({"seed": 7}, 7), ({"config": mm.TrackConfig(seed=9)}, 9)])
def test_a_seed_that_is_given_is_the_fits_too(given, used, monkeypatch):
    """Otherwise the scene's own of its [fit] table holds."""

    def fit_subject(scene, body, config, *_rest):
        raise Fitted(config.seed)

    monkeypatch.setattr(track, "fit_subject", fit_subject)
    scene = replace(mm.load_scene(ROOT / "walk", "0:2"), subject=None, fit={"seed": 4})
    with pytest.raises(Fitted, match=f"^{used}$"):
        mm.track(scene, **given)


def walk_and_subject() -> tuple[mm.Scene, mm.Subject]:
    """Two frames of the shipped walk, and the person who walks."""
    made = walking()
    scene = replace(mm.load_scene(ROOT / "walk", "0:2"), truth=None)
    return scene, mm.Subject(made.body, made.root_base, made.poses[0], {})


def refining(monkeypatch, scene: mm.Scene, gain: float) -> list[mm.Subject | None]:
    """Let a refinement turn the second camera and find the third one late; held-out overlaps rise by ``gain``."""
    change, asked = np.zeros((len(scene.cameras), len(KINDS))), []
    change[1, KINDS.index("pan")], change[2, OFFSET] = 0.01, 1.25 / scene.fps
    overlap = np.full(len(change), 0.8)
    before, after = Overlaps(overlap, overlap), Overlaps(overlap + gain, overlap + gain)
    found = Refinement(changed(scene.calibrated, change), change, change, change != 0, change != 0, 0, before, after)

    def refine(recording, body, config, progress) -> Refinement:
        asked.append(config.subject)
        return found

    monkeypatch.setattr(refinement, "refine", refine)
    return asked


def test_refined_cameras_are_tracked_with_kept_and_read_again(tmp_path, monkeypatch):
    scene, subject = walk_and_subject()
    asked = refining(monkeypatch, scene, 0.05)
    settings = SETTINGS | {"cameras": "refine"}
    result = mm.track(scene, subject, output=tmp_path / "r.usdc", **settings)
    assert asked == [subject]
    assert result.config["refined_cameras"] == "r.calibration.toml"
    refined = changed(scene.calibrated, np.zeros((len(scene.cameras), len(KINDS)))).R[1]
    assert np.degrees(np.arccos((np.trace(result.cameras.R[1] @ refined.T) - 1) / 2)) == pytest.approx(0.573, abs=0.01)
    # An interrupted run goes on with the same cameras, and without them it is another run.
    monkeypatch.setattr(track, "write_result", interrupted)
    (tmp_path / "r.usdc").unlink()
    for resume in (False, True):
        with pytest.raises(KeyboardInterrupt):
            mm.track(scene, subject, output=tmp_path / "r.usdc", resume=resume, **settings)
    assert len(asked) == 2
    with pytest.raises(InputError, match=r"differs in its .*cameras"):
        mm.track(scene, subject, output=tmp_path / "r.usdc", resume=True, **SETTINGS)


def test_refined_cameras_of_a_run_that_is_gone_are_refined_anew(tmp_path, monkeypatch):
    scene, subject = walk_and_subject()
    asked = refining(monkeypatch, scene, 0.05)
    for _ in range(2):
        mm.track(scene, subject, output=tmp_path / "r.usdc", resume=True, **SETTINGS, cameras="refine")
        (tmp_path / "r.usdc").unlink()
    assert len(asked) == 2


def test_a_subject_that_was_fitted_to_something_else_is_not_taken(tmp_path, monkeypatch):
    scene, subject = walk_and_subject()
    fitted = []

    def fit_subject(scene, body, config, output, reporter, trusted):
        fitted.append(body.name)
        write_subject(output, replace(subject, provenance={f"fit.{key}": of for key, of in trusted.items()}))

    monkeypatch.setattr(track, "fit_subject", fit_subject)
    asked = {"output": tmp_path / "r.usdc", "resume": True, **SETTINGS}
    for body in ("adult_man", "adult_man", "adult_woman"):
        mm.track(scene, body=body, **asked)
        (tmp_path / "r.usdc").unlink()
    assert fitted == ["adult_man", "adult_woman"]
    mm.track(scene, body="adult_woman", **asked)
    with pytest.raises(InputError, match=r"r\.usdc: is of other frames"):
        mm.track(scene, body="adult_woman", rigid=True, **asked)
    # A run that was interrupted goes on with its own subject alone.
    (tmp_path / "r.usdc").unlink()
    monkeypatch.setattr(track, "write_result", interrupted)
    with pytest.raises(KeyboardInterrupt):
        mm.track(scene, body="adult_woman", **asked)
    with pytest.raises(InputError, match=r"checkpoint: is of a run of other frames, .* or of another body"):
        mm.track(scene, body="adult_man", **asked)


def test_checkpoints_of_other_pieces_are_removed(tmp_path):
    scene, subject = walk_and_subject()
    left = tmp_path / "r.usdc.checkpoint.1"
    left.touch()
    mm.track(scene, subject, output=tmp_path / "r.usdc", **SETTINGS)
    assert not left.exists()


def interrupted(*_: object) -> None:
    raise KeyboardInterrupt


def test_sound_cameras_stay_to_the_last_bit(tmp_path, monkeypatch):
    scene, subject = walk_and_subject()
    refining(monkeypatch, scene, -0.01)
    (tmp_path / "r.calibration.toml").write_text("of an older run")
    as_given = mm.track(scene, subject, **SETTINGS)
    result = mm.track(scene, subject, output=tmp_path / "r.usdc", **SETTINGS, cameras="refine")
    np.testing.assert_array_equal(result.pose, as_given.pose)
    np.testing.assert_array_equal(result.cameras.t, as_given.cameras.t)
    assert "refined_cameras" not in result.config
    assert not (tmp_path / "r.calibration.toml").exists()


def test_an_earlier_results_cameras_stay_until_others_are_known(tmp_path, monkeypatch):
    scene, subject = walk_and_subject()
    (tmp_path / "r.calibration.toml").write_text("of an older run")
    monkeypatch.setattr(refinement, "refine", interrupted)
    with pytest.raises(KeyboardInterrupt):
        mm.track(scene, subject, output=tmp_path / "r.usdc", **SETTINGS, cameras="refine")
    assert (tmp_path / "r.calibration.toml").read_text() == "of an older run"


@pytest.mark.parametrize(("command", "table"), [(mm.track, "track"), (mm.live, "track"), (mm.fit, "fit")])
def test_a_device_that_is_not_there_is_the_files_fault_or_the_callers(command, table):
    scene, subject = walk_and_subject()
    scene = replace(scene, **{table: {"device": "cuda:99"}})
    given = (scene,) if command is mm.fit else (scene, subject)
    with pytest.raises(InputError, match=rf"scene.toml: \[{table}\]: device must be .*; name one of these"):
        command(*given)
    with pytest.raises(mm.UsageError, match=r"^device must be"):
        command(*given, device="cuda:98")


def test_offsets_are_split_into_frames_and_the_rest():
    scene, _ = walk_and_subject()
    offsets = dict.fromkeys(scene.calibrated.names, 0.0) | {scene.calibrated.names[2]: 1.25 / scene.fps}
    late = scene.with_cameras(scene.calibrated, offsets).cameras
    assert [(source.frame_offset, source.fraction) for source in late[1:3]] == [(0, 0.0), (1, pytest.approx(0.25))]


LARGE = np.array([[1920, 1080], [1280, 720]])


@pytest.mark.parametrize(
    ("tall", "scale"),
    [((20, 20, 20), 1.0), ((76, 72, 0), 0.5), ((146, 150, 20), 0.5), ((147, 150, 0), 0.25), ((0, 0, 0), 0.5)],
)
def test_large_images_are_scaled_until_the_subject_has_220_to_440_pixels(tall, scale, monkeypatch):
    """By the median of the views that show somebody in the first frame; where none does, that is guessed."""
    masks = [np.zeros((180, 320), bool) for _ in tall]
    for mask, height in zip(masks, tall, strict=True):
        mask[5 : 5 + height, 7:12] = True
    scene = mm.load_scene(ROOT / "walk", "0:2")
    looked = []

    def few_masks(of):
        looked.append(of.frame_count)
        return SimpleNamespace(size=np.array([[320, 180], [213, 120]])), [masks]

    monkeypatch.setattr(first_look, "few_masks", few_masks)
    assert track_settings(scene, {"seed": 3}, None) == mm.TrackConfig(seed=3)  # 640x480
    large = replace(scene, calibrated=replace(scene.calibrated.select(scene.calibrated.names[:2]), size=LARGE))
    assert track_settings(large, {"seed": 3}, None) == mm.TrackConfig(seed=3, scale=scale)
    assert looked == [1]
    assert track_settings(large, {"scale": 0.75}, None).scale == 0.75
    assert track_settings(replace(large, track={"scale": 0.3}), {}, None).scale == 0.3
    assert track_settings(large, {}, mm.TrackConfig()).scale == 1.0
    assert track_settings(large, {}, None, seen=False).scale == 0.5
    assert looked == [1]


def test_a_complete_result_says_which_cameras_it_has(tmp_path):
    scene, subject = walk_and_subject()
    asked = {"output": tmp_path / "r.usdc", "resume": True, **SETTINGS}
    mm.track(scene, subject, **asked)
    mm.track(scene, subject, **asked, cameras="as given")
    with pytest.raises(InputError, match=r"r\.usdc: is of other frames, settings, cameras"):
        mm.track(scene, subject, **asked, cameras="refine")


def test_a_complete_result_is_without_what_was_attached_since(tmp_path):
    scene, subject = walk_and_subject()
    asked = {"output": tmp_path / "r.usdc", "resume": True, **SETTINGS}
    mm.track(scene, subject, **asked)
    thing = Attachment("Block", write_box(tmp_path / "box.obj", (0.1, 0.1, 0.1)))
    with pytest.raises(InputError, match=r"r\.usdc: is of other frames, .* or of another subject or body"):
        mm.track(replace(scene, attached=(thing,)), subject, **asked)


def test_a_result_that_is_mended_elsewhere_has_its_refined_cameras_there(tmp_path, monkeypatch):
    scene, subject = walk_and_subject()
    refining(monkeypatch, scene, 0.05)
    mm.track(scene, subject, output=tmp_path / "r.usdc", **SETTINGS, cameras="refine")
    (tmp_path / "other").mkdir()
    for name in ("m.usdc", "n.usdc"):  # the second one begins with the first
        again = tmp_path / "r.usdc" if name == "m.usdc" else tmp_path / "other" / "m.usdc"
        mended = mm.track(scene, again=again, frames="1:2", output=tmp_path / "other" / name)
    assert mended.config["refined_cameras"] == "n.calibration.toml"
    refined = scene_of(mended, tmp_path / "other" / "n.usdc", scene).calibrated
    assert not np.allclose(refined.R[1], scene.calibrated.R[1])


def test_what_says_how_a_subject_is_fitted_is_refused_beside_one():
    scene, subject = walk_and_subject()
    for given in ({"body": "adult_woman"}, {"rigid": True}):
        with pytest.raises(UsageError, match="body and rigid say how to fit a subject"):
            mm.track(scene, subject, **SETTINGS, **given)


def test_a_scene_of_cameras_that_end_apart_is_opened_for_the_frames_of_a_result(tmp_path):
    shutil.copytree(ROOT / "walk", tmp_path / "walk")
    for mask in sorted((tmp_path / "walk" / "masks" / "cam1").glob("*.png"))[-4:]:
        mask.unlink()
    scene = mm.load_scene(tmp_path / "walk", "0:2")
    result = mm.track(scene, walk_and_subject()[1], **SETTINGS)
    assert scene_of(result, None, None).frame_count == 2
    fitted = replace(result.subject, provenance={"fit.scene": str(tmp_path / "walk"), "fit.first_frame": 1})
    assert scene_of(fitted, None, None).frame_count == 1


def test_what_the_scene_names_is_not_replaced(tmp_path, monkeypatch):
    scene, subject = walk_and_subject()
    refining(monkeypatch, scene, -0.01)
    own = tmp_path / "r.calibration.toml"
    own.write_text("the scene's")
    with pytest.raises(InputError, match=r"r\.calibration\.toml: is the calibration that the scene names"):
        mm.track(replace(scene, calibration=own), subject, output=tmp_path / "r.usdc", **SETTINGS, cameras="refine")
    assert own.read_text() == "the scene's"
    own = tmp_path / "r.subject.usdc"
    write_subject(own, subject)
    with pytest.raises(InputError, match=r"r\.subject\.usdc: is the subject that the scene names"):
        mm.track(replace(scene, subject=own), body="adult_man", output=tmp_path / "r.usdc", **SETTINGS)
    with pytest.raises(InputError, match=r"r\.subject\.usdc: is the subject that the scene names"):
        mm.track(replace(scene, subject=own), output=own, force=True, **SETTINGS)


def test_poses_that_are_none_are_no_start():
    scene, _ = walk_and_subject()
    for wrong in (np.full((1, 51), np.nan), np.zeros(51), np.zeros((1, 3))):
        with pytest.raises(UsageError, match="start_poses must be finite and"):
            mm.fit(scene, "adult_man", start_poses=wrong, device="cpu", trust_cameras=True)


def test_what_a_live_session_writes_is_not_tracked_into(tmp_path):
    scene, subject = walk_and_subject()
    (tmp_path / "r.usdc.frames").touch()
    with pytest.raises(InputError, match="is of a live session that goes on or was killed"):
        mm.track(scene, subject, output=tmp_path / "r.usdc", force=True, **SETTINGS)


def test_axes_are_of_a_file():
    scene, subject = walk_and_subject()
    result = mm.track(scene, subject, **SETTINGS)
    with pytest.raises(UsageError, match="truth_axes are of a file"):
        mm.evaluate(result, mm.load_truth(ROOT / "walk" / "truth.usdc"), truth_axes="xyz")


def test_what_the_cluster_has_is_for_ray(tmp_path):
    with pytest.raises(UsageError, match="gpus and address need engine ray"):
        mm.batch(ROOT / "walk", tmp_path / "out", gpus=0.5)
