"""Readers of characters, robots and how their joints turn."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import mutations
from reader import LINES, Reader


def _write_creature(folder: Path) -> None:
    from made_up_rigs import write_creature

    write_creature(folder / "x.glb")


def _write_loose_creature(folder: Path) -> None:
    """The same as text, with its numbers beside it."""
    import json

    _write_creature(folder)
    data = (folder / "x.glb").read_bytes()
    size = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + size])
    document["buffers"][0]["uri"] = "x.bin"
    (folder / "x.gltf").write_text(json.dumps(document))
    (folder / "x.bin").write_bytes(data[28 + size :])


def _write_robot(folder: Path) -> None:
    import trimesh
    from made_up_rigs import ROBOT

    box = trimesh.creation.box((0.4, 0.4, 0.2))
    (folder / "a.stl").write_bytes(box.export(file_type="stl"))
    (folder / "b.obj").write_text(box.export(file_type="obj"))
    text = ROBOT.replace('<box size="0.4 0.4 0.2"/>', '<mesh filename="a.stl"/>')
    (folder / "x.urdf").write_text(text.replace('<box size="0.8 0.1 0.1"/>', '<mesh filename="b.obj"/>'))


def _write_mjcf(folder: Path) -> None:
    import trimesh
    from made_up_rigs import MJCF

    (folder / "a.stl").write_bytes(trimesh.creation.box((0.4, 0.4, 0.2)).export(file_type="stl"))
    (folder / "b.obj").write_text(trimesh.creation.icosphere(1).export(file_type="obj"))
    meshes = '<asset><mesh file="a.stl"/><mesh file="b.obj" scale="1 -1 0.1"/></asset><worldbody>'
    text = MJCF.replace("<worldbody>", meshes).replace('type="box" size="0.2 0.2 0.1"', 'type="mesh" mesh="a"')
    (folder / "x.xml").write_text(text.replace('type="box" size="0.4 0.05 0.05"', 'type="mesh" mesh="b"'))


def _write_joints(folder: Path) -> None:
    (folder / "joints.toml").write_text(
        'root = "fixed"\n[joints.head]\nfree = "xy"\nhinge = [0, 1, 0.5]\nx = [-70, 70.5]\n'
        '[joints."foot.L"]\nfree = ""\nparent = "hips"\n'
    )


def _import(folder: Path, name: str) -> None:
    """As the command does, to the body, which has to be one that can be written."""
    from mmocap_warp.errors import InputError
    from mmocap_warp.formats.rigged.gltf import read_gltf
    from mmocap_warp.formats.rigged.mjcf import read_mjcf
    from mmocap_warp.formats.rigged.urdf import read_urdf
    from mmocap_warp.rigging.importing.imported import imported
    from mmocap_warp.rigging.importing.joints_file import read_joints_file

    read = {".urdf": read_urdf, ".xml": read_mjcf}.get(Path(name).suffix, read_gltf)
    joints = read_joints_file(folder / "joints.toml") if (folder / "joints.toml").exists() else None
    try:
        imported(read(folder / name), "x", joints=joints)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(folder / name, str(error), "as the command says") from None


def _write_creature_with_joints(folder: Path) -> None:
    _write_creature(folder)
    _write_joints(folder)


READERS: tuple[Reader, ...] = (
    Reader("creature.glb", "x.glb", _write_creature, partial(_import, name="x.glb"), mutations.any_bytes),
    Reader("creature.gltf", "x.gltf", _write_loose_creature, partial(_import, name="x.gltf"), mutations.json_text),
    Reader("robot.urdf", "x.urdf", _write_robot, partial(_import, name="x.urdf"), LINES),
    Reader("robot.stl", "a.stl", _write_robot, partial(_import, name="x.urdf"), mutations.any_bytes),
    Reader("robot.obj", "b.obj", _write_robot, partial(_import, name="x.urdf"), LINES),
    Reader("robot.xml", "x.xml", _write_mjcf, partial(_import, name="x.xml"), LINES),
    Reader("mjcf.stl", "a.stl", _write_mjcf, partial(_import, name="x.xml"), mutations.any_bytes),
    Reader("mjcf.obj", "b.obj", _write_mjcf, partial(_import, name="x.xml"), LINES),
    Reader("joints.toml", "joints.toml", _write_creature_with_joints, partial(_import, name="x.glb"), LINES),
)
