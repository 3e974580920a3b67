"""Angles of legs, arms and trunk from where feet, hands and chest shall be: closed forms for a body's own bones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import applied, transposed, turn, zyx_angles, zyx_rotation
from mmocap_warp.synthesis.exact_posing import led_by

SIGN: dict[str, float] = {"L": 1.0, "R": -1.0}
"""Of a side's x."""


def rest_place(body: BodyModel, joint: str) -> np.ndarray:
    """(3,) float64, a joint in the bind pose [m]."""
    return body.joint_rest[body.skeleton.index(joint)].astype(float)


def rest_axes(body: BodyModel, joint: str) -> np.ndarray:
    """(3, 3) float64, a joint's axes in the bind pose."""
    return body.skeleton.frame[body.skeleton.index(joint)].astype(float)


def about(axis: str, angle: np.ndarray) -> np.ndarray:
    """(frame, 3) angles Rx, Ry, Rz [rad] of which one is ``angle`` (frame,) and the others are zero."""
    return np.stack([angle if each == axis else 0 * angle for each in "xyz"], axis=-1)


@dataclass(frozen=True)
class Leg:
    """A leg's bones in the bind pose, in which its joints carry the body's axes.

    Attributes:
        hip: (3,), from the root joint [m].
        thigh: (3,), hip to knee [m].
        shank: (3,), knee to ankle [m].
    """

    hip: np.ndarray
    thigh: np.ndarray
    shank: np.ndarray

    @classmethod
    def of(cls, body: BodyModel, side: str) -> Leg:
        """The leg of one side, ``L`` or ``R``."""
        hip, knee, ankle = (rest_place(body, side + name) for name in _LEG)
        return cls(hip - body.joint_rest[0], knee - hip, ankle - knee)

    @property
    def straight(self) -> float:
        """The knee's Rx at which the leg is longest: straight [rad]."""
        along, across = self._knee_terms()
        return float(np.arctan2(across, along))

    @property
    def lean(self) -> float:
        """The thigh forward of the vertical in the bind pose [rad]."""
        return float(np.arctan2(self.thigh[2], -self.thigh[1]))

    def reach(self, flexion: float) -> float:
        """Distance from hip to ankle at a flexion from straight [rad]; [m]."""
        bent = self.thigh + turn("x", self.straight + flexion) @ self.shank
        return float(np.linalg.norm(bent))

    def angles(self, hip: np.ndarray, ankle: np.ndarray, pelvis: np.ndarray, sideways: np.ndarray) -> np.ndarray:
        """The hip's Rx, Ry, Rz and the knee's Rx that bring the ankle to its place: (frame, 4) [rad].

        Args:
            hip, ankle: (frame, 3), in the world [m].
            pelvis: (frame, 3, 3), world from the root joint's axes.
            sideways: (frame, 3), where the knee's hinge points, as nearly as the leg allows.

        Raises:
            ValueError: an ankle out of reach.
        """
        target = ankle - hip
        knee = self._knee(np.linalg.norm(target, axis=-1))
        leg = self.thigh + applied(turn("x", knee), self.shank)
        thigh = basis(target, sideways) @ transposed(basis(leg, np.broadcast_to(np.eye(3)[0], leg.shape)))
        return np.concatenate([zyx_angles(transposed(pelvis) @ thigh), knee[:, None]], axis=1)

    def room(self, root: np.ndarray, pelvis: np.ndarray, ankle: np.ndarray, flexion: float) -> float:
        """How far up the root can go before the knee's flexion from straight is less than ``flexion`` [rad]; [m].

        Args:
            root, ankle: (frame, 3), in the world [m].
            pelvis: (frame, 3, 3), world from the root joint's axes.
            flexion: from straight [rad].
        """
        away = ankle - root - applied(pelvis, self.hip)
        level = np.hypot(away[:, 0], away[:, 2])
        return float((away[:, 1] + np.sqrt(self.reach(flexion) ** 2 - level**2)).min())

    def _knee_terms(self) -> tuple[float, float]:
        """``a`` and ``b`` of ``thigh . Rx(angle) shank = a cos + b sin + constant``."""
        (_, ty, tz), (_, sy, sz) = self.thigh, self.shank
        return ty * sy + tz * sz, tz * sy - ty * sz

    def _knee(self, distance: np.ndarray) -> np.ndarray:
        along, across = self._knee_terms()
        fixed = self.thigh @ self.thigh + self.shank @ self.shank + 2 * self.thigh[0] * self.shank[0]
        cosine = (distance**2 - fixed) / (2 * np.hypot(along, across))
        if (cosine > 1).any():
            raise ValueError(
                f"an ankle is {distance.max():.3f} m from its hip, the leg is {self.reach(0.0):.3f} m long"
            )
        return self.straight + np.arccos(cosine)


_LEG = ("Hip", "Knee", "Ankle")


def leg_length(body: BodyModel) -> float:
    """Hip to ankle of a straight leg, mean of both sides [m]."""
    return (Leg.of(body, "L").reach(0.0) + Leg.of(body, "R").reach(0.0)) / 2


