"""The tutorial's commands do what it says, as they are written."""

from __future__ import annotations

import csv
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mmocap_warp as mm
from mmocap_warp.result.result import STATUS

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.M | re.S)


@pytest.fixture(scope="module")
def followed(tmp_path_factory) -> tuple[Path, str]:
    """The folder that a reader has at the end, and all that the commands printed.

    The recording comes from a copy of the clone; ``mmocap`` is the package that is tested, in place of the one that
    the first block installs, as `.ci/run` does before.
    """
    folder = tmp_path_factory.mktemp("tutorial")
    shutil.copytree(ROOT / "docs" / "tutorial", folder / "clone" / "docs" / "tutorial")
    programs = folder / "bin"
    programs.mkdir()
    mmocap = programs / "mmocap"
    mmocap.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m mmocap_warp "$@"\n')
    mmocap.chmod(0o755)
    _install, *rest = blocks("sh")
    answer = subprocess.run(
        ["bash", "-e", "-c", "".join(rest)],
        cwd=folder / "clone",
        env=os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert answer.returncode == 0, answer.stdout
    return folder / "capture", answer.stdout


def test_the_tutorial_installs_as_the_readme_does():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    install = blocks("sh")[0].splitlines()[-1]
    assert install == "pip install -e ."
    assert f"{install} && mmocap demo" in readme


def test_it_prints_what_the_tutorial_shows(followed):
    _, printed = followed
    shown = [line for block in blocks("text") for line in block.splitlines()]
    assert shown
    assert [line for line in shown if line not in printed.splitlines()] == []


def test_it_ends_with_a_body_that_follows_the_person(followed):
    folder, _ = followed
    result = mm.load_result(folder / "result.usdc")
    assert {STATUS[value] for value in result.status.ravel()} == {"tracked"}
    assert np.nanmean(result.iou) > 0.8
    moved = np.ptp(result.joints()[0, :, result.subject.body.skeleton.index("RWrist")], axis=0)
    assert 0.3 < np.linalg.norm(moved) < 1.5  # the right arm goes up


def test_it_ends_with_animations_a_page_and_tables(followed):
    folder, _ = followed
    assert (folder / "animation.glb").read_bytes()[:4] == b"glTF"
    assert "Frames: 40" in (folder / "animation.bvh").read_text()
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>")
    assert 1e6 < len(page) < 4e6
    with (folder / "measures" / "angles.csv").open(newline="") as table:
        assert len(list(csv.DictReader(table))) == 40


def test_every_picture_it_names_is_written(followed):
    folder, _ = followed
    for name in ("axes/cam01.png", "masks/overlay.webm", "subject.png", "result.webm", "result.png"):
        assert (folder / name).stat().st_size > 10_000
        assert Path(name).name in PAGE or name.startswith("axes")
