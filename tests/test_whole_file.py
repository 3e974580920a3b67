"""A file appears whole or not at all, whatever writes it."""

from __future__ import annotations

import os
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd
from synthetic import synthetic_result

from mmocap_warp.errors import InputError
from mmocap_warp.formats.image_files import WebmFile, write_png
from mmocap_warp.formats.toml_table import relative_path
from mmocap_warp.formats.usd.usd_file import write_stage
from mmocap_warp.formats.usd.usd_result import export_animation, write_result
from mmocap_warp.whole_file import whole_file, write_whole


def write_video(path: Path) -> None:
    with WebmFile(path, 30) as video:
        video.write(np.zeros((48, 64, 3), np.uint8))


def write_long_video(path: Path) -> None:
    noise = np.random.default_rng(0)
    with WebmFile(path, 30) as video:
        for _ in range(40):
            video.write(noise.integers(0, 256, (120, 160, 3), np.uint8))


WRITERS: dict[str, Callable[[Path], None]] = {
    "bytes.bin": lambda path: write_whole(path, b"new"),
    "stage.usdc": lambda path: write_stage(path, Usd.Stage.CreateInMemory()),
    "video.webm": write_video,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_is_replaced_and_nothing_else_is_left(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"old")
    WRITERS[name](tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() != b"old"


def renaming_fails(_: object, __: object) -> None:
    raise OSError("no space left")


@pytest.mark.parametrize("name", WRITERS)
def test_a_link_stays_and_the_file_that_it_points_to_is_replaced(tmp_path: Path, name: str) -> None:
    (tmp_path / "elsewhere").mkdir()
    place = tmp_path / "elsewhere" / "kept.bin"
    place.write_bytes(b"old")
    (tmp_path / name).symlink_to("elsewhere/kept.bin")
    WRITERS[name](tmp_path / name)
    assert (tmp_path / name).is_symlink()
    assert place.read_bytes() != b"old"
    assert os.listdir(place.parent) == ["kept.bin"]
    assert sorted(os.listdir(tmp_path)) == sorted([name, "elsewhere"])


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """No file may be larger than ``size`` bytes: writing fails as it does on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


LARGE: dict[str, Callable[[Path], None]] = {
    "bytes.bin": lambda path: write_whole(path, bytes(20_000)),
    "picture.png": lambda path: write_png(path, np.random.default_rng(0).integers(0, 256, (80, 80, 3), np.uint8)),
    "video.webm": write_long_video,
    "result.usdc": lambda path: write_result(path, synthetic_result()),
    "result.usda": lambda path: write_result(path, synthetic_result()),
    "animation.usdz": lambda path: export_animation(synthetic_result(), path),
}


@pytest.mark.parametrize("name", LARGE)
def test_a_full_disk_leaves_what_was_there_and_is_told_in_a_sentence(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture
) -> None:
    LARGE[name](tmp_path / name)
    whole = (tmp_path / name).stat().st_size
    (tmp_path / name).write_bytes(b"old")
    capfd.readouterr()  # Warp has started
    for room in (0, 100, whole // 3, whole - 1000, whole - 1):
        with files_up_to(room), pytest.raises(InputError) as told:
            LARGE[name](tmp_path / name)
        assert str(told.value).startswith(f"{tmp_path / name}: cannot be written (")
        assert len(str(told.value)) < len(str(tmp_path)) + 200
        assert os.listdir(tmp_path) == [name]
        assert (tmp_path / name).read_bytes() == b"old"
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", WRITERS)
def test_a_failure_leaves_what_was_there(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / name).write_bytes(b"old")
    monkeypatch.setattr("os.replace", renaming_fails)
    with pytest.raises(InputError, match=r"cannot be written \(no space left\); check its folder"):
        WRITERS[name](tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() == b"old"


@pytest.mark.parametrize("name", WRITERS)
def test_a_folder_that_is_not_there_is_told(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="its folder does not exist; create the folder first"):
        WRITERS[name](tmp_path / "nowhere" / name)


def test_an_error_amid_writing_is_not_hidden(tmp_path: Path) -> None:
    def broken() -> None:
        with whole_file(tmp_path / "a.txt") as unfinished:
            unfinished.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken()
    assert list(tmp_path.iterdir()) == []


def test_another_drive_has_no_relative_path(tmp_path, monkeypatch):
    assert relative_path(tmp_path / "a" / "b", tmp_path) == Path("a/b")

    def other_drive(*_) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr("os.path.relpath", other_drive)
    assert relative_path(tmp_path / "a", tmp_path) == tmp_path / "a"
