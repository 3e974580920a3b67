"""A body that carries rigid things: a racket in its hand, a crank under its feet, a ball beside it.

A thing is a further joint with a mesh that follows it alone. What is free in space has two joints, one that slides and
on it one that turns. It has its own size, whatever the body's.
"""

from collections.abc import Iterable
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from mmocap_warp.body.model import BodyModel, SkinMesh, Subject
from mmocap_warp.body.rotations import zyx_rotation
from mmocap_warp.body.skeleton import TRANSLATION, Skeleton
from mmocap_warp.formats.attachments import ALL, FIXED, Attachment
from mmocap_warp.formats.rigged.part_meshes import part_mesh
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh
from mmocap_warp.rigging.decimation import decimate
from mmocap_warp.rigging.importing.closing import closed, welded

_TRIANGLES = 600  # number of triangles of a thing's tracking mesh, at most
_LONGEST, _SHORTEST = 3.0, 0.01  # shares of the body's extent: a thing that is longer or shorter is in another unit
_PLACE_SPREAD, _TURN_SPREAD = 0.3, 0.5  # how far a free thing is from its given place, as standard deviations [m, rad]


def carrying(body: BodyModel, things: Iterable[Attachment]) -> tuple[BodyModel, tuple[str, ...]]:
    """A body with things attached, and notes on what was done to close and reduce their meshes, a line each.

    A thing whose name the body has already is left as it is.

    Raises:
        InputError: a mesh that cannot be read, no such joint, a name that is taken, or a size that cannot be.
    """
    notes: list[str] = []
    for thing in things:
        if thing.name not in body.skeleton.attached:
            body, done = _attach(body, thing)
            notes += done
    return body, tuple(notes)


def subject_carrying(subject: Subject, things: Iterable[Attachment]) -> tuple[Subject, tuple[str, ...]]:
    """A subject with things attached at their given places, and notes; see :func:`carrying`."""
    body, notes = carrying(subject.body, things)
    pose = np.zeros(body.skeleton.coordinates)
    pose[: len(subject.pose)] = subject.pose
    return replace(subject, body=body, pose=pose), notes


def _attach(body: BodyModel, thing: Attachment) -> tuple[BodyModel, list[str]]:
    skeleton = body.skeleton
    if thing.joint is not None and thing.joint not in skeleton.joints:
        known = ", ".join(get_close_matches(thing.joint, skeleton.joints, 3, 0.5) or skeleton.joints)
        raise thing.wrong(f"the body has no joint '{thing.joint}'", f"use one of its own, such as {known}")
    if {thing.name, _place(thing)} & {*skeleton.joints, *skeleton.parts}:
        raise thing.wrong("the body has a joint or a part of that name", "name it differently")
    surface, notes = _surface(thing, body)
    carrier = 0 if thing.joint is None else skeleton.index(thing.joint)
    return _join(body, thing, carrier, surface), [f"{thing.name}: {note}" for note in notes]


def _surface(thing: Attachment, body: BodyModel) -> tuple[tuple[np.ndarray, ...], list[str]]:
    """A thing's closed mesh, vertices (vertex, 3) [m] and triangles, and those of a coarser one over some of these."""
    vertex, face = part_mesh(thing.mesh, thing.source)
    vertex = thing.scale * vertex
    extent = float(np.ptp(vertex[np.unique(face)], axis=0).max())
    if not _SHORTEST * body.extent < extent < _LONGEST * body.extent:
        problem = f"{thing.mesh.name} is {extent:.3g} m long, the body {body.extent:.3g} m"
        raise thing.wrong(problem, "set scale to its unit in metres, such as 0.001")
    follows, weight = np.zeros((len(vertex), 1), int), np.ones((len(vertex), 1))
    mesh = welded(RiggedMesh("", ("",), (-1,), np.eye(4)[None], vertex, face, follows, weight))
    vertex, face = mesh.vertex, mesh.face
    if not len(face):
        raise thing.wrong(f"{thing.mesh.name} has no triangles of any area", "write it again as .stl")
    whole = closed(vertex, face)
    notes = [f"{thing.mesh.name} {whole.done}"] if whole.done else []
    vertex, face = np.concatenate([vertex, whole.added]), whole.face
    tracking_vertex, tracking_face = decimate(vertex, face, _TRIANGLES)
    if len(face) > len(tracking_face):
        notes.append(f"tracking mesh: {len(face)} triangles made {len(tracking_face)}")
    return (vertex, face, tracking_vertex, tracking_face), notes


