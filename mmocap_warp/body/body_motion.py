"""A motion that comes with a body, such as an animation of the character's file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mmocap_warp.errors import InputError


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Poses of a body at even times, in the body's own space: its root's base is the identity.

    Attributes:
        fps: frames per second.
        pose: (frame, coordinate) float64 [m, rad].
    """

    fps: float
    pose: np.ndarray


def motion_named(name: str, motions: Mapping[str, BodyMotion], body_file: Path) -> BodyMotion:
    """One of the motions that came with the body of a file.

    Raises:
        InputError: none has that name.
    """
    if name not in motions:
        known = f"name one of {', '.join(motions)}" if motions else "it came without any: give a file instead"
        raise InputError(body_file, f"has no motion '{name}'", known)
    return motions[name]
