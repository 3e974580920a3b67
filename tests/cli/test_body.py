"""``mmocap body import``, ``export`` and ``show``, and ``mmocap synth``: a character's way through the program."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made_up_rigs import MJCF, ROBOT, write_creature

from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.formats.usd.usd_body import read_body, read_motions
from mmocap_warp.scene.scene_toml import load_scene


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict:
    capsys.readouterr()
    assert cli.main([*map(str, arguments), "--json"]) == console.OK
    return json.loads(capsys.readouterr().out)


@pytest.fixture
def creature(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    run(capsys, "body", "import", write_creature(tmp_path / "creature.glb"), "-o", tmp_path / "creature.usdc")
    return tmp_path / "creature.usdc"


def test_import_says_what_was_done(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, body = write_creature(tmp_path / "creature.glb"), tmp_path / "creature.usdc"
    told = run(capsys, "body", "import", source, "-o", body, "--write-joints", tmp_path / "joints.toml")
    assert told["degrees_of_freedom"] == 19
    assert told["motions"] == ["Nod"]
    np.testing.assert_allclose(told["size"], (0.5, 1.59, 0.7), atol=1e-3)
    assert any("armature" in note for note in told["notes"])
    assert read_body(body).attribution == "Made up for tests."
    assert cli.main(["validate", str(body)]) == console.OK
    again = run(capsys, "body", "import", source, "-o", tmp_path / "b.usdc", "--joints", tmp_path / "joints.toml")
    assert again["degrees_of_freedom"] == 19


def test_there_and_back_as_glb_and_usd_all_stays(tmp_path: Path, creature: Path, capsys) -> None:
    run(capsys, "body", "export", creature, "-o", tmp_path / "back.glb")
    run(capsys, "body", "import", tmp_path / "back.glb", "-o", tmp_path / "back.usdc")
    run(capsys, "body", "import", creature, "-o", tmp_path / "usd.usdc")
    body, motions = read_body(creature), read_motions(creature)
    for file in ("back.usdc", "usd.usdc"):
        back = read_body(tmp_path / file)
        assert back.skeleton.joints == body.skeleton.joints
        assert back.skeleton.parent == body.skeleton.parent
        assert back.skeleton.pairs == body.skeleton.pairs
        np.testing.assert_allclose(back.joint_rest, body.joint_rest, atol=1e-6)
        np.testing.assert_allclose(back.skeleton.frame, body.skeleton.frame, atol=1e-5)
        np.testing.assert_array_equal(back.skeleton.searched(), body.skeleton.searched())
        np.testing.assert_allclose(np.sort(back.skin.rest, axis=0), np.sort(body.skin.rest, axis=0), atol=1e-6)
        assert cli.main(["validate", str(tmp_path / file)]) == console.OK
    np.testing.assert_allclose(read_motions(tmp_path / "back.usdc")["Nod"].pose, motions["Nod"].pose, atol=1e-5)
    told = run(capsys, "body", "import", creature, "-o", tmp_path / "again.usdc")
    assert "the new body does not have the motions of the one that was read: Nod" in told["notes"]
    before = creature.read_bytes()
    assert cli.main(["body", "import", str(creature), "-o", str(creature), "--force"]) == console.BAD_INPUT
    assert "is the character that is read, of which a body keeps less; write elsewhere" in capsys.readouterr().err
    assert creature.read_bytes() == before


def test_a_robots_meshes_and_wrong_flags(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = tmp_path / "crane.urdf"
    robot.write_text(ROBOT)
    told = run(capsys, "body", "import", robot, "-o", tmp_path / "crane.usdc")
    assert told["joints"] == ["base", "slew", "luff", "hoist"]
    (tmp_path / "crane.xml").write_text(MJCF)
    same = run(capsys, "body", "import", tmp_path / "crane.xml", "-o", tmp_path / "same.usdc")
    assert {**same, "body": told["body"], "file": told["file"]} == told
    robot.write_text(ROBOT.replace('<box size="0.4 0.4 0.2"/>', '<mesh filename="a.stl"/>'))
    other = str(tmp_path / "other.usdc")
    assert cli.main(["body", "import", str(robot), "-o", other]) == console.BAD_INPUT
    assert "--meshes" in capsys.readouterr().err
    assert cli.main(["body", "import", str(robot), "-o", other, "--character", "Bob"]) == console.USAGE
    assert "a .urdf file takes no --character" in capsys.readouterr().err
    for flags in (["--scale", "0"], ["--scale", "inf"], ["--triangles", "2"], ["--up", "+z", "--facing", "-z"]):
        robot.write_text(ROBOT)
        assert cli.main(["body", "import", str(robot), "-o", other, *flags]) == console.USAGE
    assert cli.main(["body", "import", str(robot), "-o", str(tmp_path / "turned.usdc"), "--facing", "-x"]) == 0
    capsys.readouterr()
    (tmp_path / "third.outline.png").touch()
    assert cli.main(["body", "import", str(robot), "-o", str(tmp_path / "third.usdc")]) == console.BAD_INPUT
    assert "third.outline.png: exists already" in capsys.readouterr().err
    (tmp_path / "a.max").write_bytes(b"")
    assert cli.main(["body", "import", str(tmp_path / "a.max"), "-o", other]) == console.BAD_INPUT
    assert ".glb" in capsys.readouterr().err


def test_show_draws_and_lists_how_joints_turn(tmp_path: Path, creature: Path, capsys) -> None:
    import cv2

    told = run(capsys, "body", "show", creature, "-o", tmp_path / "creature.png")
    assert told["parent"]["foot.L"] == "shin.L"
    assert list(told["limits_deg"]["shin.L"]) == ["x"]
    assert told["limits_deg"]["head end"] == {}
    assert told["motions"] == {"Nod": 31}
    picture = cv2.imread(str(tmp_path / "creature.png"))
    assert picture.shape[0] > 400
    for colour in ((90, 90, 255), (110, 220, 110), (255, 150, 70)):  # axes x, y and z are there
        assert (np.abs(picture.astype(int) - colour).sum(axis=2) < 20).sum() > 50


def test_a_fit_of_a_made_scene_starts_from_the_body_that_was_recorded(tmp_path: Path, creature: Path, capsys) -> None:
    """And not from a person, wherever the scene is moved."""
    scene = run(capsys, "synth", creature, "--cameras", 2, "--size", 64, 48, "-o", tmp_path / "made")["scene"]
    creature.unlink()
    named = load_scene(scene).body
    assert named is not None
    assert read_body(named).skeleton.joints[-1] == "head end"
    assert list(read_motions(named)) == ["Nod"]
