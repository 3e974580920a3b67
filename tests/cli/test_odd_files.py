"""Devices, pipes, huge files and what other systems leave about: refused in a line, or passed over."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from small_scene import SIZE, make_scene
from synthetic import ring_rig

from mmocap_warp import cli
from mmocap_warp.cli.console import BAD_INPUT, OK
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.image_files import write_png
from mmocap_warp.formats.rigged.part_meshes import part_mesh
from mmocap_warp.formats.toml_table import load_toml
from mmocap_warp.formats.usd.usd_camera import write_usd_cameras
from mmocap_warp.scene.camera_tables import write_timing
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.whole_file import content_hash, read_bytes

pytestmark = pytest.mark.skipif(os.name != "posix", reason="about POSIX's pipes and devices")
SECONDS, BYTES = 20, 1 << 30


def mmocap(*arguments: object) -> subprocess.CompletedProcess:
    """A command, in a process that may take a gigabyte of memory beyond what libraries reserve, and little time."""
    import resource

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_DATA, (BYTES, BYTES))

    command = [sys.executable, "-m", "mmocap_warp", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=SECONDS * 3, preexec_fn=limit)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("scene.toml", "device"),
        ("calibration.toml", "pipe"),
        ("masks/cam01/0001.png", "pipe"),
        ("masks/cam01/masks.toml", "pipe"),
        ("masks/cam02", "device"),
    ],
)
def test_what_has_no_end_is_no_file(tmp_path: Path, name: str, kind: str) -> None:
    make_scene(tmp_path)
    place = tmp_path / name
    if place.is_dir():
        place.rename(tmp_path / "elsewhere")
    place.unlink(missing_ok=True)
    if kind == "device":
        place.symlink_to("/dev/zero")
    else:
        os.mkfifo(place)
    answer = mmocap("mask", tmp_path, "-o", tmp_path / "out")
    if name.endswith("masks.toml"):
        assert answer.returncode == OK  # a mark that is no file is none
        return
    assert answer.returncode == BAD_INPUT, answer.stderr
    assert answer.stderr.count("\n") == 1
    assert answer.stderr.count(str(place)) == 1
    assert not (tmp_path / "out" / "scene.toml").exists()


READERS = {"toml": load_toml, "hash": content_hash, "mesh": lambda path: part_mesh(path, path)}


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_no_reader_waits_for_a_pipe(tmp_path: Path, read) -> None:
    os.mkfifo(tmp_path / "a.stl")
    with pytest.raises(InputError, match="is no regular file"):
        read(tmp_path / "a.stl")


def test_a_file_of_another_size_than_it_can_have_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "scene.toml").open("wb") as file:
        file.truncate(1 << 40)  # without a byte on the disk
    with pytest.raises(InputError, match="has over 4 MB"):
        load_toml(tmp_path / "scene.toml")
    with pytest.raises(InputError, match="has over 256 MB"):
        read_bytes(tmp_path / "scene.toml", "copy it again")


def test_what_macos_leaves_beside_masks_is_passed_over(tmp_path: Path) -> None:
    make_scene(tmp_path)
    for name in ("._0000.png", ".DS_Store", "Thumbs.db"):
        (tmp_path / "masks" / "cam01" / name).write_bytes(b"\0\5\26\7")
    assert cli.main(["mask", str(tmp_path), "-o", str(tmp_path / "out"), "--quiet"]) == OK
    assert len(list((tmp_path / "out" / "cam01").glob("*.png"))) == 3
    (tmp_path / "scene.toml").unlink()
    assert cli.main(["init", str(tmp_path)]) == OK


def test_a_byte_order_mark_is_passed_over(tmp_path: Path) -> None:
    make_scene(tmp_path)
    for name in ("scene.toml", "calibration.toml"):
        (tmp_path / name).write_bytes(b"\xef\xbb\xbf" + (tmp_path / name).read_bytes().replace(b"\n", b"\r\n"))
    assert load_scene(tmp_path).frame_count == 3
    write_timing(tmp_path / "scene.toml", {"cam02": {"offset": 1 / 60}})
    assert load_scene(tmp_path).cameras[1].frame_offset == 1


@pytest.mark.parametrize(
    ("change", "hint"),
    [
        (lambda mask: np.rot90(mask), "turned by 90 degrees"),
        (lambda mask: np.rot90(mask, -1), "turned by 90 degrees"),
        (lambda mask: mask[::2, ::2], "{ scale = 0.5, offset = [-0.25, -0.25] }"),
        (lambda mask: mask.repeat(2, axis=0).repeat(2, axis=1), "{ scale = 2.0, offset = [0.5, 0.5] }"),
        (lambda mask: mask[:40], "{ scale = ..., offset = [...] }"),
    ],
)
def test_masks_of_another_size_get_a_hint_that_is_right(tmp_path: Path, capsys, change, hint: str) -> None:
    make_scene(tmp_path)
    for file in (tmp_path / "masks" / "cam01").iterdir():
        write_png(file, np.ascontiguousarray(change(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE))))
    assert cli.main(["cameras", str(tmp_path)]) == BAD_INPUT
    said = capsys.readouterr().err
    assert hint in said
    if "scale = 0.5" in hint:  # what it says to do is right
        text, line = (tmp_path / "scene.toml").read_text(), said[said.index("video_from") :].strip()
        (tmp_path / "scene.toml").write_text(text.replace("[cameras.cam01]", f"[cameras.cam01]\n{line}"))
        halved, whole = next(load_scene(tmp_path).masks())[:2]
        assert (halved != whole).mean() < 0.01


@pytest.mark.parametrize(("unit", "metres"), [("cm", 0.01), ("in", 0.0254), ("mm", 0.001)])
def test_a_calibration_in_another_unit_is_told_which(tmp_path: Path, capsys, unit: str, metres: float) -> None:
    make_scene(tmp_path)
    rig = ring_rig(3, SIZE)
    write_toml_rig(tmp_path / "calibration.toml", replace(rig, t=rig.t / metres))
    assert cli.main(["cameras", str(tmp_path)]) == BAD_INPUT
    assert f'units = "{unit}"' in capsys.readouterr().err
    text = (tmp_path / "scene.toml").read_text()
    (tmp_path / "scene.toml").write_text(text.replace("[cameras]", f'[cameras]\nunits = "{unit}"'))
    np.testing.assert_allclose(load_scene(tmp_path).calibrated.t, rig.t, atol=1e-6)


@pytest.mark.parametrize("axis", ["Y", "Z"])
def test_the_vertical_of_a_usd_calibration_is_the_scenes(tmp_path: Path, capsys, axis: str) -> None:
    make_scene(tmp_path)
    up, other = f"+{axis.lower()}", "+z" if axis == "Y" else "+y"
    write_usd_cameras(tmp_path / "calibration.usda", ring_rig(3, SIZE, up=up))
    text = (tmp_path / "scene.toml").read_text().replace("calibration.toml", "calibration.usda")
    for stated, code in (("", OK), (f'up = "{up}"\n', OK), (f'up = "{other}"\n', BAD_INPUT)):
        (tmp_path / "scene.toml").write_text(text.replace('up = "+y"\n', stated))
        assert cli.main(["cameras", str(tmp_path)]) == code
        answer = capsys.readouterr()
        assert (f"along {up}" in answer.out) if code == OK else (f"calibration.usda says {up}" in answer.err)
