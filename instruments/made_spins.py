"""A walk that ends in fast turns on one foot with the arms out, and goes on: a pirouette amid a step.

A walker is over the left foot, the right one in the air, a fifth of a cycle after the left heel's contact. There the
walk comes to rest, the whole body turns about the ball of that foot at a steady rate, and the walk goes on from where
it had stopped. Arms go out before the turns and come down after them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from gait_curves import CADENCE
from least_jerk import minimum_jerk
from made_walks import Walk
from standing_posture import StandingPosture, sway

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import applied, turn, zyx_angles, zyx_rotation
from mmocap_warp.synthesis.motion.limb_motion import SIGN


@dataclass(frozen=True)
class Spin:
    """When somebody turns, and how fast.

    Attributes:
        begin: of the turns [s].
        rate: at which the body turns, to the left [degrees/s].
        turns: whole ones, so that the walk goes on in its direction.
    """

    begin: float
    rate: float = 400.0
    turns: int = 2

    @property
    def end(self) -> float:
        """When the body begins to come to rest [s]."""
        return self.begin + 360.0 * self.turns / self.rate


SPINS: dict[str, Spin] = {"S1": Spin(1.1), "S2": Spin(1.25, rate=360.0)}
"""By person."""

_OVER_LEFT_FOOT = 0.22  # phase of the left leg at which the walker is over its foot
_RADIUS = 8.0  # radius of the walk's circle: nearly straight [m]
_SETTLE = 0.6  # time in which the walk comes to rest, and in which it goes on [s]
_RAMP = 0.3  # time in which the turns begin, and in which they come to rest [s]
_ARMS = 0.5  # time in which the arms go out, and in which they come down [s]
_ARM_OUT = (0.94, 0.03, 0.18)  # place of a wrist outward, up and ahead of the shoulder, in arm lengths
_ELBOW_OUT = (0.0, -0.5, -1.0)
_THIGH_UP, _SHANK_BACK = 0.35, 0.40  # by how much more the free leg bends than in a step [rad]
_BALL = 0.09  # distance of the foot's ball ahead of the ankle [m]


def spinning(body: BodyModel, frames: int, fps: float, spin: Spin, seed: int) -> np.ndarray:
    """Full pose vectors (frame, 51), in body axes about the origin of the floor, where the turning foot stands."""
    rng = np.random.default_rng([seed, 5])
    time = np.arange(frames) / fps
    posture = StandingPosture(body, frames)
    posture.poses[:] = Walk(body, radius=_RADIUS).poses(_phase(time, spin))
    ball = _ball_of_foot(body)
    posture.poses[:, :3] -= ball
    out = minimum_jerk((time - spin.begin + _ARMS) / _ARMS) - minimum_jerk((time - spin.end) / _ARMS)
    _lift_free_leg(posture, body, out)
    _sway_chest(posture, body, out, time, rng)
    for side in "LR":
        _spread_arm(posture, side, out, time, rng)
    return _turn_poses(posture.poses, np.radians(spin.rate) * (_ramp(time, spin.begin) - _ramp(time, spin.end)))


def _phase(time: np.ndarray, spin: Spin) -> np.ndarray:
    """The left leg's phase: the walk rests above the left foot from the beginning of the turns to their end."""
    cycles = CADENCE / 120.0
    halt = spin.begin - _SETTLE
    walked = time - _ramp(time, halt, _SETTLE) + _ramp(time, spin.end, _SETTLE)
    return _OVER_LEFT_FOOT + cycles * (walked - halt - _SETTLE / 2)


def _ramp(time: np.ndarray, begin: float, duration: float = _RAMP) -> np.ndarray:
    """The integral of a speed that goes from 0 to 1 with the least jerk; level before it begins [s]."""
    s = np.clip((time - begin) / duration, 0.0, 1.0)
    return duration * s**4 * (2.5 - 3.0 * s + s * s) + np.maximum(time - begin - duration, 0.0)


def _ball_of_foot(body: BodyModel) -> np.ndarray:
    """(3,), on the floor, of the foot that the walk rests on."""
    posture = StandingPosture(body, 1)
    posture.poses[:] = Walk(body, radius=_RADIUS).poses(np.array([_OVER_LEFT_FOOT]))
    ball = posture.place("LAnkle")[0] + (0.0, 0.0, _BALL)
    return ball * (1.0, 0.0, 1.0)


def _lift_free_leg(posture: StandingPosture, body: BodyModel, out: np.ndarray) -> None:
    angles = body.skeleton.angles
    posture.poses[:, angles("RHip").start] -= _THIGH_UP * out
    posture.poses[:, angles("RKnee").start] += _SHANK_BACK * out


def _sway_chest(
    posture: StandingPosture, body: BodyModel, out: np.ndarray, time: np.ndarray, rng: np.random.Generator
) -> None:
    """Keep the balance with the lower spine and the neck."""
    for joint in ("BottomSpine", "Neck"):
        wander = np.stack([0.05 * sway(time, (0.6, 1.1, 1.7), rng) for _ in range(3)], axis=-1)
        posture.poses[:, body.skeleton.angles(joint)] += out[:, None] * wander


def _spread_arm(
    posture: StandingPosture, side: str, out: np.ndarray, time: np.ndarray, rng: np.random.Generator
) -> None:
    """Move an arm from its place in the walk to the side, and back."""
    shoulder, elbow, wrist = (posture.place(side + joint) for joint in ("Shoulder", "Elbow", "Wrist"))
    outward = np.array([SIGN[side], 1.0, 1.0])
    wander = np.stack([0.02 * sway(time, (0.5, 0.9, 1.5), rng) for _ in range(3)], axis=-1)
    spread = (_ARM_OUT + wander) * outward * posture.arm_length
    share = out[:, None]
    points = (1 - share) * (elbow - (shoulder + wrist) / 2) + share * (np.array(_ELBOW_OUT) * outward)
    posture.reach(side, shoulder + (1 - share) * (wrist - shoulder) + share * spread, points)


def _turn_poses(poses: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Poses turned about the vertical through the origin by angles (frame,), to the left [rad]."""
    moved = poses.copy()
    about = turn("y", angle)
    moved[:, :3] = applied(about, poses[:, :3])
    moved[:, 3:6] = zyx_angles(about @ zyx_rotation(poses[:, 3:6]))
    return moved
