"""Cameras' parameters in the units that people read."""

from __future__ import annotations

import math

UNITS: dict[str, tuple[str, float]] = {
    "tilt": ("deg", 180.0 / math.pi),
    "pan": ("deg", 180.0 / math.pi),
    "roll": ("deg", 180.0 / math.pi),
    "right": ("mm", 1000.0),
    "down": ("mm", 1000.0),
    "ahead": ("mm", 1000.0),
    "focal": ("%", 100.0),
    "centre_x": ("px", 1.0),
    "centre_y": ("px", 1.0),
    "offset": ("ms", 1000.0),
}
"""What each of ``camera_changes.KINDS`` is shown in, and how many of that are its own unit."""


def in_units(kind: str, value: float, scale: float = 1.0) -> tuple[float, str]:
    """A parameter's value and its unit; pixels of images at ``scale`` become those of the calibrated ones."""
    unit, size = UNITS[kind]
    return float(value) * size / (scale if unit == "px" else 1.0), unit
