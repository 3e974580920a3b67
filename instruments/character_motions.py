"""Give shipped characters the motions that this project wrote: ``python instruments/character_motions.py FOLDER``.

FOLDER holds ``hand.usdc``, ``anymal.usdc`` and ``panda.usdc``, as ``mmocap body import`` makes them; motions that they
have are replaced.

The right hand closes to a fist and opens, and it points, while the wrist turns. A finger's last joint bends two thirds
as far as the one before it (Rijpkema and Girard, *Computer animation of knowledge-based human grasping*, SIGGRAPH
1991). ANYmal trots: diagonal legs step together, and a foot on the floor does not slide. Its legs have two bones that
move in a plane along the body, so a foot's place gives both angles; hips do not spread. Panda picks something up and
puts it down elsewhere.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from least_jerk import minimum_jerk, through_poses

from mmocap_warp.body.model import BodyModel, BodyMotion
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import read_body, write_body

_HAND_FPS = 30.0

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
        "Opening": through_poses(hand.skeleton, opening, _HAND_FPS),
        "Pointing": through_poses(hand.skeleton, pointing, _HAND_FPS),
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


_SOLE = 0.02  # skin that is as low as this over a shank's lowest is its foot [m]


@dataclass(frozen=True)
class Leg:
    """Of a quadruped.

    Attributes:
        hip, knee: its joints that turn about the body's left-right axis.
        bend: 1 where the knee turns about the body's +X as it bends, so that it points ahead, else -1.
        phase: how far it is ahead in its stride; legs that step together have the same.
    """

    hip: str
    knee: str
    bend: int
    phase: float


@dataclass(frozen=True)
class Trot:
    """A trot straight ahead.

    Attributes:
        legs: all of them.
        lowered: how far the body is below where it is when the legs are as in the bind pose [m].
        stride: path from a step of a foot to its next [m].
        rate: of strides [Hz].
        lift: of a stepping foot [m].
        bounce: of the body, up and down twice in a stride [m].
    """

    legs: tuple[Leg, ...]
    lowered: float
    stride: float
    rate: float
    lift: float
    bounce: float

    def motion(self, body: BodyModel, seconds: float, fps: float) -> BodyMotion:
        """So many seconds of it, along the body's +Z.

        Raises:
            ValueError: a body without these joints, or legs that are too short for such steps.
        """
        time = np.arange(round(seconds * fps) + 1) / fps
        cycle = self.rate * time
        height = self.bounce * np.cos(4 * np.pi * cycle) - self.lowered
        pose = np.zeros((len(time), body.skeleton.coordinates))
        pose[:, :3] = body.joint_rest[0] + np.stack([0 * time, height, self.stride * cycle], axis=1)
        for leg in self.legs:
            ahead, up = self._foot(cycle + leg.phase)
            angles = _angles(body, leg, np.stack([up - height, ahead], axis=1))
            for joint, angle in zip((leg.hip, leg.knee), angles, strict=True):
                side = np.sign(body.skeleton.frame[body.skeleton.index(joint), 0, 0])  # of its axis
                pose[:, body.skeleton.angles(joint).start] = side * angle
        return BodyMotion(fps, pose)

    def _foot(self, cycle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far a foot is ahead of where it is on average under the body, and over the floor; each (frame,) [m]."""
        phase = cycle % 1.0
        step = np.clip(2 * phase - 1, 0.0, 1.0)  # it stands for half of a stride
        ahead = self.stride * (0.25 - phase + minimum_jerk(step))
        return ahead, self.lift * np.sin(np.pi * step) ** 2


