"""Files that end or hold up the process that reads them do so to another one only."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import warnings

import native_readers
import pytest

from mmocap_warp.errors import InputError
from mmocap_warp.formats import sandbox


def readings(path) -> list[bool]:
    """Of each time that a file was read to its end, whether it was in this process."""
    return [int(line) == os.getpid() for line in path.with_suffix(".log").read_text().split()]


@pytest.mark.parametrize(
    ("text", "problem"),
    [("crash", "crashes the library"), ("loop", "takes more than 1 s"), ("swell", r"takes more than 1\.0 GiB")],
)
def test_a_file_that_ends_its_reader_is_refused(tmp_path, monkeypatch, text, problem):
    monkeypatch.setattr(sandbox, "_SECONDS", 1.0)
    for name in ("a", "b"):  # the process that it ended is started anew
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match=f"{name}: {problem}"):
            native_readers.read(tmp_path / name)
    (tmp_path / "good").write_text("good")
    assert native_readers.read(tmp_path / "good") == "good"


def test_a_process_that_somebody_kills_says_nothing_of_the_file(tmp_path):
    (tmp_path / "a").write_text("killed")
    assert native_readers.read(tmp_path / "a") == "killed"


def test_a_program_that_ends_leaves_no_process_behind(tmp_path):
    (tmp_path / "good").write_text("good")
    code = f"import native_readers; native_readers.read({str(tmp_path / 'good')!r})"
    command = [sys.executable, "-W", "always::ResourceWarning", "-c", code]
    environment = os.environ | {"PYTHONPATH": os.path.dirname(native_readers.__file__)}
    assert subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stderr == ""


def test_a_process_that_has_ended_leaves_no_pipe_open(tmp_path, monkeypatch):
    monkeypatch.setattr(sandbox, "_worker", sandbox._Worker())
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", ResourceWarning)
        for name in ("a", "b"):  # it ends for want of work in between
            (tmp_path / name).write_text(name)
            native_readers.read(tmp_path / name)
            sandbox._worker._running.kill()
            sandbox._worker._running.wait()
        (tmp_path / "c").write_text("crash")
        with pytest.raises(InputError, match="crashes the library"):
            native_readers.read(tmp_path / "c")
        gc.collect()
    assert [str(warning.message) for warning in told if warning.category is ResourceWarning] == []


def test_a_strange_file_is_tried_once_and_again_when_it_has_changed(tmp_path):
    path = tmp_path / "a"
    path.write_text("one")
    assert [native_readers.read(path) for _ in range(2)] == ["one", "one"]
    assert readings(path) == [False, True, True]
    path.write_text("another")
    assert native_readers.read(path) == "another"
    assert readings(path) == [False, True, True, False, True]


def test_a_file_of_ones_own_is_not_tried(tmp_path):
    path = tmp_path / "a"
    path.write_text("one")
    sandbox.trust(path)
    native_readers.read(path)
    assert readings(path) == [True]
