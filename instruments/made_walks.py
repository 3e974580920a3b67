"""A body walking along a circle, as full pose vectors: feet that roll and never slide, the rest from published curves.

Footprints lie along the path, and a standing foot rolls over its sole as over a wheel of straight pieces, so that the
point that touches the floor stands still. The pelvis follows the path with its published rise, sway, turn and list;
the angles of a standing leg follow from both. A swinging leg has the published angles, corrected smoothly so that it
leaves one footprint and reaches the next. Arms, spine and neck follow their curves.

Lengths are in metres and angles in radians, in a frame with +Y up whose +Z is the walking direction at phase 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import gait_curves as curves
import numpy as np
from standing_posture import Sole, room

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import applied, transposed, turn, zyx_angles, zyx_rotation
from mmocap_warp.study.sequences import FPS, Motion
from mmocap_warp.synthesis.motion.limb_motion import SIGN, TRUNK, Leg, about, rest_axes, trunk_angles

_AHEAD = {"L": 0.0, "R": 0.5}  # how far a leg's phase is ahead of the left one's
_BELOW_HIP = 0.22  # phase at which a standing foot is below the pelvis
_LEAST_KNEE = np.radians(6.0)  # flexion that the knee of a standing leg keeps
_CHEST_LEAN = np.radians(3.0)
_ARM_SPREAD, _ARM_INWARD = np.radians(9.0), np.radians(10.0)
_NUDGE = 0.005  # difference of the phase from which slopes are taken


@dataclass(frozen=True)
class Walk:
    """A walk of one body.

    Attributes:
        body: who walks.
        radius: of the circle walked along, to the left [m].
        stride: path from a contact of a foot to its next [m].
        step_width: between the lines of the left and the right footprints, at the ankles [m].
        toe_out: of the feet, from their direction in the bind pose [rad].
    """

    body: BodyModel
    radius: float = 2.5
    stride: float = 1.15
    step_width: float = 0.11
    toe_out: float = 0.06

    def poses(self, phase: np.ndarray) -> np.ndarray:
        """Full pose vectors (frame, 51), from the axes above, at phases (frame,) of the left leg, not wrapped."""
        root, pelvis = self._pelvis(phase)
        pose = np.zeros((len(phase), self.body.skeleton.coordinates))
        pose[:, :3] = root
        pose[:, self.body.skeleton.angles("Root")] = zyx_angles(pelvis)
        for side in "LR":
            self._set_leg(pose, side, phase, pelvis)
            self._set_arm(pose, side, phase + _AHEAD[side])
        self._set_trunk(pose, phase, pelvis)
        return pose

    def _heading(self, phase: np.ndarray) -> np.ndarray:
        return self.stride * phase / self.radius

    def _path(self, phase: np.ndarray, left: np.ndarray | float) -> np.ndarray:
        """Points on the floor (frame, 3), moved to the left of the path."""
        heading, inner = self._heading(phase), self.radius - left
        return np.stack([self.radius - inner * np.cos(heading), 0 * heading, inner * np.sin(heading)], axis=-1)

    def _pelvis(self, phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The root joint's place (frame, 3) and axes (frame, 3, 3)."""
        root, pelvis = self._low_pelvis(phase)
        root[:, 1] += self._height
        return root, pelvis

    def _low_pelvis(self, phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same as :meth:`_pelvis`, with heights from their mean."""
        root = self._path(phase, curves.sway(phase))
        root[:, 1] = curves.rise(phase, self.stride)
        return root, turn("y", self._heading(phase) - curves.pelvis_turn(phase)) @ turn("z", curves.pelvis_list(phase))

    @cached_property
    def _height(self) -> float:
        """The root's mean height: as high as the standing legs reach."""
        own, highest = np.linspace(0.0, curves.TOE_OFF, 63), np.inf
        for side, leg in self._legs.items():
            root, pelvis = self._low_pelvis(own - _AHEAD[side])
            highest = min(highest, room(leg, root, pelvis, self._on_floor(side, 0 * own, own), _LEAST_KNEE))
        return highest

    @cached_property
    def _legs(self) -> dict[str, Leg]:
        return {side: Leg.of(self.body, side) for side in "LR"}

    @cached_property
    def _soles(self) -> dict[str, Sole]:
        return {side: Sole.of(self.body, side) for side in "LR"}

    def _set_leg(self, pose: np.ndarray, side: str, phase: np.ndarray, pelvis: np.ndarray) -> None:
        own = phase + _AHEAD[side]
        step = np.floor(own)
        s = np.clip((own - step - curves.TOE_OFF) / (1.0 - curves.TOE_OFF), 0.0, 1.0)[:, None]
        standing = self._standing_angles(side, step, np.minimum(own, step + curves.TOE_OFF))
        swinging = self._published_angles(side, own) + self._correction(side, step, s)
        leg = np.where(s > 0, swinging, standing)
        yaw = self._yaw(side, step) * (1 - _ease(s[:, 0])) + self._yaw(side, step + 1) * _ease(s[:, 0])
        foot = turn("y", yaw) @ turn("x", -curves.foot_pitch(own))
        shank = pelvis @ zyx_rotation(leg[:, :3]) @ turn("x", leg[:, 3])
        angles = self.body.skeleton.angles
        pose[:, angles(f"{side}Hip")] = leg[:, :3]
        pose[:, angles(f"{side}Knee").start] = leg[:, 3]
        pose[:, angles(f"{side}Ankle")] = zyx_angles(transposed(shank) @ foot)

    def _yaw(self, side: str, step: np.ndarray) -> np.ndarray:
        """Direction of a footprint."""
        return self._heading(step + _BELOW_HIP - _AHEAD[side]) + SIGN[side] * self.toe_out

    def _on_floor(self, side: str, step: np.ndarray, own: np.ndarray) -> np.ndarray:
        """The ankle (frame, 3) of a foot that rolls over its footprint of a step."""
        footprint = self._path(step + _BELOW_HIP - _AHEAD[side], SIGN[side] * self.step_width / 2)
        forward, up = self._soles[side].ankle(curves.foot_pitch(own))
        return footprint + applied(turn("y", self._yaw(side, step)), np.stack([0 * up, up, forward], axis=-1))

    def _standing_angles(self, side: str, step: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Angles (frame, 4) of hip and knee that leave the foot on its footprint of a step."""
        leg = self._legs[side]
        root, pelvis = self._pelvis(own - _AHEAD[side])
        sideways = turn("y", self._yaw(side, step))[:, :, 0]
        return leg.angles(root + applied(pelvis, leg.hip), self._on_floor(side, step, own), pelvis, sideways)

    def _published_angles(self, side: str, own: np.ndarray) -> np.ndarray:
        """The published angles (frame, 4) of hip and knee."""
        leg = self._legs[side]
        hip, knee = lean(leg) - curves.hip_flexion(own), leg.straight + curves.knee_flexion(own)
        return np.stack([hip, 0 * hip, 0 * hip, knee], axis=-1)

    def _correction(self, side: str, step: np.ndarray, s: np.ndarray) -> np.ndarray:
        """What to add to a swinging leg's published angles, ``s`` (frame, 1) of the way from one footprint to the next.

        At both ends it has the values that the standing legs need. Where the foot leaves it has their slope too, which
        fades fast, or it would carry the swing away from what is published; a foot that lands is stopped by the floor.
        """

        def missed(step: np.ndarray, own: np.ndarray) -> np.ndarray:
            return self._standing_angles(side, step, own) - self._published_angles(side, own)

        leave, land, ease = step + curves.TOE_OFF, step + 1.0, _ease(s)
        start, end = missed(step, leave), missed(step + 1, land)
        slope = (start - missed(step, leave - _NUDGE)) / _NUDGE * (1.0 - curves.TOE_OFF)
        return start * (1 - ease) + end * ease + slope * s * (1 - s) ** 8

    def _set_arm(self, pose: np.ndarray, side: str, own: np.ndarray) -> None:
        swing, flexion = curves.shoulder_flexion(own), curves.elbow_flexion(own)
        shoulder, elbow = hanging_arm(self.body, side, swing, flexion, _ARM_SPREAD, _ARM_INWARD)
        pose[:, self.body.skeleton.angles(f"{side}Shoulder")] = shoulder
        pose[:, self.body.skeleton.angles(f"{side}Elbow")] = elbow

    def _set_trunk(self, pose: np.ndarray, phase: np.ndarray, pelvis: np.ndarray) -> None:
        """The spine takes the chest from the pelvis' axes to the girdle's, half at either joint; the head looks on."""
        heading = turn("y", self._heading(phase))
        chest = heading @ turn("y", -curves.girdle_turn(phase)) @ turn("x", _CHEST_LEAN)
        for joint, angles in zip(TRUNK, trunk_angles(pelvis, chest, heading), strict=True):
            pose[:, self.body.skeleton.angles(joint)] = angles


def _ease(s: np.ndarray) -> np.ndarray:
    """From 0 to 1, level at both ends."""
    return s * s * (3.0 - 2.0 * s)


def lean(leg: Leg) -> float:
    """The thigh forward of the vertical in the bind pose [rad]."""
    return float(np.arctan2(leg.thigh[2], -leg.thigh[1]))


def hanging_arm(
    body: BodyModel, side: str, swing: np.ndarray, flexion: np.ndarray, spread: float, inward: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rx, Ry, Rz of shoulder and elbow, each (frame, 3) [rad], of an arm that hangs beside the chest.

    Args:
        body: its arms are bound in an A-pose, elbows bent.
        side: ``L`` or ``R``.
        swing: (frame,), upper arm forward of the chest's vertical [rad].
        flexion: (frame,), forearm forward of the upper arm [rad].
        spread: upper arm away from the chest [rad].
        inward: turn of the forearm toward the body's middle, about the upper arm [rad].
    """
    sign = SIGN[side]
    chest, shoulder, elbow = (rest_axes(body, name) for name in ("UpperSpine", f"{side}Shoulder", f"{side}Elbow"))
    # Of a hanging arm, x points down on the left and up on the right, z is where the forearm bends to: forward.
    down, forward = np.array([0.0, -sign, 0.0]), np.array([0.0, 0.0, 1.0])
    hanging = np.stack([down, np.cross(forward, down), forward], axis=-1) @ turn("x", inward)
    upper_arm = turn("x", -swing) @ turn("z", sign * spread) @ hanging
    shoulder_turn = transposed(shoulder) @ chest @ upper_arm
    bound = shoulder.T @ elbow
    already_bent = np.arctan2(sign * bound[2, 0], bound[0, 0])
    bend = -sign * (flexion - already_bent)
    return zyx_angles(shoulder_turn), about("y", bend)


def walking_around(radius: float, stride: float, cadence: float, step_width: float = Walk.step_width) -> Motion:
    """Around the origin of the floor, once or nearly so; strides differ by 2 % in duration.

    Args:
        radius, stride, step_width: see :class:`Walk` [m].
        cadence: steps per minute.
    """

    def motion(body: BodyModel, frames: int, seed: int) -> np.ndarray:
        rng = np.random.default_rng([seed, 1])
        time, rate = np.arange(frames) / FPS, cadence / 120.0
        phase = rate * time + rng.random()
        for slow in (0.11, 0.17, 0.29):  # [Hz]
            phase += 0.016 * rate / (2 * np.pi * slow) * np.sin(2 * np.pi * (slow * time + rng.random()))
        poses = Walk(body, radius=radius, stride=stride, step_width=step_width).poses(phase)
        poses[:, 0] -= radius
        return poses

    return motion
