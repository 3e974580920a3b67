"""Values that move as people's hands do: from rest to rest, as smoothly as can be.

Flash and Hogan, *The coordination of arm movements* (J. Neuroscience 5, 1985): a reach follows the path of least jerk,
``s(t) = 10 t^3 - 15 t^4 + 6 t^5``. Flash and Henis (J. Cognitive Neuroscience 3, 1991): a movement that begins before
the last one has ended adds to it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


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
