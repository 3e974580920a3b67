"""Files of other programs' characters and robots, made up: a glTF creature, and a robot of boxes in URDF and MJCF."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from glb_file import Glb

_BOX = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_TRIANGLES = np.array(
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ]
)

JOINTS = {  # name: parent, place
    "armature": (None, (0.0, 0.0, 0.0)),
    "hips": ("armature", (0.0, 1.0, 0.0)),
    "leg.L": ("hips", (0.2, 0.9, 0.0)),
    "shin.L": ("leg.L", (0.2, 0.5, 0.2)),
    "foot.L": ("shin.L", (0.2, 0.1, 0.0)),
    "leg.R": ("hips", (-0.2, 0.9, 0.0)),
    "shin.R": ("leg.R", (-0.2, 0.5, 0.2)),
    "foot.R": ("shin.R", (-0.2, 0.1, 0.0)),
    "head": ("hips", (0.0, 1.4, 0.3)),
    "head end": ("head", (0.0, 1.6, 0.3)),
}
_BOXES = {  # which joint a box follows: its middle and half its size
    "hips": ((0.0, 1.0, 0.0), (0.2, 0.15, 0.2)),
    "leg.L": ((0.2, 0.7, 0.1), (0.05, 0.15, 0.05)),
    "shin.L": ((0.2, 0.3, 0.1), (0.04, 0.15, 0.04)),
    "foot.L": ((0.2, 0.05, 0.1), (0.04, 0.04, 0.1)),
    "leg.R": ((-0.2, 0.7, 0.1), (0.05, 0.15, 0.05)),
    "shin.R": ((-0.2, 0.3, 0.1), (0.04, 0.15, 0.04)),
    "foot.R": ((-0.2, 0.05, 0.1), (0.04, 0.04, 0.1)),
    "head": ((0.0, 1.5, 0.35), (0.1, 0.1, 0.15)),
}


def creature_mesh() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Vertices that no two triangles share, triangles, and six influences of each vertex with their weights."""
    names = list(JOINTS)
    vertex, joint = [], []
    for name, (middle, half) in _BOXES.items():
        box = np.add(middle, _BOX * half)[_TRIANGLES].reshape(-1, 3)
        vertex.append(box)
        joint += [names.index(name)] * len(box)
    influence = np.zeros((len(joint), 6), int)
    influence[:, 0] = joint
    influence[:, 1:] = [1, 2, 5, 8, 3]
    weight = np.tile([0.9, 0.04, 0.03, 0.02, 0.007, 0.003], (len(joint), 1))
    vertices = np.concatenate(vertex)
    return vertices, np.arange(len(vertices)).reshape(-1, 3), influence, weight


