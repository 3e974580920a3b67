"""URDF robots: what turns or slides is a joint, what is fixed follows; nothing outside the named folder is opened."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from made_up_rigs import ROBOT

from mmocap_warp.errors import InputError
from mmocap_warp.formats.rigged.urdf import read_urdf


def written(tmp_path: Path, text: str = ROBOT) -> Path:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    return path


def test_joints_their_axes_and_limits(tmp_path: Path) -> None:
    read = read_urdf(written(tmp_path))
    assert read.joints == ("base", "slew", "luff", "hoist")
    assert read.parent == (-1, 0, 1, 2)
    assert read.rigid
    assert (read.up, read.facing) == ("+z", "+x")
    np.testing.assert_allclose(read.bind[:, :3, 3], [(0, 0, 0), (0, 0, 0.1), (0, 0, 1.1), (0, 0.75, 1)], atol=1e-6)
    np.testing.assert_allclose(read.axes[1].axis, (0, 0, 1))
    assert (read.axes[1].lower, read.axes[1].upper) == (-np.inf, np.inf)
    np.testing.assert_allclose(read.axes[2].axis, (1, 0, 0), atol=1e-6)
    assert (read.axes[2].lower, read.axes[2].upper) == (-0.2, 1.2)
    np.testing.assert_allclose(read.axes[3].axis, (0, 0, 1))
    assert (read.axes[3].lower, read.axes[3].upper) == (0, 0.5)
    assert [read.axes[joint].slides for joint in (1, 2, 3)] == [False, False, True]


def test_what_slides_in_a_plane_is_held(tmp_path: Path) -> None:
    read = read_urdf(written(tmp_path, ROBOT.replace('"prismatic"', '"planar"')))
    assert read.joints == ("base", "slew", "luff")
    assert read.notes == ("hoist slide in a plane: held at zero",)


def test_what_follows_another_joint_is_told(tmp_path: Path) -> None:
    read = read_urdf(written(tmp_path, ROBOT.replace('<limit lower="0"', '<mimic joint="luff"/><limit lower="0"')))
    assert read.notes == ("hoist follow other joints there: free here",)


def test_links_stand_where_their_joints_put_them(tmp_path: Path) -> None:
    read = read_urdf(written(tmp_path))
    boom = read.vertex[read.influence[:, 0] >= 2]
    np.testing.assert_allclose(boom.min(axis=0), (-0.05, 0.0, 0.9), atol=1e-6)  # the hook hangs below its end
    np.testing.assert_allclose(boom.max(axis=0), (0.05, 0.8, 1.15), atol=1e-6)


def test_a_link_without_a_visual_shows_what_collides(tmp_path: Path) -> None:
    whole = read_urdf(written(tmp_path))
    first, box = ROBOT.index("<visual>"), ROBOT.index("</visual>")
    mixed = ROBOT[:first] + ROBOT[first : box + 9].replace("visual", "collision") + ROBOT[box + 9 :]
    np.testing.assert_array_equal(read_urdf(written(tmp_path, mixed)).vertex, whole.vertex)


def test_meshes_are_found_by_their_last_parts_in_the_named_folder_alone(tmp_path: Path) -> None:
    folder = tmp_path / "robot" / "meshes"
    folder.mkdir(parents=True)
    trimesh.creation.box((0.4, 0.4, 0.2)).export(folder / "base.stl")
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "outside.stl")
    mesh = '<mesh filename="package://somewhere/crane/meshes/base.stl" scale="1 1 2"/>'
    path = written(tmp_path / "robot", ROBOT.replace('<box size="0.4 0.4 0.2"/>', mesh))
    base = read_urdf(path).vertex[read_urdf(path).influence[:, 0] == 0]
    np.testing.assert_allclose(np.ptp(base, axis=0), (0.4, 0.4, 0.4), atol=1e-6)
    for name in ("../outside.stl", f"{tmp_path}/outside.stl", "package://x/../../outside.stl", "absent.stl"):
        path = written(tmp_path / "robot", ROBOT.replace('<box size="0.4 0.4 0.2"/>', f'<mesh filename="{name}"/>'))
        with pytest.raises(InputError, match="which is not in"):
            read_urdf(path)
    (folder / "link.stl").symlink_to(tmp_path / "outside.stl")
    path = written(tmp_path / "robot", ROBOT.replace('<box size="0.4 0.4 0.2"/>', '<mesh filename="meshes/link.stl"/>'))
    with pytest.raises(InputError, match="which is not in"):
        read_urdf(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<!DOCTYPE r [<!ENTITY a "aaaa">]><robot name="x">&a;</robot>', "defines XML entities"),
        ("<robot", "is not XML"),
        ("<house/>", "not <robot>"),
        ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="a"/></robot>', "xacro template"),
        ('<robot name="x"><link name="a"/></robot>', "no joint that turns or slides"),
        (ROBOT.replace('link="boom"', 'link="none"'), "does not exist"),
        (ROBOT.replace('lower="-0.2"', 'lower="9"'), "lower limit above"),
        (ROBOT.replace('"0 -1 0"', '"0 0 0"'), "turns about no axis"),
        (ROBOT.replace('<axis xyz="0 0 1"/><limit', '<axis xyz="0 0 0"/><limit'), "slides along no axis"),
        (ROBOT.replace('<box size="0.4 0.4 0.2"/>', '<box size="nan 1 1"/>'), "not 3 numbers"),
        (ROBOT.replace('<parent link="base"/>', '<parent link="hook"/>'), "loop"),
    ],
)
def test_what_cannot_be_read_is_told_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_urdf(written(tmp_path, text))


def test_an_obj_mesh_is_read_without_its_material(tmp_path: Path) -> None:
    """Faces of four corners, texture indices, numbers from the end; the material file is not looked for."""
    (tmp_path / "part.obj").write_text(
        "mtllib ../../secret.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nusemtl red\n"
        "f 1/1 2/1 3/1 4/1\nf -1//1 1//1 2//1\nf 5 2 3\nf 5 3 4\nf 5 4 1\n"
    )
    text = ROBOT.replace('<box size="0.4 0.4 0.2"/>', '<mesh filename="part.obj" scale="2 2 2"/>')
    read = read_urdf(written(tmp_path, text))
    base = read.influence[:, 0] == 0
    assert base.sum() == 5
    np.testing.assert_array_equal(read.face[:6], [(0, 1, 2), (0, 2, 3), (4, 0, 1), (4, 1, 2), (4, 2, 3), (4, 3, 0)])
    np.testing.assert_allclose(read.vertex[base].max(axis=0), 2)
