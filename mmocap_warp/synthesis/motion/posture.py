"""Whole-body poses from what a person minds: where the feet stand, where pelvis, chest and head point, what hands do.

Lengths are in metres and angles in radians, in body axes over a floor at zero: +Y up, +X left, +Z ahead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import applied, continuous_zyx_angles, transposed, turn, zyx_angles, zyx_rotation
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.motion.limb_motion import TRUNK, Arm, Leg, Sole, about, trunk_angles

_ELBOW_BIAS = 0.05
_MOST_STRAIGHT = 0.999  # longest reach as a share of an arm's length: the elbow stays bent by 5 degrees


@dataclass(frozen=True)
class Foot:
    """A foot that stands, rolls over its sole, turns on its toes, or is in the air.

    Attributes:
        place: (frame, 3), on the floor, of the ankle's foot point when the foot is flat.
        yaw: (frame,), about the vertical, from its direction in the bind pose.
        pitch: (frame,), toes up positive.
        lift: (frame,), of the whole foot.
    """

    place: np.ndarray
    yaw: np.ndarray
    pitch: np.ndarray
    lift: np.ndarray

    def axes(self) -> np.ndarray:
        """(frame, 3, 3)."""
        return turn("y", self.yaw) @ turn("x", -self.pitch)

    def ankle(self, sole: Sole) -> np.ndarray:
        """(frame, 3)."""
        forward, up = sole.ankle(self.pitch)
        return self.place + applied(turn("y", self.yaw), np.stack([0 * up, up + self.lift, forward], axis=-1))


class Posture:
    """Pose vectors of one body, set part by part: root and legs, then :meth:`bend`, then the arms."""

    def __init__(self, body: BodyModel, frames: int) -> None:
        self._body = body
        self._poser = ExactPoser(body, np.eye(3))
        self._legs = {side: Leg.of(body, side) for side in "LR"}
        self._soles = {side: Sole.of(body, side) for side in "LR"}
        self._arms = {side: Arm.of(body, side) for side in "LR"}
        self.poses = np.zeros((frames, body.skeleton.coordinates))
        """(frame, 51) full pose vectors."""

    @property
    def arm_length(self) -> float:
        """Shoulder to wrist along the bones, mean of both sides [m]."""
        return (self._arms["L"].length + self._arms["R"].length) / 2

    def stand(self, root: np.ndarray, pelvis: np.ndarray, feet: dict[str, Foot], least_knee: float) -> None:
        """Set the root and the legs.

        Args:
            root: (frame, 3), the root joint; its heights count from the greatest mean height at which no knee is bent
                less than ``least_knee``, so zeros stand tall.
            pelvis: (frame, 3, 3), its axes.
            feet: by side.
            least_knee: flexion from straight [rad].
        """
        ankles = {side: foot.ankle(self._soles[side]) for side, foot in feet.items()}
        room = [self._legs[side].room(root, pelvis, ankle, least_knee) for side, ankle in ankles.items()]
        root = root + np.array([0.0, np.min(room), 0.0])
        axes = {side: foot.axes() for side, foot in feet.items()}
        hinges = {side: turn("y", foot.yaw)[:, :, 0] for side, foot in feet.items()}
        self._set_legs(root, pelvis, ankles, hinges, axes)

    def point_legs(
        self,
        root: np.ndarray,
        pelvis: np.ndarray,
        bones: dict[str, tuple[np.ndarray, np.ndarray]],
        hinges: dict[str, np.ndarray],
        feet: dict[str, np.ndarray],
        least_knee: float,
    ) -> None:
        """Set the root and the legs, these by where their bones point.

        Args:
            root: (frame, 3), the root joint.
            pelvis: (frame, 3, 3), its axes.
            bones: by side, the directions (frame, 3) of thigh and shank.
            hinges: by side, where the knee's hinge points (frame, 3), as nearly as the bones allow.
            feet: by side, their axes (frame, 3, 3).
            least_knee: flexion from straight that a knee keeps [rad].
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

    def place(self, joint: str) -> np.ndarray:
        """(frame, 3), where a joint is, given what has been set so far."""
        return self._transforms(joint)[:, :3, 3]

    def pivoting(self, side: str, foot: Foot) -> Foot:
        """The foot with its places moved so that, as it yaws, it turns about the point that touches the floor."""
        x, z = self._soles[side].touching((foot.pitch[1:] + foot.pitch[:-1]) / 2).T
        turned = np.diff(turn("y", foot.yaw), axis=0)
        moved = np.cumsum(applied(turned, np.stack([x, 0 * x, z], axis=-1)), axis=0)
        return replace(foot, place=foot.place - np.concatenate([np.zeros((1, 3)), moved]))

    def reach(self, side: str, wrist: np.ndarray, points: np.ndarray) -> None:
        """Set an arm by its wrist's place (frame, 3) in the world and where its elbow points (frame, 3).

        A place that is out of reach, or nearly so, is drawn in: the elbow stays bent by 20 degrees.
        """
        from_shoulder = self._arms[side].within_reach(wrist - self.place(f"{side}Shoulder"))
        self._set_arm(side, from_shoulder, points)

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

    def _set_legs(
        self,
        root: np.ndarray,
        pelvis: np.ndarray,
        ankles: dict[str, np.ndarray],
        hinges: dict[str, np.ndarray],
        feet: dict[str, np.ndarray],
    ) -> None:
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
        return self._transforms(joint)[:, :3, :3]

    def _transforms(self, joint: str) -> np.ndarray:
        return self._poser.joint_transforms(self.poses)[:, self._body.skeleton.index(joint)]