def write_creature(path: Path, scale: float = 1.0, **changes: Any) -> Path:
    """A creature on two legs as ``.glb``: six influences, a nod of the head as animation; top-level keys may change."""
    names, places = list(JOINTS), np.array([place for _, place in JOINTS.values()]) * scale
    parents = [None if above is None else names.index(above) for above, _ in JOINTS.values()]
    vertex, _, influence, weight = creature_mesh()
    data, views, accessors = bytearray(), [], []

    def add(values: np.ndarray, kind: str, component: int) -> int:
        data.extend(b"\0" * (-len(data) % 4))
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind})
        data.extend(values.tobytes())
        return len(accessors) - 1

    bind = np.tile(np.eye(4), (len(names), 1, 1))
    bind[:, :3, 3] = places
    half = np.radians(15.0)
    nod = np.array([[0, 0, 0, 1], [np.sin(half), 0, 0, np.cos(half)]], np.float32)
    attributes = {
        "POSITION": add((vertex * scale).astype(np.float32), "VEC3", 5126),
        "JOINTS_0": add(influence[:, :4].astype(np.uint8), "VEC4", 5121),
        "JOINTS_1": add(np.pad(influence[:, 4:], ((0, 0), (0, 2))).astype(np.uint8), "VEC4", 5121),
        "WEIGHTS_0": add(weight[:, :4].astype(np.float32), "VEC4", 5126),
        "WEIGHTS_1": add(np.pad(weight[:, 4:], ((0, 0), (0, 2))).astype(np.float32), "VEC4", 5126),
    }
    inverse = add(np.linalg.inv(bind).transpose(0, 2, 1).reshape(-1, 16).astype(np.float32), "MAT4", 5126)
    time, turn = add(np.array([[0], [0.5]], np.float32), "SCALAR", 5126), add(nod, "VEC4", 5126)
    nodes: list[dict[str, Any]] = []
    for joint, name in enumerate(names):
        above = parents[joint]
        offset = places[joint] - (0 if above is None else places[above])
        children = [child for child, parent in enumerate(parents) if parent == joint]
        nodes.append({"name": name, "translation": offset.tolist()} | ({"children": children} if children else {}))
    document = {
        "asset": {"version": "2.0", "copyright": "Made up for tests."},
        "nodes": [*nodes, {"name": "Creature", "mesh": 0, "skin": 0}],
        "scenes": [{"nodes": [0, len(nodes)]}],
        "meshes": [{"primitives": [{"attributes": attributes}]}],
        "skins": [{"joints": list(range(len(names))), "inverseBindMatrices": inverse}],
        "animations": [
            {
                "name": "Nod",
                "samplers": [{"input": time, "output": turn}],
                "channels": [{"sampler": 0, "target": {"node": names.index("head"), "path": "rotation"}}],
            }
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    } | changes
    return _write_glb(path, document, bytes(data))


def _write_glb(path: Path, document: dict[str, Any], data: bytes) -> Path:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary = data + b"\0" * (-len(data) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks)
    return path


def rewritten(file: Path, change: Callable[[Glb], bytes]) -> Path:
    """A ``.glb`` whose JSON was changed in place, with the binary chunk that the change returns."""
    read = Glb(file)
    return _write_glb(file, read.json, change(read))


ROBOT = """\
<robot name="crane">
  <link name="base"><visual><geometry><box size="0.4 0.4 0.2"/></geometry></visual></link>
  <link name="column"><visual><origin xyz="0 0 0.5"/>
    <geometry><cylinder radius="0.1" length="1"/></geometry></visual></link>
  <link name="cap"><visual><geometry><sphere radius="0.12"/></geometry></visual></link>
  <link name="boom"><visual><origin xyz="0.4 0 0"/><geometry><box size="0.8 0.1 0.1"/></geometry></visual></link>
  <link name="hook"><visual><geometry><box size="0.05 0.05 0.2"/></geometry></visual></link>
  <joint name="slew" type="continuous">
    <parent link="base"/><child link="column"/><origin xyz="0 0 0.1"/><axis xyz="0 0 1"/></joint>
  <joint name="top" type="fixed"><parent link="column"/><child link="cap"/><origin xyz="0 0 1"/></joint>
  <joint name="luff" type="revolute"><parent link="cap"/><child link="boom"/><origin rpy="0 0 1.5707963"/>
    <axis xyz="0 -1 0"/><limit lower="-0.2" upper="1.2" effort="1" velocity="1"/></joint>
  <joint name="hoist" type="prismatic"><parent link="boom"/><child link="hook"/><origin xyz="0.75 0 -0.1"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="0.5" effort="1" velocity="1"/></joint>
</robot>
"""
"""A crane of two hinges, the second about world +X at zero; its boom points along +Y, its hook slides upward."""

MJCF = """\
<mujoco model="crane">
  <compiler angle="radian"/>
  <default><geom group="2"/><joint limited="true"/></default>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body name="base">
      <geom type="box" size="0.2 0.2 0.1"/>
      <body name="column" pos="0 0 0.1">
        <joint name="slew" limited="false"/>
        <geom type="cylinder" size="0.1 0.5" pos="0 0 0.5"/>
        <geom type="sphere" size="0.12" pos="0 0 1"/>
        <body name="boom" pos="0 0 1" euler="0 0 1.5707963">
          <joint name="luff" axis="0 -1 0" range="-0.2 1.2"/>
          <geom type="box" size="0.4 0.05 0.05" pos="0.4 0 0"/>
          <body name="hook" pos="0.75 0 -0.1">
            <joint name="hoist" type="slide" range="0 0.5"/>
            <geom type="box" size="0.025 0.025 0.1"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""The same crane, as MuJoCo has it."""