def basis(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(..., 3, 3) whose columns are ``first``, ``second`` made normal to it, and their cross product, as units."""
    a = first / np.linalg.norm(first, axis=-1, keepdims=True)
    b = second - (a * second).sum(axis=-1, keepdims=True) * a
    b = b / np.linalg.norm(b, axis=-1, keepdims=True)
    return np.stack([a, b, np.cross(a, b)], axis=-1)


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


TRUNK: tuple[str, ...] = ("BottomSpine", "UpperSpine", "Neck")
"""The joints between pelvis and head."""


def trunk_angles(pelvis: np.ndarray, chest: np.ndarray, head: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rx, Ry, Rz (frame, 3) of the lower spine, the upper spine and the neck, from axes (frame, 3, 3) in the world.

    The spine takes the chest from the pelvis' axes to its own, half at either joint.
    """
    between = transposed(pelvis) @ chest
    half = zyx_angles(between) / 2
    return half, zyx_angles(transposed(zyx_rotation(half)) @ between), zyx_angles(transposed(chest) @ head)


@dataclass(frozen=True)
class Arm:
    """An arm's bones in the bind pose.

    Attributes:
        sign: 1 of the left arm, -1 of the right.
        frame: (3, 3), the shoulder's axes from the chest's.
        elbow: (3, 3), the elbow's axes from the shoulder's; their y is the hinge.
        upper: (3,), shoulder to elbow, in the shoulder's axes [m].
        fore: (3,), elbow to wrist, in the elbow's axes [m].
    """

    sign: float
    frame: np.ndarray
    elbow: np.ndarray
    upper: np.ndarray
    fore: np.ndarray

    @classmethod
    def of(cls, body: BodyModel, side: str) -> Arm:
        """The arm of one side, ``L`` or ``R``."""
        chest, shoulder, elbow = (rest_axes(body, name) for name in ("UpperSpine", f"{side}Shoulder", f"{side}Elbow"))
        at = {name: rest_place(body, side + name) for name in ("Shoulder", "Elbow", "Wrist")}
        return cls(
            sign=SIGN[side],
            frame=chest.T @ shoulder,
            elbow=shoulder.T @ elbow,
            upper=shoulder.T @ (at["Elbow"] - at["Shoulder"]),
            fore=elbow.T @ (at["Wrist"] - at["Elbow"]),
        )

    @property
    def length(self) -> float:
        """The length of both bones [m]."""
        return float(np.linalg.norm(self.upper) + np.linalg.norm(self.fore))

    def rotations(self, chest: np.ndarray, wrist: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The shoulder's rotations (frame, 3, 3) and the elbow's Ry (frame,) [rad].

        Args:
            chest: (frame, 3, 3), world from the chest's axes.
            wrist: (frame, 3), where the wrist is to be, from the shoulder, in the world [m]; one that is out of reach
                is drawn in along its line, to a straight arm.
            points: (frame, 3), where the elbow points, as nearly as the line allows.
        """
        flexion = self._flexion(np.linalg.norm(wrist, axis=-1))
        reached = self.upper + applied(self.elbow @ turn("y", flexion), self.fore)
        hinge = self.sign * np.cross(wrist, points)
        arm = basis(wrist, hinge) @ transposed(basis(reached, np.broadcast_to(self.elbow[:, 1], reached.shape)))
        return self.frame.T @ transposed(chest) @ arm, flexion

    def _flexion(self, distance: np.ndarray) -> np.ndarray:
        """The elbow's Ry at which the wrist is that far from the shoulder."""
        (gx, gy, gz), (fx, fy, fz) = self.elbow.T @ self.upper, self.fore
        along, across = gx * fx + gz * fz, gx * fz - gz * fx  # upper . elbow Ry(angle) fore = along cos + across sin
        fixed = self.upper @ self.upper + self.fore @ self.fore + 2 * gy * fy
        cosine = np.clip((distance**2 - fixed) / (2 * np.hypot(along, across)), -1.0, 1.0)
        return np.arctan2(across, along) - self.sign * np.arccos(cosine)


_STEEPEST = np.radians(75.0)
_GRID = 1201  # number of pitches, 1/8 of a degree apart


@dataclass(frozen=True)
class Sole:
    """Where the ankle is over the floor while the foot rolls from heel to toes on the outline of its sole.

    Attributes:
        pitch: (pitch,), of the foot, toes up positive, ascending [rad].
        forward: (pitch,), of the ankle from where it is when the foot is flat [m].
        up: (pitch,), of the ankle from the floor [m].
        contact: (pitch, 2), to the left and forward, of the point that touches, from where the ankle is when flat [m].
    """

    pitch: np.ndarray
    forward: np.ndarray
    up: np.ndarray
    contact: np.ndarray

    @classmethod
    def of(cls, body: BodyModel, side: str) -> Sole:
        """The sole of one side, ``L`` or ``R``, of a body that stands flat in its bind pose."""
        joint = body.skeleton.index(f"{side}Ankle")
        foot = (body.skin.rest[led_by(body, f"{side}Ankle")] - body.joint_rest[joint]).astype(float)
        x, y, z = foot.T
        pitch = np.linspace(-_STEEPEST, _STEEPEST, _GRID)
        sine, cosine = np.sin(pitch)[:, None], np.cos(pitch)[:, None]
        height = cosine * y + sine * z
        touching = height.argmin(axis=1)
        reach = np.take_along_axis(cosine * z - sine * y, touching[:, None], axis=1)[:, 0]
        # From one pitch to the next the foot turns about the vertex that touches, which stays where it is.
        rows = np.arange(_GRID - 1)
        next_reach = (cosine * z - sine * y)[rows + 1, touching[:-1]]
        moved = np.concatenate([[0.0], np.cumsum(reach[:-1] - next_reach)])
        flat = _GRID // 2
        forward = moved - moved[flat]
        return cls(pitch, forward, -height.min(axis=1), np.stack([x[touching], forward + reach], axis=-1))

    def ankle(self, pitch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far forward and up the ankle is at the given pitches [m]."""
        return np.interp(pitch, self.pitch, self.forward), np.interp(pitch, self.pitch, self.up)
