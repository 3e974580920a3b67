"""Two commands never write one output, and a command that died leaves nobody locked out."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from mmocap_warp.commands import outputs, show
from mmocap_warp.commands.caller import Reporter
from mmocap_warp.commands.outputs import new_file, new_folder
from mmocap_warp.errors import InputError

OTHER = """
import sys
from pathlib import Path
from mmocap_warp.commands.outputs import lock
lock(Path(sys.argv[1]))
print("claimed", flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def released() -> Iterator[None]:
    """A test's locks end with it."""
    yield
    outputs.release_locks()


@contextmanager
def claimed_elsewhere(output: Path) -> Iterator[subprocess.Popen]:
    """Another process writes an output."""
    with subprocess.Popen(
        [sys.executable, "-c", OTHER, str(output)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout.readline() == b"claimed\n"
        try:
            yield other
        finally:
            other.kill()


def test_a_file_that_another_process_writes_is_refused(tmp_path):
    with claimed_elsewhere(tmp_path / "r.usdc"):
        with pytest.raises(InputError, match=r"r\.usdc: another mmocap is writing it; wait until that ends"):
            new_file(tmp_path / "r.usdc", ".usdc")
        new_file(tmp_path / "s.usdc", ".usdc")


def test_a_folder_that_another_process_writes_is_refused(tmp_path):
    (tmp_path / "out").mkdir()
    with claimed_elsewhere(tmp_path / "out"), pytest.raises(InputError, match="out: another mmocap is writing it"):
        new_folder(tmp_path / "out")


def test_a_folder_that_is_there_is_judged_by_its_own_permissions(tmp_path, monkeypatch):
    there, unreadable = tmp_path / "there", tmp_path / "unreadable"
    there.mkdir(), unreadable.mkdir()
    denied = {(tmp_path, os.W_OK | os.X_OK), (unreadable, os.R_OK)}
    monkeypatch.setattr(os, "access", lambda path, mode: (path, mode) not in denied)
    assert new_folder(there) == there
    with pytest.raises(InputError, match="unreadable: cannot be read"):
        new_folder(unreadable)
    with pytest.raises(InputError, match="cannot be written to"):
        new_folder(tmp_path / "new")


def test_a_link_is_the_file_that_it_points_to(tmp_path):
    (tmp_path / "link.usdc").symlink_to("r.usdc")
    with claimed_elsewhere(tmp_path / "r.usdc"), pytest.raises(InputError, match="another mmocap"):
        new_file(tmp_path / "link.usdc", ".usdc")


def test_what_a_killed_process_claimed_can_be_claimed(tmp_path):
    with claimed_elsewhere(tmp_path / "r.usdc") as other:
        other.send_signal(signal.SIGKILL)
        other.wait()
    new_file(tmp_path / "r.usdc", ".usdc")
    outputs.release_locks()
    assert os.listdir(tmp_path) == []


def test_a_folder_whose_writer_was_killed_is_still_empty(tmp_path):
    (tmp_path / "out").mkdir()
    with claimed_elsewhere(tmp_path / "out") as other:
        other.send_signal(signal.SIGKILL)
        other.wait()
    assert os.listdir(tmp_path / "out") == [outputs.FOLDER_LOCK]
    new_folder(tmp_path / "out")


def test_what_is_released_is_free_and_gone(tmp_path):
    for _ in range(2):
        new_file(tmp_path / "r.usdc", ".usdc")
        new_file(tmp_path / "r.usdc", ".usdc")  # a command may ask twice
        outputs.release_locks()
        assert os.listdir(tmp_path) == []
    with claimed_elsewhere(tmp_path / "r.usdc"):
        pass


def test_a_lock_that_was_removed_while_it_was_opened_is_none(tmp_path, monkeypatch):
    """Whoever had it removes it between our opening and our locking: a third process would make another."""
    lock, locked, removed = tmp_path / ".r.usdc.lock", outputs._lock_opened, []

    def removing(file: int) -> bool:
        if not removed:
            removed.append(lock.unlink())
        return locked(file)

    monkeypatch.setattr(outputs, "_lock_opened", removing)
    new_file(tmp_path / "r.usdc", ".usdc")
    with pytest.raises(AssertionError), claimed_elsewhere(tmp_path / "r.usdc"):
        pytest.fail("the other one got it too")


def test_a_function_releases_what_it_locked_and_nothing_else(tmp_path):
    @outputs.releases_locks
    def write(name: str) -> list[str]:
        new_file(tmp_path / name, ".usdc")
        return sorted(os.listdir(tmp_path))

    new_file(tmp_path / "outer.usdc", ".usdc")
    assert write("r.usdc") == [".outer.usdc.lock", ".r.usdc.lock"]
    with pytest.raises(InputError):
        write("r.txt")
    assert os.listdir(tmp_path) == [".outer.usdc.lock"]


def test_all_of_a_result_is_drawn_unless_it_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[str] = []
    for name in ("show", "view"):
        monkeypatch.setattr(show, name, lambda result, output, **named: drawn.append(output.name) or output.touch())
    monkeypatch.setattr(show, "results_in", lambda result: {})
    (tmp_path / "r.usdc").touch()
    for force, made in ((False, ["r.webm", "r.html"]), (False, []), (True, ["r.webm", "r.html"])):
        drawn.clear()
        files = show.show_all(tmp_path / "r.usdc", Reporter(), force)
        assert drawn == made
        assert all(file.exists() for file in files.values())
