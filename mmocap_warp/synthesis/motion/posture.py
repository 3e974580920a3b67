"""Whole-body poses from what a person minds: where the feet stand, where pelvis, chest and head point, what hands do.

Lengths are in metres and angles in radians, in body axes over a floor at zero: +Y up, +X left, +Z ahead.
"""

from __future__ import annotations

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import applied, continuous_zyx_angles, transposed, turn, zyx_angles, zyx_rotation
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.motion.limb_motion import TRUNK, Arm, Leg, Sole, about, trunk_angles

_ELBOW_BIAS = 0.05
_MOST_STRAIGHT = 0.999  # longest reach as a share of an arm's length: the elbow stays bent by 5 degrees


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
