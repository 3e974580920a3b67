"""Devices, pipes, huge files and what other systems leave about: refused in a line, or passed over."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from small_scene import make_scene

from mmocap_warp.cli.console import BAD_INPUT, OK
from mmocap_warp.errors import InputError
from mmocap_warp.formats.rigged.part_meshes import part_mesh
from mmocap_warp.formats.toml_table import load_toml
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
    assert str(place) in answer.stderr
    assert not (tmp_path / "out" / "scene.toml").exists()


@pytest.mark.parametrize("read", [load_toml, content_hash, lambda path: part_mesh(path, path)], ids=str)
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
