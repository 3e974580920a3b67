"""A motion that comes with a body, such as an animation of the character's file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Poses of a body at even times, in the body's own space: its root's base is the identity.

    Attributes:
        fps: frames per second.
        pose: (frame, coordinate) float64 [m, rad].
    """

    fps: float
    pose: np.ndarray
