"""MJCF robots: the same as in URDF, posed as MuJoCo poses them; MuJoCo itself opens no file, and writes no log."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from made_up_rigs import MJCF, ROBOT
from scipy.spatial.transform import Rotation

from mmocap_warp.errors import InputError
from mmocap_warp.formats.rigged.mjcf import read_mjcf
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh, skinned
from mmocap_warp.formats.rigged.urdf import read_urdf
from mmocap_warp.rigging.importing.imported import imported

MANY_JOINTS = """\
<mujoco>
  <compiler angle="degree"/>
  <worldbody>
    <body name="trunk" pos="1 2 3" euler="10 20 30">
      <freejoint/>
      <geom type="capsule" size="0.1 0.3"/>
      <body pos="0.2 0 0" euler="0 40 0">
        <joint name="swing" pos="0 0.1 0" axis="1 2 0" ref="15" range="-20 70"/>
        <joint name="lift" type="slide" axis="0 1 1" ref="0.1" range="0 0.5"/>
        <joint axis="0 0 1"/>
        <geom type="ellipsoid" size="0.1 0.2 0.3"/>
        <body name="fixed" pos="0 0 0.5">
          <geom type="box" size="0.1 0.2 0.3" quat="1 1 0 0"/>
          <body name="hand" pos="0 0.3 0"><joint name="wrist" type="ball"/><geom type="cylinder" size="0.1 0.2"/></body>
        </body>
      </body>
    </body>
    <body name="cube"><freejoint/><geom type="box" size="1 1 1"/></body>
  </worldbody>
</mujoco>
"""
"""Three joints in one body, the first two with a reference, and a ball; a cube that is no robot lies beside it."""

MASS = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'


def written(folder: Path, text: str = MJCF) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / "robot.xml"
    path.write_text(text)
    return path


def turned(read: RiggedMesh, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """(joint, 4, 4) of a mesh with its joints turned or slid at random by their axes, and MuJoCo's coordinates."""
    world, moved = np.zeros((len(read.joints), 4, 4)), {}
    for joint, (name, parent) in enumerate(zip(read.joints, read.parent, strict=True)):
        own, at = np.eye(4), read.bind[joint, :3, 3]
        if joint in read.axes and read.axes[joint].slides:
            moved[name] = rng.uniform(-1, 1, 1)
            own[:3, 3] = moved[name] * read.axes[joint].axis
        elif joint:
            turn = Rotation.from_rotvec(rng.normal(size=3))
            moved[name] = turn.as_quat(scalar_first=True)
            own[:3, :3] = read.bind[joint, :3, :3] @ turn.as_matrix() @ read.bind[joint, :3, :3].T
            if joint in read.axes:
                moved[name] = rng.uniform(-3, 3, 1)
                own[:3, :3] = Rotation.from_rotvec(moved[name] * read.axes[joint].axis).as_matrix()
            own[:3, 3] = at - own[:3, :3] @ at
        world[joint] = own if parent < 0 else world[parent] @ own
    return world @ read.bind, moved


def test_a_robot_is_the_same_in_both_formats(tmp_path: Path) -> None:
    (tmp_path / "crane.urdf").write_text(ROBOT)
    read, same = read_mjcf(written(tmp_path)), read_urdf(tmp_path / "crane.urdf")
    for field in ("name", "joints", "parent", "up", "facing", "rigid", "metres", "notes"):
        assert getattr(read, field) == getattr(same, field)
    for field in ("bind", "vertex", "influence", "weight"):
        np.testing.assert_allclose(getattr(read, field), getattr(same, field), atol=1e-6)
    np.testing.assert_array_equal(read.face, same.face)
    for joint, axis in same.axes.items():
        np.testing.assert_allclose(read.axes[joint].axis, axis.axis, atol=1e-6)
        assert (read.axes[joint].lower, read.axes[joint].upper) == pytest.approx((axis.lower, axis.upper))
        assert read.axes[joint].slides == axis.slides
    assert not read.roams


