"""The skinned body: a skeleton, meshes that follow it, shape targets and markers."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np

from mmocap_warp.body.rotations import applied, zyx_rotation
from mmocap_warp.body.skeleton import TRANSLATION, Skeleton
from mmocap_warp.errors import InputError

_PERSON = 1.2  # extent of a body that counts as large as a person [m]
_USUAL_PERSON = 1.8  # extent of a person, by which bodies of another size are measured [m]
_MEASURED = ("body.", "shape.bone.", "shape.girth.")  # what a subject's lengths are called in its provenance
_IN_METRES = 0.06, 3.0  # extent of bodies that metres suit, from mice to the largest people [m]


@dataclass(frozen=True)
class SkinMesh:
    """A mesh bound to the joints."""

    rest: np.ndarray  # (vertex, 3) float32, bind-pose positions in body space [m]
    face: np.ndarray  # (face, 3) or (face, 4) int32, counter-clockwise seen from outside
    joint: np.ndarray  # (vertex, 4) int32, influencing joints
    weight: np.ndarray  # (vertex, 4) float32, their weights, summing to one; unused slots have weight 0 and joint 0

    @cached_property
    def heaviest_joint(self) -> np.ndarray:
        """(vertex,) int32, the joint that has the most weight on each vertex; the first of equals."""
        return self.joint[np.arange(len(self.joint)), self.weight.argmax(axis=1)]


@dataclass(frozen=True)
class BodyModel:
    """A skinned body. Body space is right-handed, in metres: +Y up, +Z the way it faces, +X its left.

    The zero pose is the bind pose. Joint ``j`` turns by ``Rz @ Ry @ Rx`` (x first) in its own frame:
    ``world[j] = world[parent] @ rest_local[j] @ (Rz Ry Rx)``, where ``rest_local`` follows from
    ``joint_rest`` and ``skeleton.frame``.
    """

    name: str  #: identifier, a valid USD prim name
    skeleton: Skeleton  #: the joints and their degrees of freedom
    joint_rest: np.ndarray  #: (joint, 3) float32, joint centres in the bind pose [m]
    skin: SkinMesh  #: the full mesh (quads or triangles), for display and markers
    tracking_vertex: np.ndarray  #: (tracking vertex,) int32, the full-mesh vertices that the tracking mesh keeps
    tracking_face: np.ndarray  #: (tracking face, 3) int32, triangles over ``tracking_vertex``; closed
    shape_names: tuple[str, ...]  #: one per shape target, such as ``height_incr`` and ``height_decr``
    shape_vertex: np.ndarray  #: (shape, vertex, 3) float32, displacement of the full mesh at weight 1 [m]
    shape_joint: np.ndarray  #: (shape, joint, 3) float32, displacement of the joint centres at weight 1 [m]
    marker_names: tuple[str, ...]  #: named virtual markers on the skin
    marker_vertex: np.ndarray  #: (marker,) int32, their full-mesh vertices
    attribution: str  #: where the shape comes from and under which licence
    #: whether bones' lengths, girths and scale are known, as a robot's are: only poses are solved for
    rigid: bool = False
    #: tables of further joint sets, texts by name; see :mod:`mmocap_warp.body.joint_sets`
    joint_sets: Mapping[str, str] = field(default_factory=dict)
    #: (pose, coordinate) float64, of the motions that came with it; None without any
    motion_poses: np.ndarray | None = None

    def __repr__(self) -> str:
        joints, models = len(self.skeleton.joints), " or ".join(map(str, self.skeleton.models))
        rigid = ", rigid" if self.rigid else ""
        return f"BodyModel {self.name}: {joints} joints, {models} DOF, {len(self.skin.rest)} vertices{rigid}"

    @cached_property
    def rest_transforms(self) -> np.ndarray:
        """(joint, 4, 4) float64: parent from joint in the bind pose; the root's is body space from root."""
        bind, above = bind_transforms(self), list(self.skeleton.parent[1:])
        return np.concatenate([bind[:1], np.linalg.inv(bind[above]) @ bind[1:]])

    @cached_property
    def tracking(self) -> SkinMesh:
        """The tracking mesh: about 2,000 to 5,000 triangles over a subset of the full mesh's vertices."""
        keep = self.tracking_vertex
        return SkinMesh(self.skin.rest[keep], self.tracking_face, self.skin.joint[keep], self.skin.weight[keep])

    @cached_property
    def own_vertex(self) -> np.ndarray:
        """(vertex,) bool, which of the full mesh's vertices are the body's own, not those of attached things."""
        return ~self.skeleton.is_attached[self.skin.heaviest_joint]

    @cached_property
    def unscaled(self) -> tuple[np.ndarray, np.ndarray]:
        """(vertex, 3) and (joint, 3) float32, the part of each bind place that does not grow with the body [m].

        Attached things have the size that they have: their skin and joints keep their way from the joint that carries
        them. It is zero for all else.
        """
        skeleton, skin = self.skeleton, self.skin
        from_carrier = skin.rest - self.joint_rest[skeleton.carrier[skin.heaviest_joint]]
        by_vertex = np.where(self.own_vertex[:, None], np.float32(0), from_carrier)
        return by_vertex, self.joint_rest - self.joint_rest[skeleton.carrier]

    @cached_property
    def extent(self) -> float:
        """Its largest extent along an axis at rest, without attached things [m]."""
        return float(np.ptp(self.skin.rest[self.own_vertex], axis=0).max())

    @property
    def unit(self) -> float:
        """The unit of length in which it is searched for [m]: that in which giants and beetles are as large as we."""
        return 1.0 if _IN_METRES[0] <= self.extent <= _IN_METRES[1] else self.extent / _USUAL_PERSON

    @property
    def relative_size(self) -> float:
        """Its extent over a person's, 1 up to the largest person's: a factor for lengths that hold for people."""
        return min(1.0, self.extent / _PERSON) if self.unit == 1.0 else self.unit

    def in_unit(self, unit: float) -> Self:
        """The body with all of its lengths in a unit [m], what is attached included."""
        by = np.float32(1 / unit)
        body = self.with_rest(self.skin.rest * by, self.joint_rest * by, by)
        poses = None if self.motion_poses is None else self.motion_poses / self.skeleton.units(unit)
        return replace(body, skeleton=self.skeleton.in_unit(unit), motion_poses=poses)

    def with_rest(self, rest: np.ndarray, joint_rest: np.ndarray, scale: np.float32 | np.ndarray) -> Self:
        """The body with other bind places (vertex, 3) and (joint, 3) float32 [m], and its shape targets scaled."""
        return replace(
            self,
            skin=replace(self.skin, rest=rest),
            joint_rest=joint_rest,
            shape_vertex=self.shape_vertex * scale,
            shape_joint=self.shape_joint * scale,
        )

    @property
    def volume(self) -> float:
        """What the closed tracking mesh holds at rest [m^3]."""
        a, b, c = self.skin.rest[self.tracking_vertex][self.tracking_face].swapaxes(0, 1).astype(np.float64)
        return float(abs(np.einsum("fi,fi->", a, np.cross(b, c))) / 6)

    def shaped(self, weights: dict[str, float], scale: float = 1.0) -> Self:
        """The body with shape targets applied at the given weights, then scaled uniformly, but for attached things.

        The result is a new rest body: its own targets are the old ones scaled, so further shaping adds on top.

        Raises:
            ValueError: an unknown target name.
        """
        unknown = sorted(set(weights) - set(self.shape_names))
        if unknown:
            raise ValueError(f"unknown shape targets {unknown}; this body has {list(self.shape_names)}")
        w = np.array([weights.get(name, 0.0) for name in self.shape_names], np.float32)
        rest = (self.skin.rest + np.tensordot(w, self.shape_vertex, 1)) * np.float32(scale)
        joints = (self.joint_rest + np.tensordot(w, self.shape_joint, 1)) * np.float32(scale)
        if self.skeleton.attached:
            by_vertex, by_joint = self.unscaled
            rest += np.float32(1 - scale) * by_vertex
            joints += np.float32(1 - scale) * by_joint
        return self.with_rest(rest, joints, np.float32(scale))