def _angles(body: BodyModel, leg: Leg, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """About the body's +X, each (frame,) [rad], of a leg's hip and knee from the bind pose.

    Args:
        body: whose leg it is.
        leg: which one.
        moved: (frame, 2), of its foot from where it is in the bind pose, seen from the hip: up and ahead [m].
    """
    hip, knee = body.skeleton.index(leg.hip), body.skeleton.index(leg.knee)
    shank = body.skin.rest[body.skin.heaviest_joint == knee].astype(float)
    foot = shank[shank[:, 1] < shank[:, 1].min() + _SOLE].mean(axis=0)
    upper = (body.joint_rest[knee] - body.joint_rest[hip])[1:].astype(float)  # up and ahead, as all below
    lower = foot[1:] - body.joint_rest[knee, 1:]
    reach = foot[1:] - body.joint_rest[hip, 1:] + moved
    a, b, c = np.linalg.norm(upper), np.linalg.norm(lower), np.linalg.norm(reach, axis=1)
    if (c > a + b).any() or (c < abs(a - b)).any():
        raise ValueError(f"{leg.hip}: the leg cannot reach {c.min():.3g} to {c.max():.3g} m from its hip")
    bent = leg.bend * np.arccos((c**2 - a**2 - b**2) / (2 * a * b))  # of the lower bone from the upper one's line
    thigh = _direction(reach) - np.arctan2(b * np.sin(bent), a + b * np.cos(bent))
    at_hip = _wrapped(thigh - _direction(upper))
    return at_hip, _wrapped(bent - _direction(lower) + _direction(upper))


def _direction(vector: np.ndarray) -> np.ndarray:
    """Of vectors (..., 2), up and ahead: how far they are turned about +X from straight up [rad]."""
    direction: np.ndarray = np.arctan2(vector[..., 1], vector[..., 0])
    return direction


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """Angles [rad] between half a turn either way."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


ANYMAL = Trot(
    legs=(
        Leg("LF_HFE", "LF_KFE", bend=-1, phase=0.0),
        Leg("RF_HFE", "RF_KFE", bend=-1, phase=0.5),
        Leg("LH_HFE", "LH_KFE", bend=1, phase=0.5),
        Leg("RH_HFE", "RH_KFE", bend=1, phase=0.0),
    ),
    lowered=0.1,
    stride=0.4,
    rate=1.4,
    lift=0.1,
    bounce=0.01,
)


def anymal_motions(robot: BodyModel) -> dict[str, BodyMotion]:
    """``Trot``, 1.5 seconds at 0.56 m/s.

    Raises:
        ValueError: a body without ANYmal's joints.
    """
    return {"Trot": ANYMAL.motion(robot, 1.5, 60.0)}


def panda_motions(robot: BodyModel) -> dict[str, BodyMotion]:
    """``Pick``: it reaches down, lifts, turns, and puts down, in three seconds.

    Raises:
        ValueError: a body without Panda's joints.
    """

    def arm(*degrees: float) -> dict[str, float]:
        return {f"panda_joint{number}.Rx": angle for number, angle in enumerate(degrees, 1)}

    keys = (
        (0.0, arm(0, -30, 0, -130, 0, 100, 45)),
        (0.8, arm(35, 32, -5, -105, 5, 138, 80)),
        (1.3, arm(35, 5, -5, -105, 5, 112, 80)),
        (2.1, arm(-45, 10, 15, -100, -20, 115, 0)),
        (2.6, arm(-45, 38, 15, -92, -20, 130, 0)),
        (3.0, arm(-45, 15, 15, -100, -20, 115, 0)),
    )
    return {"Pick": through_poses(robot.skeleton, keys, 30.0)}


MOTIONS: dict[str, Callable[[BodyModel], dict[str, BodyMotion]]] = {
    "hand": hand_motions,
    "anymal": anymal_motions,
    "panda": panda_motions,
}
"""What each character does, by its name."""


def write_motions(folder: Path) -> list[Path]:
    """Write the characters of a folder again with their motions; the files.

    Raises:
        InputError: one is missing or is no body, or the folder cannot be written to.
    """
    files = [folder / f"{name}.usdc" for name in MOTIONS]
    for file in files:
        body = read_body(file)
        write_body(file, body, MOTIONS[file.stem](body))
    return files


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python instruments/character_motions.py FOLDER")
    try:
        print("\n".join(f"wrote {file}" for file in write_motions(Path(sys.argv[1]))))
    except InputError as error:
        print(error, file=sys.stderr)
        raise SystemExit(3) from None