def _join(body: BodyModel, thing: Attachment, carrier: int, surface: tuple[np.ndarray, ...]) -> BodyModel:
    """The body with the thing's joints, which hang on joint ``carrier``."""
    frame = zyx_rotation(np.radians(thing.rotation))
    origin = body.joint_rest[carrier].astype(float) + thing.position
    skeleton = _skeleton(body.skeleton, thing, carrier, frame)
    more = len(skeleton.joints) - len(body.joint_rest)
    # The thing's skin stands after the body's, in faces of as many corners, and follows the last of its joints.
    vertex, face, tracking_vertex, tracking_face = surface
    vertex = origin + vertex @ frame.T
    if body.skin.face.shape[1] == 4:
        vertex, face = _as_quads(vertex, face)
    before, count = len(body.skin.rest), len(vertex)
    joint = np.zeros((count, 4), np.int32)
    joint[:, 0] = len(skeleton.joints) - 1
    skin = SkinMesh(
        rest=np.concatenate([body.skin.rest, vertex.astype(np.float32)]),
        face=np.concatenate([body.skin.face, (face + before).astype(np.int32)]),
        joint=np.concatenate([body.skin.joint, joint]),
        weight=np.concatenate([body.skin.weight, np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1))]),
    )
    tracking_face = tracking_face + len(body.tracking_vertex)
    # Where a shape target moves the carrier, it moves the whole thing along.
    carried = body.shape_joint[:, carrier : carrier + 1]
    return replace(
        body,
        skeleton=skeleton,
        joint_rest=np.concatenate([body.joint_rest, np.tile(origin.astype(np.float32), (more, 1))]),
        skin=skin,
        tracking_vertex=np.concatenate([body.tracking_vertex, (tracking_vertex + before).astype(np.int32)]),
        tracking_face=np.concatenate([body.tracking_face, tracking_face.astype(np.int32)]),
        shape_vertex=np.concatenate([body.shape_vertex, carried.repeat(count, axis=1)], axis=1),
        shape_joint=np.concatenate([body.shape_joint, carried.repeat(more, axis=1)], axis=1),
        motion_poses=None if body.motion_poses is None else np.pad(body.motion_poses, ((0, 0), (0, 3 * more))),
    )


def _skeleton(skeleton: Skeleton, thing: Attachment, carrier: int, frame: np.ndarray) -> Skeleton:
    count, part = len(skeleton.joints), len(skeleton.parts)
    slides = (_place(thing),) if thing.free == ALL else ()
    joints = (*slides, thing.name)
    free = {FIXED: "", ALL: "xyz"}.get(thing.free, thing.free)
    # A free thing is searched along all axes of the joint that slides, then about the free axes of the one that turns.
    first = TRANSLATION + 3 * count
    searched = [first + i for i in range(3) if slides]
    searched += [first + 3 * len(slides) + "xyz".index(axis) for axis in free]
    unlimited = np.tile(np.array([-np.inf, np.inf], np.float32), (len(joints), 3, 1))
    return replace(
        skeleton,
        joints=(*skeleton.joints, *joints),
        parent=(*skeleton.parent, carrier, *range(count, count + len(slides))),
        frame=np.concatenate([skeleton.frame, np.tile(frame.astype(np.float32), (len(joints), 1, 1))]),
        limits=np.concatenate([skeleton.limits, unlimited]),
        spread=np.concatenate([skeleton.spread, [*(_PLACE_SPREAD for _ in slides), _TURN_SPREAD]]),
        models={number: np.append(index, searched).astype(np.int32) for number, index in skeleton.models.items()},
        parts=(*skeleton.parts, thing.name),
        part=(*skeleton.part, *(part for _ in joints)),
        sliding=(*skeleton.sliding, *slides),
        attached=(*skeleton.attached, *joints),
    )


def _place(thing: Attachment) -> str:
    """The name of the joint that slides, of a thing that is free in space."""
    return f"{thing.name}_place"


def _as_quads(vertex: np.ndarray, face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each triangle as three quads, for skin whose faces have four corners; the given vertices come first."""
    side = np.sort(np.stack([face, np.roll(face, -1, axis=1)], axis=-1), axis=-1)
    edge, of_side = np.unique(side.reshape(-1, 2), axis=0, return_inverse=True)
    middle = len(vertex) + of_side.reshape(-1, 3)  # of the side from each corner to the next
    centre = len(vertex) + len(edge) + np.arange(len(face))
    quads = [np.stack([face[:, i], middle[:, i], centre, middle[:, i - 1]], axis=1) for i in range(3)]
    return np.concatenate([vertex, vertex[edge].mean(axis=1), vertex[face].mean(axis=1)]), np.concatenate(quads)
