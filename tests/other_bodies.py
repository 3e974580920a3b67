"""Bodies that are no people: a skinned quadruped and a rigid six-axis arm, boxes from a few lines each.

And a quadruped that carries things: a stick in its mouth, a wheel at its side, a block that lies before it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from mmocap_warp.body.model import BodyModel, SkinMesh
from mmocap_warp.body.skeleton import Skeleton, coordinate_names
from mmocap_warp.formats.attachments import Attachment
from mmocap_warp.rigging.attaching import carrying

_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_FACES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])


def _box_body(name: str, skeleton: Skeleton, rest: np.ndarray, boxes: list[tuple[int, tuple, tuple]]) -> BodyModel:
    """A box for each (joint, centre, half size) that follows its joint alone; all corners are markers."""
    vertex = np.concatenate([centre + _CORNERS * half for _, centre, half in boxes]).astype(np.float32)
    quads = np.concatenate([_FACES + 8 * i for i in range(len(boxes))]).astype(np.int32)
    joint = np.zeros((len(vertex), 4), np.int32)
    joint[:, 0] = np.repeat([j for j, _, _ in boxes], 8)
    weight = np.tile(np.array([1, 0, 0, 0], np.float32), (len(vertex), 1))
    return BodyModel(
        name=name,
        skeleton=skeleton,
        joint_rest=rest.astype(np.float32),
        skin=SkinMesh(vertex, quads, joint, weight),
        tracking_vertex=np.arange(len(vertex), dtype=np.int32),
        tracking_face=np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]),
        shape_names=(),
        shape_vertex=np.zeros((0, len(vertex), 3), np.float32),
        shape_joint=np.zeros((0, len(rest), 3), np.float32),
        marker_names=tuple(f"corner{i}" for i in range(0, len(vertex), 5)),
        marker_vertex=np.arange(0, len(vertex), 5, dtype=np.int32),
        attribution="Made up for tests.",
    )


def _skeleton(tree: dict[str, tuple[str | None, str]], parts: dict[str, tuple[str, ...]], **more) -> Skeleton:
    """From (parent, searched axes) by joint, and the joints of each part."""
    joints = tuple(tree)
    names = coordinate_names(joints)
    place = [0, 1, 2] if tree[joints[0]][1] else []  # who cannot turn at the root stands still
    searched = [names.index(f"{joint}.R{axis}") for joint, (_, axes) in tree.items() for axis in axes]
    index = np.array([*place, *searched], np.int32)
    return Skeleton(
        joints=joints,
        parent=tuple(-1 if parent is None else joints.index(parent) for parent, _ in tree.values()),
        spread=np.full(len(joints), 0.2),
        models={len(index): index},
        parts=tuple(parts),
        part=tuple(next(i for i, members in enumerate(parts.values()) if joint in members) for joint in joints),
        **more,
    )


def quadruped() -> BodyModel:
    """A dog of 19 degrees of freedom, 0.75 m tall to the ears: hips turn about two axes, knees about one."""
    legs = {"LFore": (0.12, 0.35), "RFore": (-0.12, 0.35), "LHind": (0.12, -0.35), "RHind": (-0.12, -0.35)}
    tree: dict[str, tuple[str | None, str]] = {"Trunk": (None, "xyz"), "Head": ("Trunk", "x")}
    rest = [(0.0, 0.5, 0.0), (0.0, 0.6, 0.4)]
    boxes = [(0, (0.0, 0.5, 0.0), (0.13, 0.1, 0.42)), (1, (0.0, 0.66, 0.52), (0.07, 0.09, 0.16))]
    for leg, (x, z) in legs.items():
        tree |= {f"{leg}Hip": ("Trunk", "xz"), f"{leg}Knee": (f"{leg}Hip", "x")}
        hip = len(rest)
        rest += [(x, 0.45, z), (x, 0.24, z)]
        boxes += [(hip, (x, 0.345, z), (0.05, 0.105, 0.06)), (hip + 1, (x, 0.12, z), (0.035, 0.12, 0.045))]
    limits = np.tile(np.array([-1.2, 1.2], np.float32), (len(tree), 3, 1))
    limits[0] = (-np.inf, np.inf)
    skeleton = _skeleton(
        tree,
        {"trunk and head": ("Trunk", "Head")} | {leg: (f"{leg}Hip", f"{leg}Knee") for leg in legs},
        frame=np.tile(np.eye(3, dtype=np.float32), (len(tree), 1, 1)),
        limits=limits,
        pairs=tuple((f"{end} {j}s", f"L{end}{j}", f"R{end}{j}") for end in ("Fore", "Hind") for j in ("Hip", "Knee")),
    )
    return _box_body("Dog", skeleton, np.array(rest), boxes)


def arm_robot() -> BodyModel:
    """A six-axis arm on a fixed base, 1.2 m tall; each joint is a hinge about one axis of its frame."""
    axes = "yxxyxy"
    heights = (0.1, 0.3, 0.65, 0.8, 1.0, 1.1)
    tree: dict[str, tuple[str | None, str]] = {"Base": (None, "")}
    boxes: list[tuple[int, tuple, tuple]] = [(0, (0.0, 0.05, 0.0), (0.2, 0.05, 0.2))]
    for i, axis in enumerate(axes):
        tree[f"Axis{i + 1}"] = ("Base" if i == 0 else f"Axis{i}", axis)
        top = heights[i + 1] if i < 5 else 1.2
        middle, half, width = (heights[i] + top) / 2, (top - heights[i]) / 2, 0.1 - 0.01 * i
        boxes.append((i + 1, (0.03 * (i % 2), middle, 0.02 * i), (width, half, 0.8 * width)))
    skeleton = _skeleton(
        tree,
        {"base and shoulder": ("Base", "Axis1", "Axis2"), "elbow": ("Axis3", "Axis4"), "hand": ("Axis5", "Axis6")},
        frame=np.tile(np.eye(3, dtype=np.float32), (7, 1, 1)),
        limits=np.tile(np.array([-2.0, 2.0], np.float32), (7, 3, 1)),
    )
    rest = np.array([(0.0, 0.0, 0.0), *((0.0, height, 0.0) for height in heights)])
    return _box_body("Arm", skeleton, rest, boxes)


@cache
def lift() -> BodyModel:
    """The arm with a third axis that slides, and skin of which each joint carries a part and the next one the rest."""
    arm = arm_robot()
    joint, weight = arm.skin.joint.copy(), arm.skin.weight.copy()
    joint[:, 1] = np.minimum(joint[:, 0] + 1, len(arm.joint_rest) - 1)
    weight[:, :2] = 0.7, 0.3
    return replace(
        arm, skeleton=replace(arm.skeleton, sliding=("Axis3",)), skin=replace(arm.skin, joint=joint, weight=weight)
    )


def write_box(path: Path, half: tuple[float, float, float], faces: np.ndarray = _FACES) -> Path:
    """A box about the origin, as ``.obj`` of quads."""
    lines = [f"v {x} {y} {z}" for x, y, z in _CORNERS * half]
    path.write_text("\n".join([*lines, *(f"f {a} {b} {c} {d}" for a, b, c, d in faces + 1), ""]))
    return path


@contextmanager
def things() -> Iterator[tuple[Attachment, ...]]:
    """One that is fixed, one that turns about its z, and one that is free; their files last as long as the context."""
    with tempfile.TemporaryDirectory() as folder:
        box = write_box(Path(folder) / "box.obj", (1.0, 1.0, 1.0))
        stick = write_box(Path(folder) / "stick.obj", (0.25, 0.03, 0.03))
        yield (
            Attachment("Stick", stick, "Head", (0.0, 0.02, 0.3), (0.0, 20.0, 10.0), free="fixed"),
            Attachment("Wheel", box, "LForeHip", (0.2, 0.0, 0.1), (0.0, 90.0, 0.0), scale=0.08, free="z"),
            Attachment("Block", box, None, (0.3, -0.2, 0.6), (30.0, 0.0, 0.0), scale=0.1),
        )


@cache
def burdened() -> BodyModel:
    """The quadruped with these things: 26 degrees of freedom, of which 19 are its own."""
    with things() as carried:
        return carrying(quadruped(), carried)[0]
