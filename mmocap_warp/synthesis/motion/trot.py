"""A quadruped robot that trots: diagonal legs step together, and a foot on the floor does not slide.

Legs have two bones that move in a plane along the body, as those of ANYmal, Go2 and their like do: a foot's place gives
both angles. Hips do not spread.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.body_motion import BodyMotion
from mmocap_warp.body.model import BodyModel
from mmocap_warp.synthesis.motion.motion_tracks import minimum_jerk

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
