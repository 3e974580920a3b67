"""A file appears whole or not at all, whatever writes it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.file import write_stage
from mmocap_warp.formats.webm import WebmFile
from mmocap_warp.whole_file import whole_file, write_whole


def write_video(path: Path) -> None:
    with WebmFile(path, 30) as video:
        video.write(np.zeros((48, 64, 3), np.uint8))


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
