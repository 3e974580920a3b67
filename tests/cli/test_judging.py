"""What is drawn of a result is what was tracked."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from synthetic import ring_rig, synthetic_poses, synthetic_subject

import mmocap_warp as mm
from mmocap_warp import cli
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.cli import console
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.formats.usd.usd_result import read_result, write_result
from mmocap_warp.masks.observation import Observation
from mmocap_warp.tracking.tracker import Tracker

FRAMES = 4


def write_scene(folder: Path, *settings: str) -> Path:
    """Somebody tracked by three cameras, with something larger than the body beside it in every mask."""
    subject, rig = synthetic_subject(), ring_rig(3, (160, 120))
    posed = Poser(subject.body, subject.root_base).tracking_vertices(synthetic_poses(40)[:FRAMES])
    scene = ["[scene]", "fps = 60", 'up = "+y"', 'subject = "subject.usdc"', "[cameras]", 'calibration = "rig.toml"']
    for k, name in enumerate(rig.names):
        (folder / name).mkdir()
        for frame, vertices in enumerate(posed):
            mask = silhouettes(rig, vertices, subject.body.tracking_face)[k]
            free = slice(0, 30) if np.nonzero(mask)[1].mean() > 80 else slice(130, 160)
            mask[:, free] = True
            cv2.imwrite(str(folder / name / f"{frame:03d}.png"), mask * np.uint8(255))
        scene += [f"[cameras.{name}]", f'masks = "{name}"', f'video = "{name}"', 'clean_plate = "dark.png"']
    cv2.imwrite(str(folder / "dark.png"), np.zeros((120, 160), np.uint8))
    scene += ["[foreground]", *settings]
    scene += ["[track]", 'algorithm = "h-cmaes"', "evaluations = 60", "runs = 2", 'device = "cpu"']
    (folder / "scene.toml").write_text("\n".join(scene))
    write_toml_rig(folder / "rig.toml", rig)
    write_subject(folder / "subject.usdc", subject)
    return folder / "scene.toml"


@pytest.mark.parametrize("keep", ["all", "largest", "nearest"])
def test_the_masks_that_are_drawn_are_those_that_were_tracked(keep, tmp_path, monkeypatch):
    """Also where something larger than the body stands beside it, and two runs track apart."""
    scene = write_scene(tmp_path, f'keep = "{keep}"')
    tracked, drawn, step = [], [], Tracker.step

    def show(result, images, masks, **files):
        drawn.extend(Observation.from_masks(views) for views in masks)

    monkeypatch.setattr(Tracker, "step", lambda self, seen: tracked.append(seen) or step(self, seen))
    monkeypatch.setattr("mmocap_warp.display.result_video.show", show)
    code = console.CHECK_FAILED if keep == "largest" else console.OK  # the largest is not the body
    assert cli.main(["track", str(scene), "-o", str(tmp_path / "r.usdc"), "--quiet"]) == code
    assert cli.main(["show", str(tmp_path / "r.usdc"), "--quiet"]) == console.OK
    assert len(drawn) == FRAMES
    for mine, theirs in zip(drawn, tracked, strict=True):
        np.testing.assert_array_equal(mine.words, theirs.words)


def test_show_subtracts_nothing_that_was_tracked(tmp_path, monkeypatch):
    scene = write_scene(tmp_path, 'source = "clean_plate"', "median = 12", "close = 20", "min_area = 2000")
    # So small a body is cleaned away as a speck, and what stands beside it is no body.
    arguments = ["track", str(scene), "-o", str(tmp_path / "r.usdc"), "--quiet", "--trust-cameras"]
    assert cli.main(arguments) == console.CHECK_FAILED
    assert "no common hull" in read_result(tmp_path / "r.usdc").config["trusted_cameras"]
    monkeypatch.delattr("mmocap_warp.masks.subtraction.GaussianBackground.foreground")
    assert cli.main(["show", str(tmp_path / "r.usdc"), "--quiet"]) == console.OK
    assert (tmp_path / "r.webm").is_file()


def test_a_recording_of_which_only_a_leg_was_segmented_fails_the_check(tmp_path, capsys):
    """The subject stands and swings a leg: a background learnt from the recording itself swallows the rest."""
    scene = write_scene(tmp_path, 'source = "recording"', "min_area = 10", "median = 0", "close = 0")
    standing = cv2.imread(str(tmp_path / "cam01" / "000.png"))
    leg = np.s_[80:110, 70:90]
    for name in ("cam01", "cam02", "cam03"):
        for frame in range(FRAMES):
            image = standing.copy()
            image[leg] = 40 * (frame + 1)
            cv2.imwrite(str(tmp_path / name / f"{frame:03d}.png"), image)
    code = cli.main(["mask", str(scene), "-o", str(tmp_path / "made"), "--quiet"])
    told = capsys.readouterr().out
    assert code == console.CHECK_FAILED
    assert "check failed: what all views agree on holds" in told
    assert "only a part of it was segmented, such as a moving leg" in told
    assert "name an image without it (clean_plate)" in told


def test_masks_of_a_whole_subject_pass_the_check(tmp_path, capsys):
    scene = write_scene(tmp_path, 'keep = "nearest"')
    for file in tmp_path.glob("cam0*/*.png"):  # without what stands beside it
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        image[:, :30] = image[:, 130:] = 0
        cv2.imwrite(str(file), image)
    assert cli.main(["mask", str(scene), "-o", str(tmp_path / "made"), "--quiet", "--json"]) == console.OK
    report = json.loads(capsys.readouterr().out)
    assert report["masks_ok"]
    assert report["faults"] == []
    assert len(report["views"]["cam02"]["area_px"]) == FRAMES


def test_a_camera_that_is_off_is_said_after_the_last_frame(tmp_path, capsys):
    scene = write_scene(tmp_path, 'keep = "nearest"')
    rig = ring_rig(3, (160, 120))
    K = rig.K.copy()
    K[1, 0, 2] += 6
    write_toml_rig(tmp_path / "rig.toml", replace(rig, K=K))
    result = str(tmp_path / "r.usdc")
    codes = []
    for command in (["track", str(scene), "-o", result], ["eval", result], ["show", result]):
        codes.append(cli.main([*command, "--quiet", "--json"]))
        report = json.loads(capsys.readouterr().out)
        assert list(report["iou_by_camera"]) == ["cam01", "cam02", "cam03"]
        assert "cam02" in report["verdict"]["cameras"]
        assert (report["verdict"]["trusted"], report["verdict"]["holds"]) == (0, False)
        assert report["verdict"]["next"].startswith(f"mmocap calib refine {scene} ")
        assert report.get("next", report["verdict"]["next"]) == report["verdict"]["next"]
    assert codes == [console.CHECK_FAILED, console.CHECK_FAILED, console.OK]


def two_people(folder):
    """A scene of two bodies, the second one alike: identities 1 and 5, in every view at once."""
    scene = write_scene(folder)
    for file in sorted(folder.glob("cam0*/*.png")):
        body = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        body[:, :30] = body[:, 130:] = 0
        labels = np.where(body > 0, 1, 0).astype(np.uint8)
        labels[np.roll(body, 55, axis=1) > 0] = 5
        cv2.imwrite(str(file), labels)
    return scene


def test_the_person_of_an_identity_is_tracked_and_drawn(tmp_path, monkeypatch, capsys):
    scene = two_people(tmp_path)
    one = tmp_path / "one"
    one.mkdir()
    alone = write_scene(one)
    for file in sorted(one.glob("cam0*/*.png")):
        image = cv2.imread(str(tmp_path / file.relative_to(one)), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(file), (image == 1).astype(np.uint8) * 255)
    flags = ("--quiet", "--json")
    reports = []
    for path, identity in ((scene, ("--identity", "1")), (alone, ())):
        assert cli.main(["track", str(path), "-o", str(path.with_name("r.usdc")), *identity, *flags]) == console.OK
        reports.append(json.loads(capsys.readouterr().out))
    assert reports[0]["mean_iou"] == reports[1]["mean_iou"]
    drawn = []
    monkeypatch.setattr("mmocap_warp.display.result_video.show", lambda result, images, masks, **_: drawn.extend(masks))
    assert cli.main(["show", str(tmp_path / "r.usdc"), "--quiet"]) == console.OK
    first = cv2.imread(str(tmp_path / "cam01" / "000.png"), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(drawn[0][0], first == 1)


def test_an_identity_that_is_not_there_is_one_line(tmp_path, capsys):
    scene = two_people(tmp_path)
    assert cli.main(["fit", str(scene), "--identity", "2", "--quiet"]) == console.BAD_INPUT
    assert "cam01: no mask shows identity 2; set one that is there: 1, 5" in capsys.readouterr().err


def test_two_blobs_of_equal_size_are_noticed(tmp_path, capsys):
    scene = two_people(tmp_path)
    for file in sorted(tmp_path.glob("cam0*/*.png")):
        labels = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(file), (labels > 0).astype(np.uint8) * 255)
    text = scene.read_text()
    scene.write_text(text.replace("[foreground]", "[foreground]\njoin = 3"))
    cli.main(["mask", str(scene), "-o", str(tmp_path / "made")])
    told = capsys.readouterr().err
    assert "shows two blobs of about equal size" in told
    assert "one person is tracked at a time" in told
    assert "name their label under [labels] as several" in told


def test_one_person_is_no_news(tmp_path, capsys):
    scene = write_scene(tmp_path)
    cli.main(["mask", str(scene), "-o", str(tmp_path / "made")])
    assert "at a time" not in capsys.readouterr().err


def test_masks_are_drawn_anew_around_a_tracked_body(tmp_path, capsys):
    scene = write_scene(tmp_path, 'keep = "nearest"')
    bodies = {}
    for file in sorted(tmp_path.glob("cam0*/*.png")):
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        image[:, :30] = image[:, 130:] = 0
        bodies[file.relative_to(tmp_path)] = image > 0
        cv2.imwrite(str(file), image)
        coarse = tmp_path / "coarse" / file.relative_to(tmp_path)
        coarse.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(coarse), cv2.dilate(image, np.ones((7, 7), np.uint8)))
    scene.write_text(scene.read_text().replace('masks = "cam', 'masks = "coarse/cam'))
    result = tmp_path / "r.usdc"
    assert cli.main(["track", str(scene), "-o", str(result), "--quiet"]) == console.OK
    made = ["mask", str(scene), "-o", str(tmp_path / "made"), "--quiet", "--from-body"]
    cli.main([*made, str(result)])
    overlap = {"coarse": [], "made": []}
    for file, body in bodies.items():
        for folder, name in (("coarse", file.name), ("made", f"{int(file.stem):06d}.png")):
            mask = cv2.imread(str(tmp_path / folder / file.parent / name), cv2.IMREAD_GRAYSCALE) > 0
            overlap[folder].append((mask & body).sum() / (mask | body).sum())
    assert np.mean(overlap["coarse"]) < 0.6
    assert np.mean(overlap["made"]) > 0.8
    capsys.readouterr()
    made[3] = str(tmp_path / "again")
    assert cli.main([*made, str(tmp_path / "subject.usdc")]) == console.BAD_INPUT
    assert "is not a result; give the file that mmocap track wrote" in capsys.readouterr().err


def test_frames_with_a_gap_are_shown(tmp_path, monkeypatch):
    """As a live session leaves them whose machine stalled."""
    scene = write_scene(tmp_path, 'keep = "nearest"')
    result = tmp_path / "r.usdc"
    cli.main(["track", str(scene), "-o", str(result), "--quiet", "--trust-cameras"])
    kept = [number for number in range(FRAMES) if number not in (2,)]
    write_result(result, read_result(result).at(kept))
    for command in ("show", "view"):
        assert cli.main([command, str(result), "--quiet"]) == console.OK
    named = tmp_path / "truth.usdc"

    def other_frames(*_, **__) -> None:
        raise InputError("truth", "has other frames", "give the right one")

    monkeypatch.setattr("mmocap_warp.display.page.viewer.view", other_frames)
    monkeypatch.setattr("mmocap_warp.commands.show.load_truth", lambda _: None)
    with pytest.raises(InputError, match=r"truth\.usdc: has other frames"):
        mm.view(result, truth=named)
