"""A character or a robot as its file has it: joints, where they are bound, skin that follows them, and motions."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mmocap_warp.errors import InputError


@dataclass(frozen=True)
class JointAxis:
    """The axis that a joint turns about or slides along, where its file says so."""

    axis: np.ndarray  # (3,) unit vector, in the file's axes in the bind pose
    # Limits from the bind pose, infinite where free: angles, right-handed about ``axis`` [rad]; of a joint that slides,
    # lengths along ``axis``, in the file's unit of length.
    lower: float = -np.inf
    upper: float = np.inf
    slides: bool = False  # whether the joint slides instead of turning
    ball: bool = False  # whether it turns about any axis, by ``upper`` at most


@dataclass(frozen=True)
class RiggedMotion:
    """An animation of a file, at even times."""

    fps: float  # frames per second
    world: np.ndarray  # (frame, joint, 4, 4) float64, the file's space from joint, for column vectors


@dataclass(frozen=True)
class RiggedMesh:
    """What a file holds, in its own axes and unit of length."""

    name: str  # of the character or robot
    joints: tuple[str, ...]  # names, as in the file
    parent: tuple[int, ...]  # (joint,) number of the joint that each hangs on, which comes first; -1 for none
    bind: np.ndarray  # (joint, 4, 4) float64, the file's space from joint in the bind pose; may be scaled
    vertex: np.ndarray  # (vertex, 3) float64, in the bind pose
    face: np.ndarray  # (face, 3) int, counter-clockwise seen from outside
    influence: np.ndarray  # (vertex, influence) int, the joints that each vertex follows
    weight: np.ndarray  # (vertex, influence) float64, their weights; any number, zero where unused
    # The directions of the file's format: signed axes such as ``+y``.
    up: str = "+y"
    facing: str = "+z"
    metres: float = 1.0  # metres per unit of length
    # By number of joint. Joints that are missing may turn in any way, as far as the file says.
    axes: dict[int, JointAxis] = field(default_factory=dict)
    motions: dict[str, RiggedMotion] = field(default_factory=dict)  # animations by name
    rigid: bool = False  # whether the parts are rigid and their sizes known, as a robot's are
    roams: bool = False  # whether the file says that it moves as a whole, if it is one chain too
    attribution: str = ""  # what the file says of its makers; may be empty
    notes: tuple[str, ...] = ()  # what was not read as the file has it, a line each


def parents_first(parent: list[int]) -> list[int]:
    """An order of joints, else as they were, in which each comes after its parent; a ValueError for a loop."""
    order: dict[int, None] = {}
    for joint in range(len(parent)):
        chain = []
        while joint >= 0 and joint not in order:
            if joint in chain:
                raise ValueError("joints form a loop")
            chain.append(joint)
            joint = parent[joint]
        order |= dict.fromkeys(reversed(chain))
    return list(order)


def chosen_character(names: Sequence[tuple[str, ...]], named: str | None, path: Path) -> int:
    """The number of the character that is meant, of those that a file holds, each of which has some names.

    Raises:
        InputError: there is none of that name, or no name and several characters.
    """
    chosen = [i for i, own in enumerate(names) if named is None or named in own]
    if len(chosen) == 1:
        return chosen[0]
    problem = f"holds {len(names)} characters" + ("" if named is None else f", and not one that is called '{named}'")
    raise InputError(path, problem, f"choose one with --character: {', '.join(own[0] for own in names)}")


class Skin(NamedTuple):
    """Skin: vertices (vertex, 3), triangles (face, 3), and (vertex, influence) joints that each follows and weights."""

    vertex: np.ndarray
    face: np.ndarray
    influence: np.ndarray
    weight: np.ndarray


def joined_parts(parts: list[Skin]) -> Skin:
    """Several parts as one."""
    width = max(part.weight.shape[1] for part in parts)
    vertex, face, influence, weight = zip(*parts, strict=True)
    padded = ([np.pad(each, ((0, 0), (0, width - each.shape[1]))) for each in of_all] for of_all in (influence, weight))
    faces = [each + start for each, start in zip(face, np.cumsum([0, *map(len, vertex)]), strict=False)]
    return Skin(np.concatenate(vertex), np.concatenate(faces), *map(np.concatenate, padded))


def rigid_skin(parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]], path: Path) -> Skin:
    """The skin of a robot's parts: vertices, triangles, turn, place and joint of each; an InputError for no parts."""
    if not parts:
        raise InputError(path, "has no geometry", "give a robot with visual meshes")
    skins = [
        Skin(vertex @ turn.T + place, face, np.full((len(vertex), 1), joint), np.ones((len(vertex), 1)))
        for vertex, face, turn, place, joint in parts
    ]
    return joined_parts(skins)


def robot(name: str, joints: list[str], parent: list[int], bind: np.ndarray, skin: Skin, **more: Any) -> RiggedMesh:
    """A robot in the axes that its formats have, +Z up and +X ahead; ``more`` are further fields of the mesh."""
    return RiggedMesh(name, tuple(joints), tuple(parent), bind, *skin, up="+z", facing="+x", rigid=True, **more)


def reorder(mesh: RiggedMesh, order: list[int] | None = None) -> RiggedMesh:
    """The mesh with joints in another order, by default parents first; no skin may follow one that is left out."""
    order = parents_first(list(mesh.parent)) if order is None else order
    rank = {joint: i for i, joint in enumerate(order)}
    number = np.array([rank.get(joint, 0) for joint in range(len(mesh.joints))])
    return replace(
        mesh,
        joints=tuple(mesh.joints[joint] for joint in order),
        parent=tuple(rank.get(mesh.parent[joint], -1) for joint in order),
        bind=mesh.bind[order],
        influence=np.where(mesh.weight > 0, number[mesh.influence], 0),
        axes={rank[joint]: axis for joint, axis in mesh.axes.items() if joint in rank},
        motions={name: RiggedMotion(motion.fps, motion.world[:, order]) for name, motion in mesh.motions.items()},
    )


def skinned(mesh: RiggedMesh, world: np.ndarray) -> np.ndarray:
    """(vertex, 3) of the file's skin where its joints (joint, 4, 4) are."""
    moved = world @ np.linalg.inv(mesh.bind)
    share = mesh.weight / np.maximum(mesh.weight.sum(axis=1, keepdims=True), 1e-12)
    at = np.concatenate([mesh.vertex, np.ones((len(mesh.vertex), 1))], axis=1)
    posed = np.zeros((len(at), 3))
    for joint, weight in zip(mesh.influence.T, share.T, strict=True):
        posed += weight[:, None] * np.einsum("vab,vb->va", moved[joint, :3], at)
    return posed
