"""The skinned body: joints, meshes, shape targets, limits and markers, and its degrees of freedom (Table 1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

JOINTS: tuple[str, ...] = (
    "Root",
    "BottomSpine",
    "UpperSpine",
    "LShoulder",
    "LElbow",
    "LWrist",
    "RShoulder",
    "RElbow",
    "RWrist",
    "Neck",
    "LHip",
    "LKnee",
    "LAnkle",
    "RHip",
    "RKnee",
    "RAnkle",
)
"""The paper's 16 joints in the order of its state vector."""

PARENT: tuple[int, ...] = (-1, 0, 1, 2, 3, 4, 2, 6, 7, 2, 0, 10, 11, 0, 13, 14)
"""Parent of each joint; parents come first, the root has -1."""

_FREE_39: dict[str, str] = {
    "Root": "xyz",
    "BottomSpine": "xyz",
    "UpperSpine": "xyz",
    "LShoulder": "xyz",
    "LElbow": "y",
    "LWrist": "yz",
    "RShoulder": "xyz",
    "RElbow": "y",
    "RWrist": "yz",
    "Neck": "xyz",
    "LHip": "xyz",
    "LKnee": "x",
    "LAnkle": "xy",
    "RHip": "xyz",
    "RKnee": "x",
    "RAnkle": "xy",
}  # Table 1, the 39-DOF model
_STARRED = ("UpperSpine", "LWrist", "RWrist", "LAnkle", "RAnkle")  # Table 1: absent from the 28-DOF model

DOF_MODELS: tuple[int, ...] = (51, 39, 28)
FULL_DOF = 51
"""Length of the full pose vector ``Tx Ty Tz, Rx Ry Rz of joint 1 .. 16`` [m, rad]."""


@dataclass(frozen=True)
class DegreesOfFreedom:
    """Which entries of the full 51-vector a parameterisation searches; the others are held.

    Attributes:
        index: (dof,) int, positions in the full pose vector, ascending; 0-2 are the root's translation.
    """

    index: np.ndarray

    def __len__(self) -> int:
        return len(self.index)

    @property
    def names(self) -> tuple[str, ...]:
        """``Tx``, ``Ty``, ``Tz``, then ``<joint>.Rx`` and so on, one per degree of freedom."""
        return tuple(FULL_NAMES[i] for i in self.index)

    @property
    def is_translation(self) -> np.ndarray:
        """(dof,) bool."""
        return np.asarray(self.index) < 3

    def of_joints(self, *joints: str) -> np.ndarray:
        """Positions within this parameterisation of the rotations of the named joints; (n,) int."""
        wanted = [JOINTS.index(name) for name in joints]
        joint = (np.asarray(self.index) - 3) // 3
        return np.flatnonzero(np.isin(joint, wanted) & ~self.is_translation)


FULL_NAMES: tuple[str, ...] = ("Tx", "Ty", "Tz", *(f"{joint}.R{axis}" for joint in JOINTS for axis in "xyz"))


def degrees_of_freedom(model: int) -> DegreesOfFreedom:
    """Table 1's parameterisation with ``model`` degrees of freedom: 51 (all), 39 or 28.

    Raises:
        ValueError: another number.
    """
    if model not in DOF_MODELS:
        raise ValueError(f"dof must be one of {DOF_MODELS}, got {model}")
    index = [0, 1, 2]
    for j, joint in enumerate(JOINTS):
        axes = "xyz" if model == 51 else _FREE_39[joint]
        if model == 28 and joint in _STARRED:
            axes = ""
        index += [3 + 3 * j + "xyz".index(axis) for axis in axes]
    return DegreesOfFreedom(np.array(index, np.int32))


@dataclass(frozen=True)
class SkinMesh:
    """A mesh bound to the joints.

    Attributes:
        rest: (vertex, 3) float32, bind-pose positions in body space [m].
        face: (face, 3) or (face, 4) int32, counter-clockwise seen from outside.
        joint: (vertex, 4) int32, influencing joints.
        weight: (vertex, 4) float32, their weights, summing to one; unused slots have weight 0 and joint 0.
    """

    rest: np.ndarray
    face: np.ndarray
    joint: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class BodyModel:
    """A skinned body. Body space is right-handed, in metres: +Y up, +Z the way it faces, +X its left.

    The zero pose is the bind pose. Joint ``j`` turns by ``Rz @ Ry @ Rx`` (x first) in its own frame:
    ``world[j] = world[parent] @ rest_local[j] @ (Rz Ry Rx)``, where ``rest_local`` follows from
    ``joint_rest`` and ``joint_frame``.

    Attributes:
        name: identifier, a valid USD prim name.
        joint_rest: (joint, 3) float32, joint centres in the bind pose [m].
        joint_frame: (joint, 3, 3) float32, columns are the joint's axes in body space. Legs, spine, neck and root
            carry the body's axes; the arm's X lies along the bone (in the sense of body +X in a T-pose) and the
            elbow's Y is the hinge.
        skin: the full mesh (quads), for display and markers.
        tracking_vertex: (tracking vertex,) int32, the full-mesh vertices that the tracking mesh keeps.
        tracking_face: (tracking face, 3) int32, triangles over ``tracking_vertex``; closed.
        shape_names: one per shape target, such as ``height_incr`` and ``height_decr``.
        shape_vertex: (shape, vertex, 3) float32, displacement of the full mesh at weight 1 [m].
        shape_joint: (shape, joint, 3) float32, displacement of the joint centres at weight 1 [m].
        limits: (joint, axis, 2) float32, lower and upper angle from the zero pose [rad].
        marker_names: named virtual markers on the skin.
        marker_vertex: (marker,) int32, their full-mesh vertices.
        attribution: where the shape comes from and under which licence.
    """

    name: str
    joint_rest: np.ndarray
    joint_frame: np.ndarray
    skin: SkinMesh
    tracking_vertex: np.ndarray
    tracking_face: np.ndarray
    shape_names: tuple[str, ...]
    shape_vertex: np.ndarray
    shape_joint: np.ndarray
    limits: np.ndarray
    marker_names: tuple[str, ...]
    marker_vertex: np.ndarray
    attribution: str

    @cached_property
    def tracking(self) -> SkinMesh:
        """The tracking mesh: about 2,000 to 5,000 triangles over a subset of the full mesh's vertices."""
        keep = self.tracking_vertex
        return SkinMesh(self.skin.rest[keep], self.tracking_face, self.skin.joint[keep], self.skin.weight[keep])

    def shaped(self, weights: dict[str, float], scale: float = 1.0) -> BodyModel:
        """The body with shape targets applied at the given weights, then scaled uniformly.

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
        return replace(
            self,
            skin=replace(self.skin, rest=rest),
            joint_rest=joints,
            shape_vertex=self.shape_vertex * np.float32(scale),
            shape_joint=self.shape_joint * np.float32(scale),
        )


@dataclass(frozen=True)
class Subject:
    """A body fitted to a recording: what a tracking run starts from.

    Attributes:
        body: the fitted body.
        root_base: (3, 3) float64, world from body axes at zero root rotation: up axis and heading.
        pose: (51,) float64, the first frame's full pose vector; its translation is the root joint's world
            position [m], its angles are in radians.
        provenance: how it was made (flat, strings and numbers).
    """

    body: BodyModel
    root_base: np.ndarray
    pose: np.ndarray
    provenance: dict[str, str | float | int]
