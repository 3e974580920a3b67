"""Limits and spreads of angles, learnt from what a body was seen to do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from other_bodies import quadruped

from mmocap_warp.body.model import BodyMotion
from mmocap_warp.cli import main
from mmocap_warp.formats.usd.usd_body import read_body, read_motions, write_body
from mmocap_warp.rigging.start_poses import learnt

DOG = quadruped()
KNEE = DOG.skeleton.angles("LForeKnee").start
HIP = DOG.skeleton.angles("LForeHip").start


def walk(frames: int = 1000) -> np.ndarray:
    """A knee from 0.2 to 1.0 rad, evenly, and a trunk that turns round."""
    poses = np.zeros((frames, DOG.skeleton.coordinates))
    poses[:, KNEE] = np.linspace(0.2, 1.0, frames)
    poses[:, 4] = np.linspace(0, 6, frames)
    return poses


def test_limits_are_a_margin_beyond_what_was_seen() -> None:
    skeleton = learnt(DOG.skeleton, walk(), 0.1)
    np.testing.assert_allclose(skeleton.coordinate_limits[KNEE], (0.1, 1.1), atol=0.01)
    np.testing.assert_allclose(skeleton.coordinate_limits[HIP], (-0.1, 0.1), atol=1e-6)


def test_a_frame_that_is_wrong_is_left_out() -> None:
    poses = walk()
    poses[3, HIP] = 3.0
    np.testing.assert_allclose(learnt(DOG.skeleton, poses, 0.1).coordinate_limits[HIP], (-0.1, 0.1), atol=1e-6)


def test_the_root_and_what_is_not_searched_keep_their_limits() -> None:
    skeleton = learnt(DOG.skeleton, walk(), 0.1)
    held = np.setdiff1d(np.arange(skeleton.coordinates), DOG.skeleton.searched()[6:])
    np.testing.assert_array_equal(skeleton.coordinate_limits[held], DOG.skeleton.coordinate_limits[held])
    assert skeleton.spread[0] == DOG.skeleton.spread[0]


def test_spreads_are_distances_from_the_zero_pose() -> None:
    spread = learnt(DOG.skeleton, walk(), 0.1).spread
    knee, hip = ((first - 3) // 3 for first in (KNEE, HIP))
    assert spread[knee] == pytest.approx(np.sqrt(np.mean(np.linspace(0.2, 1.0, 1000) ** 2)))
    assert spread[hip] == 0.05  # not zero, of a joint that never moved


def test_the_command_writes_a_body_with_its_motions(tmp_path: Path) -> None:
    slow, fast = walk(), walk()
    fast[:, KNEE] *= -1
    body = replace(DOG, rigid=True)
    write_body(tmp_path / "dog.usdc", body, {"Slow": BodyMotion(30.0, slow), "Fast": BodyMotion(30.0, fast)})
    given = ["body", "learn", str(tmp_path / "dog.usdc"), "-o", str(tmp_path / "learnt.usdc")]
    assert main([*given, "--motion", "Slow", "--margin", "0"]) == 0
    np.testing.assert_allclose(
        read_body(tmp_path / "learnt.usdc").skeleton.coordinate_limits[KNEE], (0.2, 1), atol=0.01
    )
    assert main([*given, "--force"]) == 0
    learnt_body = read_body(tmp_path / "learnt.usdc")
    of_both = learnt_body.skeleton.coordinate_limits[KNEE]
    np.testing.assert_allclose(of_both, (-1 - np.radians(10), 1 + np.radians(10)), atol=0.01)
    assert learnt_body.rigid
    assert set(read_motions(tmp_path / "learnt.usdc")) == {"Slow", "Fast"}


def test_the_command_tells_what_it_cannot_learn_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_body(tmp_path / "dog.usdc", DOG)
    given = ["body", "learn", str(tmp_path / "dog.usdc"), "-o", str(tmp_path / "learnt.usdc")]
    assert main(given) == 3
    assert "has no motions" in capsys.readouterr().err
    assert main([*given, "--motion", "Walk"]) == 3
    assert main([*given, "--margin", "-1"]) == 2