def test_a_ball_joint_turns_about_three_axes_as_far_as_its_file_says(tmp_path: Path) -> None:
    limited = MANY_JOINTS.replace('name="wrist" type="ball"', 'name="wrist" type="ball" range="0 60"')
    for text, most in ((limited, (60, 60, 60)), (MANY_JOINTS, (180, 85, 180))):
        freedom = imported(read_mjcf(written(tmp_path, text)), "robot").freedom[4]
        assert (freedom.free, freedom.origin) == ("xyz", "file")
        np.testing.assert_allclose(np.degrees(freedom.limits), np.multiply.outer(most, (-1, 1)))


def test_more_ball_joints_than_can_be_searched_are_held_as_others_are(tmp_path: Path) -> None:
    ends = "</body>" * 34
    chain = "".join(
        f'<body pos="0.1 0 0"><joint type="ball" name="j{j}"/><geom type="sphere" size="0.05"/>' for j in range(34)
    )
    text = f'<mujoco><worldbody><body name="b"><freejoint/><geom type="sphere" size="0.1"/>{chain}{ends}'
    made = imported(read_mjcf(written(tmp_path, text + "</body></worldbody></mujoco>")), "robot")
    assert len(made.body.skeleton.searched()) <= 100
    assert any("as at most 100 coordinates are searched" in note for note in made.notes)


def test_joints_move_as_those_of_mujoco(tmp_path: Path) -> None:
    read, rng = read_mjcf(written(tmp_path, MANY_JOINTS)), np.random.default_rng(0)
    assert read.joints == ("trunk", "swing", "lift", "joint", "wrist")
    assert read.parent == (-1, 0, 1, 2, 3)
    assert read.roams
    assert [joint for joint, how in read.axes.items() if not how.ball] == [1, 2, 3]
    assert read.axes[4].ball
    assert np.degrees((read.axes[1].lower, read.axes[1].upper)) == pytest.approx((-35, 55))
    assert (read.axes[2].lower, read.axes[2].upper) == pytest.approx((-0.1, 0.4))
    model = mujoco.MjModel.from_xml_string(MANY_JOINTS.replace('<joint axis="0 0 1"/>', '<joint name="joint"/>'))
    data = mujoco.MjData(model)
    for _ in range(5):
        world, moved = turned(read, rng)
        mujoco.mj_resetData(model, data)
        for name, value in moved.items():
            data.joint(name).qpos[:] = value if len(value) == 4 else data.joint(name).qpos + value
        mujoco.mj_kinematics(model, data)
        # Each geometry's middle is the mean of its vertices, which are all alike about it.
        vertex = skinned(read, world)
        sizes = [len(np.unique(read.face[part])) for part in np.split(np.arange(len(read.face)), _part_ends(read))]
        middles = [part.mean(axis=0) for part in np.split(vertex, np.cumsum(sizes)[:-1])]
        np.testing.assert_allclose(middles, data.geom_xpos[:4], atol=1e-9)


def _part_ends(read: RiggedMesh) -> list[int]:
    """Where faces of the next part begin: its vertices have higher numbers than all before."""
    low, high = read.face.min(axis=1), np.maximum.accumulate(read.face.max(axis=1))
    return [i for i in range(1, len(low)) if low[i:].min() > high[i - 1]]


def test_shown_meshes_stand_for_the_shapes_that_collide(tmp_path: Path) -> None:
    (tmp_path / "meshes" / "sub").mkdir(parents=True)
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "meshes" / "sub" / "big.stl")
    more = '<compiler meshdir="meshes"/><asset><mesh file="sub/big.stl" scale="-1 1 1"/></asset><worldbody>'
    shown = '<geom type="mesh" mesh="big" contype="0" conaffinity="0"/><geom type="sphere" size="9" group="3"/>'
    text = MJCF.replace("<worldbody>", more).replace('<body name="hook"', f'{shown}<body name="hook"')
    read = read_mjcf(written(tmp_path, text))
    boom = read.vertex[read.influence[:, 0] == 2]
    np.testing.assert_allclose(np.ptp(boom, axis=0), (2, 1, 3), atol=1e-6)  # it is turned by a quarter
    corners = read.vertex[read.face[read.influence[read.face[:, 0], 0] == 2]] - boom.mean(axis=0)
    assert np.linalg.det(corners).sum() / 6 == pytest.approx(6)  # and its triangles face outwards


