"""Poses to start from: frames of a motion that came with a body, or a file of angles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from other_bodies import quadruped

from mmocap_warp.body.model import BodyMotion
from mmocap_warp.cli import main
from mmocap_warp.cli.console import BAD_INPUT
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import write_body
from mmocap_warp.rigging.start_poses import start_poses
from mmocap_warp.scenes import ROOT as SCENES

DOG = quadruped()
WALK = np.random.default_rng(0).normal(size=(30, DOG.skeleton.coordinates))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_body(tmp_path / "dog.usdc", DOG, {"Walk": BodyMotion(30.0, WALK), "Sit": BodyMotion(30.0, WALK[:1])})
    return tmp_path / "dog.usdc"


def test_frames_of_motions_and_angles_of_a_file(file: Path) -> None:
    angles = file.with_name("sitting.toml")
    angles.write_text("LForeHip.Rx = 90\n[Head]\nRx = -30\n")
    found = start_poses(file, ["Walk", "Sit", str(angles)])
    np.testing.assert_allclose(found[[0, 7, 8]], WALK[[1, 28, 0]])
    assert len(found) == 8 + 1 + 1
    named = {DOG.skeleton.coordinate_names[i]: found[-1, i] for i in np.flatnonzero(found[-1])}
    assert named == pytest.approx({"LForeHip.Rx": np.pi / 2, "Head.Rx": -np.pi / 6})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Tail.Rx = 3\n", "no joint 'Tail'"),
        ("Head.Rw = 3\n", "unknown key 'Rw'"),
        ("Head = 3\n", "unknown key 'Head'"),
        ('Head.Rx = "up"\n', "is not"),
    ],
)
def test_a_file_of_angles_that_cannot_be_is_told(file: Path, text: str, said: str) -> None:
    angles = file.with_name("sitting.toml")
    angles.write_text(text)
    with pytest.raises(InputError, match=said):
        start_poses(file, [str(angles)])


def test_a_motion_that_there_is_not_is_told_with_those_that_there_are(file: Path) -> None:
    with pytest.raises(InputError, match="no motion 'Trot'") as told:
        start_poses(file, ["Trot"])
    assert "Walk, Sit" in told.value.remedy


def test_every_command_tells_it_alike(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = str(SCENES / "walk")
    for command in (
        ["fit", scene, "--body", str(file), "--start-pose", "Trot", "-o", str(file.with_name("subject.usdc"))],
        ["body", "learn", str(file), "--motion", "Trot", "-o", str(file.with_name("learnt.usdc"))],
        ["synth", str(file), "--motion", "Trot", "-o", str(file.with_name("scene"))],
    ):
        assert main([*command, "--quiet"]) == BAD_INPUT
        assert capsys.readouterr().err == f"mmocap: {file}: has no motion 'Trot'; name one of Walk, Sit\n"
