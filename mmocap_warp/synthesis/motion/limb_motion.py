"""Pose vectors [m, rad] from where bones, chest and head point: closed forms for a body's own bones."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import applied, continuous_zyx_angles, transposed, turn, zyx_angles, zyx_rotation
from mmocap_warp.synthesis.exact_posing import ExactPoser

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
    """A leg's bones in the bind pose, in which its joints carry the body's axes."""

    hip: np.ndarray  # (3,), from the root joint [m]
    thigh: np.ndarray  # (3,), hip to knee [m]
    shank: np.ndarray  # (3,), knee to ankle [m]

    @classmethod
    def of(cls, body: BodyModel, side: str) -> Self:
        """The leg of one side, ``L`` or ``R``."""
        hip, knee, ankle = (rest_place(body, side + name) for name in _LEG)
        return cls(hip - body.joint_rest[0], knee - hip, ankle - knee)

    @property
    def straight(self) -> float:
        """The knee's Rx at which the leg is longest: straight [rad]."""
        along, across = self._knee_terms()
        return float(np.arctan2(across, along))

    def reach(self, flexion: float) -> float:
        """Distance from hip to ankle at a flexion from straight [rad]; [m]."""
        return float(np.linalg.norm(self.thigh + turn("x", self.straight + flexion) @ self.shank))

    def angles(self, hip: np.ndarray, ankle: np.ndarray, pelvis: np.ndarray, sideways: np.ndarray) -> np.ndarray:
        """The hip's Rx, Ry, Rz and the knee's Rx that bring the ankle to its place: (frame, 4) [rad].

        Hip and ankle are (frame, 3) in the world [m], ``pelvis`` (frame, 3, 3) is the world from the root joint's axes,
        and ``sideways`` (frame, 3) is where the knee's hinge points, as nearly as the leg allows. An ankle out of
        reach is a ValueError.
        """
        target = ankle - hip
        # The knee's Rx at which the ankle is that far from the hip.
        distance = np.linalg.norm(target, axis=-1)
        along, across = self._knee_terms()
        fixed = self.thigh @ self.thigh + self.shank @ self.shank + 2 * self.thigh[0] * self.shank[0]
        cosine = (distance**2 - fixed) / (2 * np.hypot(along, across))
        if (cosine > 1).any():
            length = self.reach(0.0)
            raise ValueError(f"an ankle is {distance.max():.3f} m from its hip, the leg is {length:.3f} m long")
        knee = self.straight + np.arccos(cosine)
        leg = self.thigh + applied(turn("x", knee), self.shank)
        thigh = basis(target, sideways) @ transposed(basis(leg, np.broadcast_to(np.eye(3)[0], leg.shape)))
        return np.concatenate([zyx_angles(transposed(pelvis) @ thigh), knee[:, None]], axis=1)

    def _knee_terms(self) -> tuple[float, float]:
        """``a`` and ``b`` of ``thigh . Rx(angle) shank = a cos + b sin + constant``."""
        (_, ty, tz), (_, sy, sz) = self.thigh, self.shank
        return ty * sy + tz * sz, tz * sy - ty * sz


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
    """An arm's bones in the bind pose."""

    sign: float  # 1 of the left arm, -1 of the right
    frame: np.ndarray  # (3, 3), the shoulder's axes from the chest's
    elbow: np.ndarray  # (3, 3), the elbow's axes from the shoulder's; their y is the hinge
    upper: np.ndarray  # (3,), shoulder to elbow, in the shoulder's axes [m]
    fore: np.ndarray  # (3,), elbow to wrist, in the elbow's axes [m]

    @classmethod
    def of(cls, body: BodyModel, side: str) -> Self:
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

        In the world are ``chest`` (frame, 3, 3) from its axes, ``wrist`` (frame, 3) from the shoulder [m], and where
        the elbow ``points`` (frame, 3), as nearly as the line between them allows. A wrist that is out of reach is
        drawn in along that line, to a straight arm.
        """
        # The elbow's Ry at which the wrist is that far from the shoulder.
        (gx, gy, gz), (fx, fy, fz) = self.elbow.T @ self.upper, self.fore
        along, across = gx * fx + gz * fz, gx * fz - gz * fx  # upper . elbow Ry(angle) fore = along cos + across sin
        fixed = self.upper @ self.upper + self.fore @ self.fore + 2 * gy * fy
        distance = np.linalg.norm(wrist, axis=-1)
        cosine = np.clip((distance**2 - fixed) / (2 * np.hypot(along, across)), -1.0, 1.0)
        flexion = np.arctan2(across, along) - self.sign * np.arccos(cosine)
        reached = self.upper + applied(self.elbow @ turn("y", flexion), self.fore)
        hinge = self.sign * np.cross(wrist, points)
        arm = basis(wrist, hinge) @ transposed(basis(reached, np.broadcast_to(self.elbow[:, 1], reached.shape)))
        return self.frame.T @ transposed(chest) @ arm, flexion


BySide = dict[str, np.ndarray]
Bones = dict[str, tuple[np.ndarray, np.ndarray]]
_ELBOW_BIAS = 0.05  # share of down and back in where a straight arm's elbow points
_MOST_STRAIGHT = 0.999  # longest reach as a share of an arm's length: the elbow stays bent by 5 degrees


class Posture:
    """Pose vectors of one body, set part by part: root and legs, then :meth:`bend`, then the arms."""

    def __init__(self, body: BodyModel, frames: int) -> None:
        self._body, self._poser = body, ExactPoser(body, np.eye(3))
        self._legs = {side: Leg.of(body, side) for side in "LR"}
        self._arms = {side: Arm.of(body, side) for side in "LR"}
        self.poses = np.zeros((frames, body.skeleton.coordinates))
        """(frame, 51) full pose vectors."""

    def point_legs(
        self, root: np.ndarray, pelvis: np.ndarray, bones: Bones, hinges: BySide, feet: BySide, least_knee: float
    ) -> None:
        """Set the root (frame, 3) with its axes ``pelvis`` (frame, 3, 3), and the legs by where their bones point.

        By side are the directions (frame, 3) of thigh and shank, those in which the knees' hinges point, as nearly as
        the bones allow, and the axes (frame, 3, 3) of the feet. A knee stays bent by ``least_knee`` [rad].
        """
        ankles = {}
        for side, (thigh, shank) in bones.items():
            leg = self._legs[side]
            down = np.linalg.norm(leg.thigh) * thigh + np.linalg.norm(leg.shank) * shank
            length = np.linalg.norm(down, axis=1, keepdims=True)
            ankles[side] = root + applied(pelvis, leg.hip) + down * np.minimum(1.0, leg.reach(least_knee) / length)
        self._set_legs(root, pelvis, ankles, hinges, feet)

    def bend(self, chest: np.ndarray, head: np.ndarray) -> None:
        """Set the spine, half of its bend at either joint, and the neck; their axes (frame, 3, 3) in the world."""
        for joint, angles in zip(TRUNK, trunk_angles(self._axes("Root"), chest, head), strict=True):
            self._set(joint, angles)

    def point_arm(self, side: str, upper: np.ndarray, fore: np.ndarray) -> None:
        """Set an arm by where its bones point, (frame, 3) in the world; a straight arm's elbow points down and back."""
        arm = self._arms[side]
        wrist = np.linalg.norm(arm.upper) * upper + np.linalg.norm(arm.fore) * fore
        down_and_back = -self._axes("UpperSpine")[:, :, 1] - self._axes("UpperSpine")[:, :, 2]
        bent = np.minimum(1.0, _MOST_STRAIGHT * arm.length / np.linalg.norm(wrist, axis=1, keepdims=True))
        self._set_arm(side, wrist * bent, upper - fore + _ELBOW_BIAS * down_and_back)

    def _set_arm(self, side: str, wrist: np.ndarray, points: np.ndarray) -> None:
        rotation, flexion = self._arms[side].rotations(self._axes("UpperSpine"), wrist, points)
        limits = self._body.skeleton.limits[self._body.skeleton.index(f"{side}Shoulder")].astype(float)
        self._set(f"{side}Shoulder", continuous_zyx_angles(rotation, limits))
        self._set(f"{side}Elbow", about("y", flexion))

    def _set_legs(self, root: np.ndarray, pelvis: np.ndarray, ankles: BySide, hinges: BySide, feet: BySide) -> None:
        self.poses[:, :3] = root
        self._set("Root", zyx_angles(pelvis))
        for side, ankle in ankles.items():
            leg = self._legs[side]
            angles = leg.angles(root + applied(pelvis, leg.hip), ankle, pelvis, hinges[side])
            hip, knee = zyx_rotation(angles[:, :3]), turn("x", angles[:, 3])
            self._set(f"{side}Hip", angles[:, :3])
            self._set(f"{side}Knee", about("x", angles[:, 3]))
            self._set(f"{side}Ankle", zyx_angles(transposed(pelvis @ hip @ knee) @ feet[side]))

    def _set(self, joint: str, angles: np.ndarray) -> None:
        self.poses[:, self._body.skeleton.angles(joint)] = angles

    def _axes(self, joint: str) -> np.ndarray:
        return self._poser.joint_transforms(self.poses)[:, self._body.skeleton.index(joint), :3, :3]