@dataclass(frozen=True)
class Subject:
    """A body fitted to a recording: what a tracking run starts from."""

    body: BodyModel  #: the fitted body
    root_base: np.ndarray  #: (3, 3) float64, world from body axes at zero root rotation: up axis and heading
    pose: np.ndarray  #: (coordinate,) float64 [m, rad], the first frame's; it begins with the root joint's place
    provenance: dict[str, str | float | int]  #: how it was made

    def __repr__(self) -> str:
        measure, adjective = ("length", "long") if "body.length" in self.provenance else ("height", "tall")
        size = self.provenance.get(f"body.{measure}")
        known = "" if size is None else f", {float(size):.2f} m {adjective}"
        place = ", ".join(f"{value:.2f}" for value in self.pose[:3])
        return f"Subject {self.body.name}{known}, starts at ({place}) m"

    def in_unit(self, unit: float) -> Self:
        """The subject with all of its lengths in a unit [m], those that a fit measured included."""
        if unit == 1:
            return self
        measured = {name: value for name, value in self.provenance.items() if name.startswith(_MEASURED)}
        provenance = self.provenance | {name: float(value) / unit for name, value in measured.items()}
        pose = self.pose / self.body.skeleton.units(unit)
        return replace(self, body=self.body.in_unit(unit), pose=pose, provenance=provenance)


