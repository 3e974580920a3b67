"""Robots' joints that slide: which are searched, how a file says it, and their way through other programs' formats."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from least_jerk import through_poses
from made_up_rigs import ROBOT

from mmocap_warp import cli
from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.errors import InputError
from mmocap_warp.formats.rigged.urdf import read_urdf
from mmocap_warp.formats.usd.usd_body import read_body, read_motions, write_body, write_subject
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.rigging.importing.imported import Imported, imported
from mmocap_warp.rigging.importing.joints_file import read_joints_file, write_joints_file
from mmocap_warp.rigging.start_poses import learnt, read_pose
from mmocap_warp.tracking.limb_pairs import limbs, mirrored

GRIPPER = """\
<robot name="arm">
  <link name="base"><visual><geometry><box size="0.4 0.4 0.2"/></geometry></visual></link>
  <link name="upper"><visual><origin xyz="0 0 0.4"/><geometry><box size="0.1 0.1 0.8"/></geometry></visual></link>
  <link name="fore"><visual><origin xyz="0 0 0.3"/><geometry><box size="0.08 0.08 0.6"/></geometry></visual></link>
  <link name="left"><visual><origin xyz="0 0.02 0.05"/>
    <geometry><box size="0.03 0.02 0.1"/></geometry></visual></link>
  <link name="right"><visual><origin xyz="0 -0.02 0.05"/>
    <geometry><box size="0.03 0.02 0.1"/></geometry></visual></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.1"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.8"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="finger_l" type="prismatic"><parent link="fore"/><child link="left"/><origin xyz="0 0.03 0.6"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.05" effort="1" velocity="1"/></joint>
  <joint name="finger_r" type="prismatic"><parent link="fore"/><child link="right"/><origin xyz="0 -0.03 0.6"/>
    <axis xyz="0 -1 0"/><limit lower="0" upper="0.05" effort="1" velocity="1"/></joint>
</robot>
"""
"""An arm of two hinges with a gripper of two fingers, 1.6 m tall."""


GANTRY = """\
<robot name="gantry">
  <link name="base"><visual><origin xyz="0 0 0.5"/><geometry><box size="0.1 1.2 1.0"/></geometry></visual></link>
  <link name="bridge"><visual><origin xyz="0.4 0 0"/><geometry><box size="0.8 0.1 0.1"/></geometry></visual></link>
  <link name="tool"><visual><geometry><box size="0.1 0.2 0.4"/></geometry></visual></link>
  <joint name="across" type="prismatic"><parent link="base"/><child link="bridge"/><origin xyz="0 0 1"/>
    <axis xyz="0 1 0"/><limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint>
  <joint name="along" type="prismatic"><parent link="bridge"/><child link="tool"/><origin xyz="0.4 0 0"/>
    <axis xyz="1 0 0"/><limit lower="-0.3" upper="0.3" effort="1" velocity="1"/></joint>
</robot>
"""
"""A tool that slides along a bridge that slides along a wall."""


def robot(tmp_path: Path, text: str = ROBOT, joints: str | None = None, scale: float = 1.0) -> Imported:
    path, given = tmp_path / "robot.urdf", tmp_path / "given.toml"
    path.write_text(text)
    if joints is not None:
        given.write_text(joints)
    return imported(read_urdf(path), "robot", scale=scale, joints=None if joints is None else read_joints_file(given))


def test_a_slider_is_searched_in_metres_along_its_axis(tmp_path: Path) -> None:
    body = robot(tmp_path).body
    skeleton = body.skeleton
    assert skeleton.sliding == ("hoist",)
    assert [skeleton.coordinate_names[i] for i in skeleton.searched()] == ["slew.Rx", "luff.Rx", "hoist.Tx"]
    joint, coordinate = skeleton.index("hoist"), skeleton.angles("hoist").start
    np.testing.assert_allclose(skeleton.limits[joint, 0], (0, 0.5), atol=1e-6)
    assert skeleton.spread[joint] == pytest.approx(0.5 / np.sqrt(12))
    pose = np.zeros((2, skeleton.coordinates))
    pose[1, coordinate] = 0.3
    place = Poser(body, np.eye(3)).joint_transforms(pose)[:, joint, :3, 3]
    np.testing.assert_allclose(place[1] - place[0], (0, 0.3, 0), atol=1e-6)  # up


def test_a_lift_that_carries_two_arms_is_no_arm(tmp_path: Path) -> None:
    """Its base drives; a crane's, whose one chain begins with a slider, stands."""
    second = ROBOT.replace(
        "</robot>",
        """
      <link name="arm"><visual><origin xyz="-0.4 0 0"/><geometry><box size="0.8 0.1 0.1"/></geometry></visual></link>
      <joint name="other" type="revolute"><parent link="cap"/><child link="arm"/>
        <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>""",
    )
    limit = '<axis xyz="0 0 1"/><limit lower="0" upper="0.4" effort="1" velocity="1"/>'
    for text, searched in ((ROBOT, 3), (second, 10)):
        lift = text.replace('"continuous"', '"prismatic"').replace('<axis xyz="0 0 1"/></joint>', f"{limit}</joint>", 1)
        assert len(robot(tmp_path, lift).body.skeleton.searched()) == searched