def test_included_files_are_read_where_they_are_named(tmp_path: Path) -> None:
    body = MJCF[MJCF.index('<body name="base">') : MJCF.index("</worldbody>")]
    written(tmp_path, MJCF.replace(body, '<include file="parts/base.xml"/>'))
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "base.xml").write_text(f"<mujocoinclude>{body}</mujocoinclude>")
    assert read_mjcf(tmp_path / "robot.xml").joints == ("base", "slew", "luff", "hoist")


def test_several_robots_are_characters_and_a_base_with_wheels_roams(tmp_path: Path) -> None:
    path = written(
        tmp_path, MANY_JOINTS.replace("<worldbody>", MJCF[MJCF.index("<worldbody>") : MJCF.index("</worldbody>")])
    )
    with pytest.raises(InputError, match=r"2 characters; choose one with --character: base, trunk"):
        read_mjcf(path)
    assert read_mjcf(path, character="trunk").joints[1] == "swing"
    wheels = '<body name="base"><joint type="slide" axis="1 0 0" limited="false"/><joint limited="false"/>'
    read = read_mjcf(written(tmp_path, MJCF.replace('<body name="base">', wheels)))
    assert read.joints == ("base", "slew", "luff", "hoist")
    assert imported(read, "x").freedom[0].free == "xyz"


def test_what_follows_another_joint_is_told(tmp_path: Path) -> None:
    tied = '<equality><joint joint1="hoist" joint2="luff"/></equality></mujoco>'
    assert read_mjcf(written(tmp_path, MJCF.replace("</mujoco>", tied))).notes == (
        "hoist follow other joints there: free here",
    )


def test_no_file_elsewhere_is_opened_and_none_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "outside.stl")
    (tmp_path / "outside.xml").write_text("<mujoco/>")
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    for name in ("../outside", str(tmp_path / "outside")):
        named = {
            f'<include file="{name}.xml"/><worldbody>': "which is not in",
            f'<asset><mesh name="a" file="{name}.stl"/></asset><worldbody>': "which is not in",
            f'<compiler meshdir="{Path(name).parent}"/><asset><mesh file="outside.stl"/></asset><worldbody>': "not in",
            f'<asset><model name="m" file="{name}.xml"/></asset><worldbody><attach model="m"/>': "makes bodies by",
        }
        for text, said in named.items():
            with pytest.raises(InputError, match=said):
                read_mjcf(written(tmp_path / "robot", MJCF.replace("<worldbody>", text)))
    # What is not needed is not looked for: textures, height fields, skins, plugins.
    more = '<asset><texture type="2d" file="/x.png"/><hfield name="h" file="/x.png" size="1 1 1 1"/></asset><worldbody>'
    more += '<geom type="hfield" hfield="h"/><geom size="nan" material="none"/>'
    with pytest.raises(InputError, match="nan size in geom"):  # of which MuJoCo would write a line into its log
        read_mjcf(written(tmp_path / "robot", MJCF.replace("<worldbody>", more)))
    assert not list((tmp_path / "work").iterdir())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<!DOCTYPE r [<!ENTITY a "aaaa">]><mujoco>&a;</mujoco>', "defines XML entities"),
        ("<mujoco", "is not XML"),
        ("<robot/>", "not <mujoco>"),
        ("<mujoco/>", "no joint that turns or slides"),
        (MJCF.replace("box", "ball"), "is damaged, or no MJCF .*invalid keyword"),
        (MJCF.replace("<worldbody>", '<include file="robot.xml"/><worldbody>'), "is included twice"),
        (MJCF.replace("<worldbody>", '<worldbody><replicate count="9"/>'), "makes bodies by <replicate>"),
        (MJCF.replace("<worldbody>", '<asset><mesh file="robot.xml"/></asset><worldbody>'), "kind that is not read"),
        (re.sub(r"(<body [^>]*>)", rf"\1{MASS}", MJCF).replace("geom type", "site type"), "has no geometry"),
    ],
)
def test_what_cannot_be_read_is_told_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as raised:
        read_mjcf(written(tmp_path, text))
    assert "\n" not in str(raised.value)


def test_without_mujoco_the_remedy_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"needs the package mujoco-core.*pip install \"mmocap-warp\[robots\]\""):
        read_mjcf(written(tmp_path))
