"""Skeletons as USD: joints and bind transforms as UsdSkel has them, and their degrees of freedom as attributes.

docs/bodies.md has the attributes' names and meanings.
"""

import numpy as np
from pxr import Sdf, Usd, Vt

from mmocap_warp.body.skeleton import Skeleton, coordinate_names
from mmocap_warp.errors import input_errors
from mmocap_warp.formats.usd.usd_file import PrimReader, author, valid_names

_ROTATION_TOLERANCE = 1e-3


def joint_paths(skeleton: Skeleton) -> list[str]:
    """USD's names of the joints: each joint's path from the root, such as ``Root/LHip/LKnee``, of names it takes."""
    paths: list[str] = []
    names = valid_names(skeleton.joints)
    for joint, parent in zip(skeleton.joints, skeleton.parent, strict=True):
        paths.append(names[joint] if parent < 0 else f"{paths[parent]}/{names[joint]}")
    return paths


def define_freedom(prim: Usd.Prim, skeleton: Skeleton) -> None:
    """What a skeleton says beyond joints and bind transforms, as attributes."""
    for name, column in (("Lower", 0), ("Upper", 1)):
        limit = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(skeleton.limits[:, :, column]))
        author(prim, f"mmocap:limits{name}", limit, kind=Sdf.ValueTypeNames.Float3Array)
    author(prim, "mmocap:spread", skeleton.spread)
    author(prim, "mmocap:models", np.array(list(skeleton.models)))
    for number, index in skeleton.models.items():
        author(prim, f"mmocap:dof{number}", [skeleton.coordinate_names[i] for i in index])
    author(prim, "mmocap:parts", list(skeleton.parts))
    author(prim, "mmocap:part", np.array(skeleton.part))
    author(prim, "mmocap:pairs", [name for name, *_ in skeleton.pairs])
    author(prim, "mmocap:pairJoints", [joint for _, *pair in skeleton.pairs for joint in pair])
    if not skeleton.stands:
        author(prim, "mmocap:stands", False)
    for name, joints in (("sliding", skeleton.sliding), ("attached", skeleton.attached)):
        if joints:
            author(prim, f"mmocap:{name}", list(joints))


def read_skeleton(read: PrimReader) -> tuple[Skeleton, np.ndarray]:
    """The skeleton, and the joints' centres (joint, 3) float32 in the bind pose [m]."""
    paths = read.texts("joints")
    called, own = read.texts("jointNames", optional=True), [path.rsplit("/", 1)[-1] for path in paths]
    joints = tuple(called if len(called) == len(paths) else own)
    read.require(len({*joints}) == len({*paths}) == len(paths), "two joints share a name")
    read.require("".join(joints).replace("+", "\n").isprintable(), "a joint's name has a '+', or cannot be printed")
    # Each joint hangs on the one whose path is its own without the last part.
    numbers = {path: j for j, path in enumerate(paths)}
    above = [path.rpartition("/")[0] for path in paths]
    orphan = next((path for path, parent in zip(paths, above, strict=True) if parent and parent not in numbers), None)
    read.require(orphan is None, f"joint '{orphan}' hangs on one that does not exist")
    # Where joints are bound, and how far they may turn.
    bind = read.array("bindTransforms", (len(joints), 4, 4), np.float64).transpose(0, 2, 1)
    read.require(all(map(is_rotation, bind[:, :3, :3])), "a bind transform is not a rotation and a translation")
    lower, upper = (read.array(f"mmocap:limits{end}", (len(joints), 3)) for end in ("Lower", "Upper"))
    read.require((lower <= upper).all(), "a lower joint limit lies above the upper one")
    # Pairs, and joints of special kinds.
    sides, names = read.texts("mmocap:pairJoints"), read.texts("mmocap:pairs")
    read.require(len(sides) == 2 * len(names), f"mmocap:pairJoints names {len(sides)} joints for {len(names)} pairs")
    sliding, attached = (tuple(read.texts(f"mmocap:{name}", optional=True)) for name in ("sliding", "attached"))
    spread = read.array("mmocap:spread", (len(joints),), np.float64)
    models = _read_models(read, coordinate_names(joints, sliding))
    parts, part = read.texts("mmocap:parts"), read.array("mmocap:part", (len(joints),), np.int64)
    with input_errors(read.source, f"{read.prim.GetPath()}: {{error}}", read.remedy, ValueError):
        skeleton = Skeleton(
            joints=joints, parent=tuple(numbers[parent] if parent else -1 for parent in above),
            frame=bind[:, :3, :3].astype(np.float32), limits=np.stack([lower, upper], -1), spread=spread, models=models,
            parts=tuple(parts), part=tuple(part.tolist()),
            pairs=tuple(zip(names, sides[::2], sides[1::2], strict=True)),
            stands=read.typed("mmocap:stands", bool, unsaid=True), sliding=sliding, attached=attached,
        )  # fmt: skip
    return skeleton, bind[:, :3, 3].astype(np.float32)


def _read_models(read: PrimReader, coordinates: tuple[str, ...]) -> dict[int, np.ndarray]:
    """Searched coordinates of each model, of those that a pose has."""
    known = {name: i for i, name in enumerate(coordinates)}
    models = {}
    for number in read.array("mmocap:models", (None,), np.int64).tolist():
        wanted = read.texts(f"mmocap:dof{number}")
        unknown = next((name for name in wanted if name not in known), None)
        read.require(unknown is None, f"mmocap:dof{number} names '{unknown}', which is no coordinate of its joints")
        models[number] = np.array([known[name] for name in wanted], np.int32)
    return models


def is_rotation(matrix: np.ndarray) -> bool:
    """Whether a (3, 3) matrix is a proper rotation."""
    return bool(np.allclose(matrix @ matrix.T, np.eye(3), atol=_ROTATION_TOLERANCE) and np.linalg.det(matrix) > 0)