def bind_transforms(body: BodyModel) -> np.ndarray:
    """(joint, 4, 4) float64: body space from joint in the bind pose, for column vectors."""
    bind = np.tile(np.eye(4), (len(body.joint_rest), 1, 1))
    bind[:, :3, :3], bind[:, :3, 3] = body.skeleton.frame, body.joint_rest
    return bind


def joint_transforms(subject: Subject, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Transforms of the joints in poses (frame, coordinate): (frame, joint, 4, 4) float64, for column vectors.

    The first have each joint in its parent, the root in the world; the second have all of them in the world.
    """
    local = np.tile(subject.body.rest_transforms, (len(pose), 1, 1, 1))
    local[:, 0, :3, :3] = subject.root_base @ local[:, 0, :3, :3]
    local[:, 0, :3, 3] = pose[:, :TRANSLATION]
    slides, own = subject.body.skeleton.slides, pose[:, TRANSLATION:].reshape(len(pose), -1, 3)
    for number in np.flatnonzero(slides):
        local[:, number, :3, 3] += applied(local[:, number, :3, :3], own[:, number])
    local[..., :3, :3] = local[..., :3, :3] @ zyx_rotation(np.where(slides[:, None], 0.0, own))
    world = local.copy()
    for joint, parent in enumerate(subject.body.skeleton.parent):
        if parent >= 0:
            world[:, joint] = world[:, parent] @ local[:, joint]
    return local, world


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Poses of a body at even times, in the body's own space: its root's base is the identity."""

    fps: float  # frames per second
    pose: np.ndarray  # (frame, coordinate) float64 [m, rad]

    def some_poses(self, count: int) -> np.ndarray:
        """(pose, coordinate) up to ``count`` of its poses, evenly spread."""
        return self.pose[np.unique(((np.arange(count) + 0.5) / count * len(self.pose)).astype(int))]


def motion_named(name: str, motions: Mapping[str, BodyMotion], body_file: Path) -> BodyMotion:
    """One of a body file's motions, by its name or an end that only one has; an InputError for none, or several."""
    for end in (f"|{name}", name):  # many programs put the armature's name before it
        named = [name] if name in motions else [each for each in motions if each.endswith(end)]
        if len(named) == 1:
            return motions[named[0]]
    known = f"name one of {', '.join(motions)}" if motions else "it came without any: give a file instead"
    raise InputError(body_file, f"has no motion '{name}'", known)
