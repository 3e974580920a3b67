"""Motions from rest to rest, as smooth as people's: movements of a hand, and key poses with what lies between them.

Flash and Hogan, *The coordination of arm movements* (J. Neuroscience 5, 1985): a reach follows the path of least jerk,
``s(t) = 10 t^3 - 15 t^4 + 6 t^5``. Flash and Henis (J. Cognitive Neuroscience 3, 1991): a movement that begins before
the last one has ended adds to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mmocap_warp.body.model import BodyMotion
from mmocap_warp.body.skeleton import Skeleton


def minimum_jerk(s: np.ndarray) -> np.ndarray:
    """From 0 at ``s`` = 0 to 1 at ``s`` = 1 with the least jerk; level outside."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


@dataclass
class Track:
    """A value over time: a start, and movements that add up.

    Attributes:
        start: (value,) before anything moves.
        moves: beginning [s], duration [s] and change (value,) of each movement.
    """

    start: np.ndarray
    moves: list[tuple[float, float, np.ndarray]] = field(default_factory=list)

    def move(self, begin: float, duration: float, change: np.ndarray | float | tuple[float, ...]) -> None:
        """Add a movement by ``change``."""
        self.moves.append((begin, duration, np.asarray(change, float)))

    def out_and_back(
        self,
        begin: float,
        out: float,
        hold: float,
        back: float,
        change: np.ndarray | float | tuple[float, ...],
    ) -> None:
        """Add a movement by ``change`` that takes ``out`` seconds, and after ``hold`` one back that takes ``back``."""
        self.move(begin, out, change)
        self.move(begin + out + hold, back, -np.asarray(change, float))

    def at(self, time: np.ndarray) -> np.ndarray:
        """(time, value) at times [s]."""
        value = np.tile(np.atleast_1d(np.asarray(self.start, float)), (len(time), 1))
        for begin, duration, change in self.moves:
            value += minimum_jerk((time - begin) / duration)[:, None] * change
        return value


def sway(time: np.ndarray, rates: tuple[float, ...], rng: np.random.Generator) -> np.ndarray:
    """(time,) a wandering value of variance 1: waves of the given rates [Hz], slow ones larger, with random phases."""
    size = 1.0 / np.sqrt(rates)
    phase = rng.uniform(0, 2 * np.pi, len(rates))
    waves = np.sin(2 * np.pi * np.multiply.outer(time, rates) + phase)
    return waves @ size / np.sqrt((size**2).sum() / 2)


KeyPose = tuple[float, dict[str, float]]
"""When it is reached [s], and the coordinates that change until then, by name [m, degrees]; others stay."""


def through_poses(skeleton: Skeleton, keys: Sequence[KeyPose], fps: float) -> BodyMotion:
    """A motion that rests in each of its key poses; it begins with the first and ends with the last.

    Args:
        skeleton: whose coordinates the keys name; what no key names stays zero.
        keys: in order; the first is at zero seconds.
        fps: frames per second.

    Raises:
        ValueError: times that do not ascend from zero, or a coordinate that there is not.
    """
    seconds = [at for at, _ in keys]
    if seconds[0] != 0 or (np.diff(seconds) <= 0).any():
        raise ValueError(f"keys must be at ascending times from 0, got {seconds}")
    reached = [np.zeros(skeleton.coordinates)]
    for _, changed in keys:
        unknown = sorted(set(changed) - set(skeleton.coordinate_names))
        if unknown:
            raise ValueError(f"keys name coordinates {unknown} that this skeleton does not have")
        pose = reached[-1].copy()
        for name, value in changed.items():
            number = skeleton.coordinate_names.index(name)
            pose[number] = value if skeleton.is_length[number] else np.radians(value)
        reached.append(pose)
    reached = reached[1:]
    time = np.arange(round(seconds[-1] * fps) + 1) / fps
    poses = np.tile(reached[0], (len(time), 1))
    for i in range(1, len(keys)):
        share = minimum_jerk((time - seconds[i - 1]) / (seconds[i] - seconds[i - 1]))
        poses += share[:, None] * (reached[i] - reached[i - 1])
    return BodyMotion(fps, poses)
