"""A foot rolling over the floor without sliding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.synthesis.exact_posing import led_by

_STEEPEST = np.radians(75.0)
_GRID = 1201  # 1/8 of a degree apart


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

    def touching(self, pitch: np.ndarray) -> np.ndarray:
        """Where the foot touches the floor at the given pitches, (..., 2) as in ``contact``."""
        return self.contact[np.searchsorted(self.pitch, pitch)]
