"""Steps and strides from the feet's contacts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from mmocap_warp.biomechanics.contacts import Foot

_LEAST_WAY = 0.05  # the way of the root during a step from which its direction is told [m]


@dataclass(frozen=True)
class Step:
    """From a foot's heel strike to the other foot's next one.

    Attributes:
        side: of the foot that lands.
        frame: in which it lands, as a position in the clip.
        seconds: it takes.
        length: from heel to heel, each as it struck, along the root's way meanwhile [m]; NaN where the root stays.
    """

    side: str
    frame: int
    seconds: float
    length: float


@dataclass(frozen=True)
class Stride:
    """From a foot's heel strike to its next one.

    Attributes:
        side: of the foot.
        frame: of the first strike, as a position in the clip.
        seconds: it takes.
        length: between the places where the heel strikes, on the level [m].
        stance_share: of the time in which the foot stands.
    """

    side: str
    frame: int
    seconds: float
    length: float
    stance_share: float


@dataclass(frozen=True)
class Walking:
    """What was seen of somebody's gait; empty where nobody walks."""

    steps: list[Step] = field(default_factory=list)
    strides: list[Stride] = field(default_factory=list)

    @property
    def cadence(self) -> float:
        """Steps per minute; NaN where there is none."""
        return 60.0 / float(np.mean([step.seconds for step in self.steps])) if self.steps else np.nan


def walking(
    feet: dict[str, Foot], heel: dict[str, np.ndarray], root: np.ndarray, seconds: np.ndarray, up: np.ndarray
) -> Walking:
    """Steps and strides that lie whole within the clip; steps of who has two feet alone.

    Args:
        feet: by side, or by name.
        heel: of each, (frame, 3) [m].
        root: (frame, 3) [m].
        seconds: (frame,).
        up: (3,), the world's vertical, of length one.
    """
    level = np.eye(3) - np.outer(up, up)
    heel, root = {side: places @ level for side, places in heel.items()}, root @ level
    strikes = sorted((int(frame), side) for side, foot in feet.items() for frame in foot.strikes)
    steps = [
        Step(side, frame, float(seconds[frame] - seconds[before]), _along(heel[side][frame] - heel[other][before], way))
        for (before, other), (frame, side) in pairwise(strikes)
        if side != other and len(feet) == 2
        for way in [root[frame] - root[before]]
    ]
    strides = [each for side, foot in feet.items() for each in _strides(side, foot, heel[side], seconds)]
    return Walking(steps, strides)


def _along(reach: np.ndarray, way: np.ndarray) -> float:
    length = float(np.linalg.norm(way))
    return float(reach @ way) / length if length >= _LEAST_WAY else np.nan


def _strides(side: str, foot: Foot, heel: np.ndarray, seconds: np.ndarray) -> Iterator[Stride]:
    for first, second in pairwise(foot.strikes):
        off = foot.offs[(foot.offs > first) & (foot.offs < second)][0]
        lasts = float(seconds[second] - seconds[first])
        length = float(np.linalg.norm(heel[second] - heel[first]))
        yield Stride(side, int(first), lasts, length, float(seconds[off] - seconds[first]) / lasts)
