"""A scene with things attached, as a user tracks it: with a subject that was fitted without them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from other_bodies import burdened, quadruped, things

from mmocap_warp import cli
from mmocap_warp.body.model import BodyMotion, Subject
from mmocap_warp.cli import console
from mmocap_warp.formats.attachments import attachment_lines
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.synthesis.any_body import recorded, write_recorded
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.footage.made_recording import Recording

FRAMES = 6


def moving() -> Recording:
    """The dog steps ahead, shakes what is in its mouth and shoves the block aside; the wheel turns."""
    body, time = burdened(), np.linspace(0, 1, FRAMES)
    skeleton = body.skeleton
    pose = np.zeros((FRAMES, skeleton.coordinates))
    pose[:, :3] = body.joint_rest[0] + 0.1 * time[:, None] * (0, 0, 1)
    pose[:, skeleton.angles("Head").start] = 0.3 * np.sin(4 * time)
    pose[:, skeleton.angles("Wheel").start + 2] = 0.5 * time
    pose[:, skeleton.angles("Block_place")] = time[:, None] * (0.15, 0.05, -0.1)
    pose[:, skeleton.angles("Block")] = time[:, None] * (0.1, -0.3, 0.5)
    return recorded(body, BodyMotion(30.0, pose), 5, size=(320, 240), faulty=False)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    recording = moving()
    folder = write_recorded(tmp_path / "dog", recording, faulty=False).parent
    plain = quadruped()
    start = recording.poses[0, : plain.skeleton.coordinates]
    write_subject(folder / "subject.usdc", Subject(plain, recording.root_base, start, {}))
    with things() as carried:
        lines = attachment_lines(carried, folder)
        for thing in carried:
            (folder / thing.mesh.name).write_bytes(thing.mesh.read_bytes())
            lines = [f'mesh = "{thing.mesh.name}"' if thing.mesh.name in line else line for line in lines]
    with (folder / "scene.toml").open("a") as file:
        file.write("\n".join([*lines, ""]))
    return folder


def tracked(scene: Path, output: Path, capsys: pytest.CaptureFixture[str], code: int = console.OK) -> dict:
    capsys.readouterr()
    flags = ["--device", "cpu", "--json"]
    assert cli.main(["track", str(scene), "-o", str(output), *flags]) == code
    return json.loads(capsys.readouterr().out)


def test_a_dog_with_a_stick_a_wheel_and_a_block(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = tracked(scene, tmp_path / "result.usdc", capsys)
    result, truth = read_result(tmp_path / "result.usdc"), moving()
    skeleton = result.subject.body.skeleton
    assert skeleton.attached == burdened().skeleton.attached
    assert told["config"]["dof"] == 19
    assert not faults(tmp_path / "result.usdc")
    assert set(told["median_mm_by_attached"]) == {"Stick", "Wheel", "Block"}
    assert max(told["median_mm_by_attached"].values()) < 8
    mine, theirs = (
        ExactPoser(result.subject.body, truth.root_base).joint_transforms(poses)[:, skeleton.index("Block"), :3, :3]
        for poses in (result.pose[0], truth.poses)
    )
    cosine = (np.trace(np.swapaxes(mine, 1, 2) @ theirs, axis1=1, axis2=2) - 1) / 2
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 6

    wheel = skeleton.angles("Wheel").start + 2
    assert np.degrees(np.abs(result.pose[0, :, wheel] - truth.poses[:, wheel])).max() < 6

    text = (scene / "scene.toml").read_text()
    (scene / "scene.toml").write_text(text[: text.index("[[attach]]")])
    # In so few frames a stick that the body lacks is not told from a limb that was lost.
    without = tracked(scene, tmp_path / "without.usdc", capsys, console.CHECK_FAILED)
    assert told["mpjpe_mm"] < without["mpjpe_mm"]
    assert told["mean_iou"] > without["mean_iou"] + 0.05


def test_what_cannot_be_attached_names_the_table(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (scene / "scene.toml").read_text()
    (scene / "scene.toml").write_text(text.replace('joint = "Head"', 'joint = "Nose"'))
    assert cli.main(["track", str(scene), "-o", str(tmp_path / "result.usdc")]) == console.BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()[-1:]
    assert "scene.toml: [attach 1]: 'Stick': the body has no joint 'Nose'" in line
