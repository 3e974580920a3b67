"""An arm's angles from where its wrist is and where its elbow points: closed form for a body's own bones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import applied, transposed, turn
from mmocap_warp.synthesis.motion.limb_motion import SIGN, basis, rest_axes, rest_place

_FULL_REACH = 0.985  # of the arm's length: elbows stay bent by 20 degrees
_SOFT = 0.12  # from this far before it, a reach is shortened smoothly


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
        """Of both bones [m]."""
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

    def within_reach(self, wrist: np.ndarray) -> np.ndarray:
        """The wrist's places from the shoulder (frame, 3), those near the arm's length and beyond drawn in smoothly."""
        share = np.linalg.norm(wrist, axis=-1, keepdims=True) / self.length
        bound = _FULL_REACH - _SOFT
        return wrist * np.where(share < bound, 1.0, (bound + _SOFT * np.tanh((share - bound) / _SOFT)) / share)

    def _flexion(self, distance: np.ndarray) -> np.ndarray:
        """The elbow's Ry at which the wrist is that far from the shoulder."""
        (gx, gy, gz), (fx, fy, fz) = self.elbow.T @ self.upper, self.fore
        along, across = gx * fx + gz * fz, gx * fz - gz * fx  # upper . elbow Ry(angle) fore = along cos + across sin
        fixed = self.upper @ self.upper + self.fore @ self.fore + 2 * gy * fy
        cosine = np.clip((distance**2 - fixed) / (2 * np.hypot(along, across)), -1.0, 1.0)
        return np.arctan2(across, along) - self.sign * np.arccos(cosine)
