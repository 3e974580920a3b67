"""Damaged files of every kind: each is read, or refused in one line; and those that once were not."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
PACKAGE = FOLDER.parents[1] / "mmocap_warp"
ESCAPES = sorted(path for path in (FOLDER / "escapes").glob("*/*"))

_WORKER = "import sys; sys.path[:0] = sys.argv[1:3]; import worker; worker.replay(sys.argv[3])"


@pytest.mark.parametrize("cases", [4, pytest.param(300, marks=pytest.mark.nightly)])
def test_damaged_files_do_not_escape(cases):
    """Another process, since a file may end it; the command of docs/testing.md does the same with more."""
    options = ["--cases", str(cases), "--seed", "0", "--memory", "0.5"]
    fuzz = subprocess.run([sys.executable, str(FOLDER), *options], capture_output=True, text=True)
    assert fuzz.returncode == 0, fuzz.stdout + fuzz.stderr


@pytest.mark.parametrize("cases", [40, pytest.param(2000, marks=pytest.mark.nightly)])
def test_no_odd_tree_of_files_crashes_hangs_or_is_written_elsewhere(cases):
    options = ["--reader", "tree", "--cases", str(cases), "--seed", "1", "--seconds", "10", "--memory", "1"]
    fuzz = subprocess.run([sys.executable, str(FOLDER), *options], capture_output=True, text=True)
    assert fuzz.returncode == 0, fuzz.stdout + fuzz.stderr


def test_files_that_escaped_once_do_so_no_more():
    command = [sys.executable, "-c", _WORKER, str(FOLDER), str(FOLDER.parent), str(FOLDER / "escapes")]
    replay = subprocess.run(command, capture_output=True, text=True)
    assert replay.returncode == 0, replay.stdout + replay.stderr
    assert {f"{path.parent.name}/{path.name}" for path in ESCAPES} <= set(replay.stdout.splitlines())


@pytest.mark.parametrize("room", ["formats", "masks", "rigging", "scene", "study", "tracking"])
def test_no_reader_catches_whatever_comes(room):
    for path in (PACKAGE / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            caught = ast.unparse(node.type) if isinstance(node, ast.ExceptHandler) and node.type else ""
            blind = isinstance(node, ast.ExceptHandler) and (not caught or "Exception" in caught.split("."))
            assert not blind, f"{path}: line {node.lineno}"