def test_travel_grows_with_the_scale(tmp_path: Path) -> None:
    skeleton = robot(tmp_path, scale=0.1).body.skeleton
    np.testing.assert_allclose(skeleton.limits[skeleton.index("hoist"), 0], (0, 0.05), atol=1e-6)
    np.testing.assert_allclose(skeleton.limits[skeleton.index("luff"), 0], (-0.2, 1.2), rtol=1e-6)


@pytest.mark.parametrize("limit", ['<limit lower="0" upper="0.02" effort="1" velocity="1"/>', ""])
def test_what_slides_too_little_or_without_limits_is_held_until_it_is_freed(tmp_path: Path, limit: str) -> None:
    text = ROBOT.replace('<limit lower="0" upper="0.5" effort="1" velocity="1"/>', limit)
    held = robot(tmp_path, text)
    assert len(held.body.skeleton.searched()) == 2
    assert any(note.startswith("hoist slide by too little") for note in held.notes)
    freed = '[joints.hoist]\nfree = "x"\n'
    if limit:
        skeleton = robot(tmp_path, text, freed).body.skeleton
        np.testing.assert_allclose(skeleton.limits[skeleton.index("hoist"), 0], (0, 0.02), atol=1e-6)
    else:
        with pytest.raises(InputError, match="joint 'hoist' slides along x without limits"):
            robot(tmp_path, text, freed)
        skeleton = robot(tmp_path, text, freed + "x = [0, 0.3]\n").body.skeleton
        np.testing.assert_allclose(skeleton.limits[skeleton.index("hoist"), 0], (0, 0.3), atol=1e-6)
    assert len(skeleton.searched()) == 3


def test_a_joints_file_says_what_slides_and_how_far(tmp_path: Path) -> None:
    made = robot(tmp_path)
    path = tmp_path / "joints.toml"
    write_joints_file(path, made.body, made.proposed, made.parents)
    assert '[joints.hoist]  # file\nfree = "x"\nslides = true\nhinge = [0, 1, 0]\nx = [0, 0.5]\n' in path.read_text()
    again = robot(tmp_path, joints=path.read_text()).body.skeleton
    assert again.sliding == ("hoist",)
    np.testing.assert_allclose(again.limits, made.body.skeleton.limits, atol=1e-3)
    other = robot(
        tmp_path,
        joints="[joints.luff]\nslides = true\nhinge = [0, 0, 1]\nx = [-0.1, 0.4]\n[joints.hoist]\nslides = false\n",
    ).body.skeleton
    assert other.sliding == ("luff",)
    np.testing.assert_allclose(other.limits[other.index("luff"), 0], (-0.1, 0.4), atol=1e-6)
    np.testing.assert_allclose(other.limits[other.index("hoist"), 0], (-np.pi / 2, np.pi / 2), rtol=1e-6)
    with pytest.raises(InputError, match="joint 'slew' slides along x without limits"):
        robot(tmp_path, joints="[joints.slew]\nslides = true\n")


def test_a_slider_has_no_bone_that_grows(tmp_path: Path) -> None:
    names = RestSpace(robot(tmp_path, joints="rigid = false\n").body).names
    assert "bone.luff" in names
    assert "bone.hoist" not in names
    assert "girth.hoist" in names


def test_a_grippers_fingers_go_with_the_arm_and_mirror_each_other(tmp_path: Path) -> None:
    body = robot(tmp_path, GRIPPER).body
    skeleton = body.skeleton
    assert skeleton.sliding == ("finger_l", "finger_r")
    assert {skeleton.parts[skeleton.part[skeleton.index(name)]] for name in skeleton.joints[1:]} == {"shoulder"}
    (arm,) = limbs(skeleton)
    assert [skeleton.coordinate_names[i] for i in arm.reach] == ["shoulder.Rx", "elbow.Rx"]
    assert [pair[1:] for pair in skeleton.pairs] == [("finger_l", "finger_r")]
    left, right = (skeleton.angles(name) for name in ("finger_l", "finger_r"))
    pose = np.zeros(skeleton.coordinates)
    pose[left.start], pose[right.start] = 0.04, 0.01
    across = mirrored(skeleton, pose)
    np.testing.assert_allclose((across[left.start], across[right.start]), (0.01, 0.04), atol=1e-7)
    place = Poser(body, np.eye(3)).joint_transforms(np.stack([pose, across]))[:, :, :3, 3]
    image = place[0] * (-1, 1, 1)
    np.testing.assert_allclose(place[1][[skeleton.index("finger_l"), skeleton.index("finger_r")]],
                               image[[skeleton.index("finger_r"), skeleton.index("finger_l")]], atol=1e-6)  # fmt: skip


