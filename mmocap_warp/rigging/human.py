"""The skeleton that the shipped bodies carry: the paper's 16 joints, its models (Table 1), its hierarchy, and limits.

Limits come from published ranges of motion: American Academy of Orthopaedic Surgeons, *Joint Motion: Method of
Measuring and Recording* (1965), as tabulated by Norkin and White, *Measurement of Joint Motion* (5th ed., 2016), for
hinges and single movements; Kapandji, *The Physiology of the Joints*, for the spine and for the shoulder's compound
range; Rajagopal et al., *Full-body musculoskeletal model* (IEEE TBME 63, 2016), for the signs and the knee.

A hinge's limits are its clinical range, with a few degrees to spare. A ball joint's Euler angles are not clinical
angles: there the limits hold every pose that combines the clinical ranges (tests/rigging/test_anatomy.py samples them),
so they are wider. They keep a limb from turning round itself; they do not say that a pose is possible.
"""

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


_UNBOUNDED = (-np.inf, np.inf)

_ELBOW_FLEXION = (-10.0, 150.0)  # AAOS 0..150, with up to 10 of hyperextension
_KNEE_FLEXION = (-10.0, 150.0)  # AAOS 0..135, Rajagopal 0..140; 150 in a deep squat

# Degrees from the zero pose about x, y and z, left side for paired joints. Positive Rx bends the trunk and neck
# forward, the knee back and the foot down, and takes the leg back; see `joint_limits` for the right side.
_LEFT_LIMITS: dict[str, tuple[tuple[float, float], ...]] = {
    "Root": (_UNBOUNDED, _UNBOUNDED, _UNBOUNDED),
    # Thoracolumbar flexion 80, extension 30, rotation 45, side bend 35: either joint may take nearly all of it.
    "BottomSpine": ((-40.0, 80.0), (-45.0, 45.0), (-45.0, 45.0)),
    "UpperSpine": ((-40.0, 70.0), (-50.0, 50.0), (-45.0, 45.0)),
    # Cervical flexion 45..60, extension 45..75, rotation 60..80, side bend 45.
    "Neck": ((-80.0, 70.0), (-85.0, 85.0), (-60.0, 60.0)),
    # Shoulder: elevation 0..180 in every plane from sideways to forward, 60 backward, 130 across the body; rotation
    # 80 in and 90 out. Pointing forward is its gimbal lock (Ry = -90), around which Rx and Rz go far.
    "LShoulder": ((-180.0, 180.0), (-170.0, 110.0), (-130.0, 180.0)),
    # Wrist: flexion 80, extension 70, deviation 20 and 30. With the forearm's turn held (Table 1), either axis may
    # carry the flexion.
    "LWrist": ((-90.0, 90.0), (-85.0, 85.0), (-85.0, 85.0)),
    # Hip: flexion 120, extension 30, abduction 45, adduction 30, rotation 45 each way.
    "LHip": ((-150.0, 60.0), (-80.0, 80.0), (-80.0, 80.0)),
    # Ankle: dorsiflexion 20 (40 under load), plantarflexion 50, eversion 15, inversion 35, with the forefoot's turn.
    "LAnkle": ((-45.0, 65.0), (-45.0, 45.0), (-45.0, 45.0)),
}
_ELBOW_TURN = 90.0  # pronation and supination 80 each, about the forearm
_ELBOW_CARRY = 15.0
_KNEE_TURN = 40.0  # tibial rotation of the bent knee
_KNEE_SIDE = 10.0


def joint_limits(elbow_flexion: float, knee_flexion: float) -> np.ndarray:
    """Lower and upper angle of each joint about each of its axes; (joint, axis, 2) float32 [rad].

    Angles count from the zero pose, in which elbow and knee are already bent by the given angles [rad]. Left
    elbows flex by negative Ry, right ones by positive; knees flex by positive Rx. Right joints mirror the left
    ones: the same about x, opposite about y and z.
    """
    elbow, knee = np.degrees(elbow_flexion), np.degrees(knee_flexion)
    left = {
        **_LEFT_LIMITS,
        "LElbow": (
            (-_ELBOW_TURN, _ELBOW_TURN),
            (elbow - _ELBOW_FLEXION[1], elbow - _ELBOW_FLEXION[0]),
            (-_ELBOW_CARRY, _ELBOW_CARRY),
        ),
        "LKnee": (
            (_KNEE_FLEXION[0] - knee, _KNEE_FLEXION[1] - knee),
            (-_KNEE_TURN, _KNEE_TURN),
            (-_KNEE_SIDE, _KNEE_SIDE),
        ),
    }
    limits = np.array([left[joint if joint in left else "L" + joint[1:]] for joint in JOINTS])
    right = [j for j, joint in enumerate(JOINTS) if joint not in left]
    mirrored = limits[right]
    mirrored[:, 1:] = -mirrored[:, 1:, ::-1]
    limits[right] = mirrored
    return np.radians(limits).astype(np.float32)
