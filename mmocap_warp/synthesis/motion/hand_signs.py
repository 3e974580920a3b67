"""Motions of the shipped right hand: it closes to a fist and opens, and it points, while the wrist turns.

A finger's last joint bends two thirds as far as the one before it (Rijpkema and Girard, *Computer animation of
knowledge-based human grasping*, SIGGRAPH 1991).
"""

from __future__ import annotations

from mmocap_warp.body.body_motion import BodyMotion
from mmocap_warp.body.model import BodyModel
from mmocap_warp.synthesis.motion.key_poses import through_poses

FPS = 30.0

_FINGERS = ("index", "middle", "ring", "pinky")
_LAST_JOINT = 2 / 3


def hand_motions(hand: BodyModel) -> dict[str, BodyMotion]:
    """``Opening`` and ``Pointing``, of three seconds each; fingers point up.

    Raises:
        ValueError: a body without the shipped hand's joints.
    """
    upright = {"wrist.Rz": 180.0}
    relaxed = _fingers(20, 25) | _thumb(8, 5, 10) | _spread(2)
    fist = _fingers(70, 85) | _thumb(30, 25, 35) | _spread(-2)
    wide = _fingers(-8, 3) | _thumb(-15, 0, 0) | _spread(9)
    one = _fingers(72, 88) | _finger("index", 2, 4) | _thumb(28, 25, 35) | _spread(-2)
    two = one | _finger("middle", 2, 4) | {"index_finger_phalanx_proximal.Rz": -8.0}
    opening = (
        (0.0, upright | relaxed | {"wrist.Ry": -10.0}),
        (1.0, fist | {"wrist.Ry": 5.0}),
        (2.0, wide | {"wrist.Ry": 30.0, "wrist.Rx": 12.0}),
        (3.0, relaxed | {"wrist.Ry": 0.0, "wrist.Rx": 0.0}),
    )
    pointing = (
        (0.0, upright | relaxed),
        (0.9, one | {"wrist.Rx": 25.0}),
        (1.5, {"wrist.Rx": 40.0, "wrist.Ry": 25.0}),
        (2.2, two | {"wrist.Rx": 10.0, "wrist.Ry": -10.0}),
        (3.0, relaxed | {"wrist.Rx": 0.0, "wrist.Ry": 0.0}),
    )
    return {
        "Opening": through_poses(hand.skeleton, opening, FPS),
        "Pointing": through_poses(hand.skeleton, pointing, FPS),
    }


def _finger(finger: str, knuckle: float, middle: float) -> dict[str, float]:
    """How far a finger is bent at its knuckle and its middle joint [degrees]."""
    return {
        f"{finger}_finger_phalanx_proximal.Rx": knuckle,
        f"{finger}_finger_phalanx_intermediate.Rx": middle,
        f"{finger}_finger_phalanx_distal.Rx": _LAST_JOINT * middle,
    }


def _fingers(knuckle: float, middle: float) -> dict[str, float]:
    bent: dict[str, float] = {}
    for finger in _FINGERS:
        bent |= _finger(finger, knuckle, middle)
    return bent


def _spread(each: float) -> dict[str, float]:
    """Fingers spread from the middle one, by so much from one to the next [degrees]."""
    return {f"{finger}_finger_phalanx_proximal.Rz": (i - 1) * each for i, finger in enumerate(_FINGERS)}


def _thumb(across: float, knuckle: float, last: float) -> dict[str, float]:
    """How far the thumb is brought across the palm, and bent at its two joints [degrees]."""
    return {
        "thumb_metacarpal.Rx": -across,
        "thumb_metacarpal.Rz": 0.5 * across,
        "thumb_phalanx_proximal.Rx": -knuckle,
        "thumb_phalanx_distal.Rx": -last,
    }