def test_a_gantry_has_a_step_of_its_own_and_learns_its_travel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    body = robot(tmp_path, GANTRY).body
    skeleton = body.skeleton
    assert [skeleton.coordinate_names[i] for i in skeleton.searched()] == ["across.Tx", "along.Tx"]
    assert (skeleton.parts, skeleton.part) == (("base", "across"), (0, 1, 1))
    motion = through_poses(skeleton, ((0.0, {"across.Tx": -0.3}), (0.5, {"across.Tx": 0.3, "along.Tx": 0.2})), 30.0)
    write_body(tmp_path / "gantry.usdc", body, {"Cross": motion})
    capsys.readouterr()
    learn = ["body", "learn", str(tmp_path / "gantry.usdc"), "-o", str(tmp_path / "learnt.usdc"), "--json"]
    assert cli.main(learn) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["before_m"] == pytest.approx(0.8)
    assert told["mean_range_m"] == pytest.approx(1.2 * (0.6 + 0.2) / 2, rel=0.01)
    assert "mean_range_deg" not in told


def test_a_motion_that_slides_goes_through_glb_and_usd_and_back(tmp_path: Path) -> None:
    """A GLB file knows neither hinges nor joints that slide; the joints file tells them."""
    made = robot(tmp_path)
    keys = ((0.0, {"slew.Rx": 10, "hoist.Tx": 0.1}), (0.5, {"luff.Rx": 40, "hoist.Tx": 0.4}))
    motion = through_poses(made.body.skeleton, keys, 60.0)
    file, back, joints = (tmp_path / name for name in ("crane.usdc", "back.usdc", "joints.toml"))
    write_body(file, made.body, {"Hoist": motion})
    write_joints_file(joints, made.body, made.proposed, made.parents)
    hinges = {"slew": "[0, 1, 0]", "luff": "[0, 0, 1]"}
    text = joints.read_text()
    for name, axis in hinges.items():
        text = text.replace(f"[joints.{name}]  # file", f"[joints.{name}]\nhinge = {axis}")
    joints.write_text(text)
    assert read_body(file).skeleton.sliding == ("hoist",)
    np.testing.assert_allclose(read_motions(file)["Hoist"].pose, motion.pose, atol=1e-6)
    exported = tmp_path / "crane.glb"
    assert cli.main(["body", "export", str(file), "-o", str(exported)]) == 0
    assert cli.main(["body", "import", str(exported), "-o", str(back), "--joints", str(joints)]) == 0
    skeleton, again = read_body(back).skeleton, read_motions(back)["Hoist"].pose
    assert skeleton.sliding == ("hoist",)
    searched = skeleton.searched()
    np.testing.assert_array_equal(searched, made.body.skeleton.searched())
    np.testing.assert_allclose(again[:, searched], motion.pose[: len(again), searched], atol=1e-5)


def test_a_joint_that_slides_may_have_any_name(tmp_path: Path) -> None:
    body = robot(tmp_path, ROBOT.replace('"hoist"', '"the hoist.z"')).body
    pose = np.zeros(body.skeleton.coordinates)
    pose[body.skeleton.angles("the hoist.z").start] = 0.4
    write_subject(tmp_path / "slid.usdc", Subject(body, np.eye(3), pose, {}))
    assert faults(tmp_path / "slid.usdc") == []


def test_travel_is_learnt_within_the_hardwares(tmp_path: Path) -> None:
    skeleton = robot(tmp_path).body.skeleton
    joint, coordinate = skeleton.index("hoist"), skeleton.angles("hoist").start
    poses = np.zeros((1000, skeleton.coordinates))
    poses[:, coordinate] = np.linspace(0.0, 0.2, 1000)
    seen = learnt(skeleton, poses, 0.1)
    np.testing.assert_allclose(seen.limits[joint, 0], (0, 0.22), atol=0.002)
    assert seen.spread[joint] == pytest.approx(np.sqrt(np.mean(poses[:, coordinate] ** 2)))


def test_a_start_pose_names_shifts_in_metres(tmp_path: Path) -> None:
    skeleton, path = robot(tmp_path).body.skeleton, tmp_path / "start.toml"
    path.write_text("luff.Rx = 40\nhoist.Tx = 0.2\n")
    pose = read_pose(path, skeleton)
    np.testing.assert_allclose(
        pose[[skeleton.angles("luff").start, skeleton.angles("hoist").start]], (np.radians(40), 0.2)
    )
    path.write_text("hoist.Rx = 20\n")
    with pytest.raises(InputError, match="Rx"):
        read_pose(path, skeleton)


def test_show_tells_travel_in_metres(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_body(tmp_path / "crane.usdc", robot(tmp_path).body)
    show = ["body", "show", str(tmp_path / "crane.usdc"), "-o", str(tmp_path / "crane.png"), "--force"]
    assert cli.main(show) == 0
    assert "hoist  slides x 0 to 0.5 m" in capsys.readouterr().out
    assert cli.main([*show, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["limits_m"]["hoist"]["x"] == pytest.approx((0, 0.5))
    assert "hoist" not in told["limits_deg"]
