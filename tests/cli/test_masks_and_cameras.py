"""``mmocap mask`` and ``cameras`` on a small made-up recording: what they write, and what they leave alone."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_answer import answer
from moving_figure import SCENE, write_moving_figure
from small_scene import SCENE as SMALL
from small_scene import SIZE, make_scene

from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.scene.scene_toml import load_scene

pytestmark = pytest.mark.usefixtures("no_network")


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    return write_moving_figure(tmp_path_factory.mktemp("recording"))


def test_masks_of_an_earlier_run_are_gone(scene, tmp_path, capsys):
    for frames, count in (("2:8", 6), ("0:3", 3)):
        answer(capsys, "mask", scene, "-o", tmp_path / "masks", "--frames", frames, "--force")
        assert len([*(tmp_path / "masks" / "cam01").glob("*.png")]) == count


def test_masks_do_not_replace_what_they_are_made_of(scene, tmp_path, capsys):
    folder = tmp_path / "copy"
    shutil.copytree(scene.parent, folder)
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    for output in (folder, folder / "masks", folder / "masks" / "cam01", folder / ".." / "copy"):
        assert cli.main(["mask", str(folder), "-o", str(output), "--force"]) == console.BAD_INPUT
        assert "holds the scene, or masks or videos that are read" in capsys.readouterr().err
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before


def test_each_persons_masks_are_judged(tmp_path, capsys):
    folder, labels = make_scene(tmp_path), np.zeros(SIZE[::-1], np.uint8)
    labels[10:40, 10:24], labels[10:40, 30:40] = 1, 2
    for file in (folder / "masks").glob("*/*.png"):
        cv2.imwrite(str(file), np.where(labels == 2, 0, labels) if "cam02" in file.parts else labels)
    (folder / "scene.toml").write_text(f"{SMALL}[people.anna]\nlabel = 1\n[people.ben]\nlabel = 2\n")
    flags = ["-o", str(tmp_path / "made"), "--json"]
    assert cli.main(["mask", str(folder), *flags]) == console.CHECK_FAILED
    report = json.loads(capsys.readouterr().out)
    empty = {name: view["empty_frames"] for name, view in report["views"].items()}
    assert empty == {f"{name}: cam0{k}": 3 * (name == "ben" and k == 2) for name in ("anna", "ben") for k in (1, 2, 3)}
    assert "ben: cam02 shows nothing in 3 of 3 frames" in report["faults"]


def test_masks_of_some_frames_keep_their_numbers(scene, tmp_path, capsys):
    written = answer(capsys, "mask", scene, "-o", tmp_path / "masks", "--frames", "1:8:3")
    part, whole = load_scene(written["scene"]), load_scene(scene)
    assert (list(part.frames), part.fps) == ([1, 4, 7], 60)
    for masks, same in zip(part.masks(), whole.of_frames(range(1, 8, 3)).masks(), strict=True):
        np.testing.assert_array_equal(masks[1], same[1])


def test_cameras_draws_into_every_view(scene, tmp_path, capsys):
    report = answer(capsys, "cameras", scene, "-o", tmp_path / "axes")
    assert sorted(os.listdir(tmp_path / "axes")) == ["cam01.png", "cam02.png", "cam03.png"]
    assert report["pictures"] == [str(tmp_path / "axes" / f"cam0{k}.png") for k in (1, 2, 3)]
    assert cli.main(["cameras", str(scene), "-o", str(tmp_path / "axes"), "--force"]) == console.OK
    assert str(tmp_path / "axes" / "cam03.png") in capsys.readouterr().out
    assert report["mean_height_m"] == pytest.approx(1.4)


def test_cameras_below_the_floor_fail_the_check(scene, capsys):
    turned = scene.with_name("turned.toml")
    turned.write_text(SCENE.replace('"+y"', '"-y"'))
    assert cli.main(["cameras", str(turned)]) == console.CHECK_FAILED
    assert "mean height is -1.40 m" in capsys.readouterr().out
