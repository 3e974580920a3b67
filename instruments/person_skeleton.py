"""The skeleton that the shipped bodies carry: the paper's 16 joints, its models (Table 1) and its hierarchy."""

from __future__ import annotations

import numpy as np

from mmocap_warp.body.skeleton import TRANSLATION, Pair, Skeleton

_TREE: dict[str, str | None] = {
    "Root": None,
    "BottomSpine": "Root",
    "UpperSpine": "BottomSpine",
    "LShoulder": "UpperSpine",
    "LElbow": "LShoulder",
    "LWrist": "LElbow",
    "RShoulder": "UpperSpine",
    "RElbow": "RShoulder",
    "RWrist": "RElbow",
    "Neck": "UpperSpine",
    "LHip": "Root",
    "LKnee": "LHip",
    "LAnkle": "LKnee",
    "RHip": "Root",
    "RKnee": "RHip",
    "RAnkle": "RKnee",
}
JOINTS: tuple[str, ...] = tuple(_TREE)
"""In the order of the paper's state vector."""

PARENT: tuple[int, ...] = tuple(-1 if above is None else JOINTS.index(above) for above in _TREE.values())

_FREE_39: dict[str, str] = dict.fromkeys(JOINTS, "xyz") | {
    "LElbow": "y",
    "RElbow": "y",
    "LWrist": "yz",
    "RWrist": "yz",
    "LKnee": "x",
    "RKnee": "x",
    "LAnkle": "xy",
    "RAnkle": "xy",
}  # Table 1, the 39-DOF model
_NOT_IN_28 = ("UpperSpine", "LWrist", "RWrist", "LAnkle", "RAnkle")  # Table 1: absent from the 28-DOF model


def _coordinates_of(free: dict[str, str]) -> np.ndarray:
    """(dof,) int32, the translation and the free angles."""
    angles = [TRANSLATION + 3 * j + "xyz".index(axis) for j, joint in enumerate(JOINTS) for axis in free[joint]]
    return np.array([*range(TRANSLATION), *angles], np.int32)


MODELS: dict[int, np.ndarray] = {
    39: _coordinates_of(_FREE_39),
    28: _coordinates_of(_FREE_39 | dict.fromkeys(_NOT_IN_28, "")),
    51: _coordinates_of(dict.fromkeys(JOINTS, "xyz")),
}
"""Searched coordinates by number of degrees of freedom; the default first."""

_PARTS: dict[str, tuple[str, ...]] = {
    "root": ("Root",),
    "torso and head": ("BottomSpine", "UpperSpine", "Neck"),
    "left arm": ("LShoulder", "LElbow", "LWrist"),
    "right arm": ("RShoulder", "RElbow", "RWrist"),
    "left leg": ("LHip", "LKnee", "LAnkle"),
    "right leg": ("RHip", "RKnee", "RAnkle"),
}  # the paper's six steps; later ones never revise earlier ones

_PAIRS: tuple[Pair, ...] = tuple(
    (f"{name.lower()}s", f"L{name}", f"R{name}") for name in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")
)
_SPREAD = {"Hip": 0.3, "Shoulder": 0.4, "Elbow": 0.4, "Knee": 0.3}  # people start a recording near to standing [rad]
_SPREAD_ELSE = 0.15


def human_skeleton(frame: np.ndarray, limits: np.ndarray) -> Skeleton:
    """The paper's skeleton; 39 degrees of freedom are searched by default, 28 or 51 on request.

    Args:
        frame: (joint, 3, 3), axes of the joints in body space. Legs, spine, neck and root carry the body's axes; the
            arm's X lies along the bone (in the sense of body +X in a T-pose) and the elbow's Y is the hinge.
        limits: (joint, axis, 2), lowest and highest angles [rad].
    """
    part = tuple(next(i for i, joints in enumerate(_PARTS.values()) if joint in joints) for joint in JOINTS)
    return Skeleton(
        joints=JOINTS,
        parent=PARENT,
        frame=np.asarray(frame, np.float32),
        limits=np.asarray(limits, np.float32),
        spread=np.array([_SPREAD.get(joint[1:], _SPREAD_ELSE) for joint in JOINTS]),
        models=MODELS,
        parts=tuple(_PARTS),
        part=part,
        pairs=_PAIRS,
    )
