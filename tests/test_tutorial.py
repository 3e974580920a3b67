"""The tutorial's commands do what it says, as they are written."""

from __future__ import annotations

import contextlib
import csv
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

import mmocap_warp as mm
from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.result.result import STATUS

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.M | re.S)


FRAMES = {"begun": 4, "whole": 40}
"""How many frames are masked and tracked: some, so that each command is tried in seconds, or all that the page says."""

QUICK = "\n[fit]\nheadings = 2\nevaluations = 100\nfinalists = 1\nframes = 2\n"
"""Settings of the fit to a few frames."""


@pytest.fixture(scope="module", params=["begun", pytest.param("whole", marks=pytest.mark.nightly)])
def followed(request, tmp_path_factory) -> tuple[Path, str, int]:
    """The folder that a reader has at the end, all that the commands printed, and how many frames were tracked.

    The recording comes from a copy of the clone; ``mmocap`` is the package that is tested, in place of the one that
    the first block installs, as `.ci/run` does before.
    """
    folder = tmp_path_factory.mktemp("tutorial")
    shutil.copytree(ROOT / "docs" / "tutorial", folder / "clone" / "docs" / "tutorial")
    _install, *rest = blocks("sh")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("mmocap_warp.fitting.subject_fit._ROUNDS", 0)  # in this process: limbs are not searched
        follow = follow_in_a_shell if request.param == "whole" else follow_in_this_process
        return folder / "capture", follow("".join(rest), folder), FRAMES[request.param]


def follow_in_a_shell(commands: str, folder: Path) -> str:
    """Give the page's commands to a shell, as they are written; all that they print."""
    programs = folder / "bin"
    programs.mkdir()
    mmocap = programs / "mmocap"
    mmocap.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m mmocap_warp "$@"\n')
    mmocap.chmod(0o755)
    answer = subprocess.run(
        ["bash", "-e", "-c", commands],
        cwd=folder / "clone",
        env=os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert answer.returncode == 0, answer.stdout
    return answer.stdout


def follow_in_this_process(commands: str, folder: Path) -> str:
    """Give the page's commands for some of the frames, a quick fit, and without a process for each."""
    assert "--frames 40\n" in commands
    assert " --cameras refine " in commands  # which a few frames are too few for
    commands = commands.replace("--frames 40\n", f"--frames {FRAMES['begun']}\n").replace(" --cameras refine", "")
    printed = io.StringIO()
    with contextlib.chdir(folder / "clone"), redirect_stdout(printed), redirect_stderr(printed):
        for command in commands.replace("&&", "\n").splitlines():
            program, *arguments = shlex.split(command)
            if program == "cd":
                os.chdir(*arguments)
            elif program == "mmocap":
                assert cli.main(arguments) == console.OK, printed.getvalue()
                if arguments[0] == "mask":
                    with Path("masks", "scene.toml").open("a", encoding="utf-8") as scene:
                        scene.write(QUICK)
            else:
                subprocess.run([program, *arguments], check=True)
    return printed.getvalue()


def test_the_tutorial_installs_as_the_readme_does():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    install = blocks("sh")[0].splitlines()[-1]
    assert install == "pip install -e ."
    assert f"{install} && mmocap demo" in readme


def test_it_prints_what_the_tutorial_shows(followed):
    _, printed, frames = followed
    shown = [
        re.sub(r"\b40 frames", f"{frames} frames", line) for block in blocks("text") for line in block.splitlines()
    ]
    assert shown
    assert [line for line in shown if line not in printed.splitlines()] == []


def test_it_ends_with_a_body_that_follows_the_person(followed):
    folder, _, frames = followed
    result = mm.load_result(folder / "result.usdc")
    assert {STATUS[value] for value in result.status.ravel()} == {"tracked"}
    assert np.nanmean(result.iou) > 0.8
    assert len(result.frame_numbers) == frames
    if frames < 40:
        return
    moved = np.ptp(result.joints()[0, :, result.subject.body.skeleton.index("RWrist")], axis=0)
    assert 0.3 < np.linalg.norm(moved) < 1.5  # the right arm goes up


def test_it_ends_with_animations_a_page_and_tables(followed):
    folder, _, frames = followed
    assert (folder / "animation.glb").read_bytes()[:4] == b"glTF"
    assert f"Frames: {frames}" in (folder / "animation.bvh").read_text()
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>")
    assert (1e6 if frames == FRAMES["whole"] else 0.5e6) < len(page) < 4e6  # the images are of its frames
    with (folder / "measures" / "angles.csv").open(newline="") as table:
        assert len(list(csv.DictReader(table))) == frames


def test_every_picture_it_names_is_written(followed):
    folder, *_ = followed
    for name in ("axes/cam01.png", "masks/overlay.webm", "subject.png", "result.webm", "result.png"):
        assert (folder / name).stat().st_size > 10_000
        assert Path(name).name in PAGE or name.startswith("axes")
