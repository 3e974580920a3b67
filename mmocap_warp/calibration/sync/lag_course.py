"""How a view's lag changes in the course of a recording: a dropped frame is a jump, another frame rate a slope."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

_LEAST_JUMP, _LEAST_DRIFT = 1.5, 2.5  # [frames] of a change; less is chance
_BETTER = 2.5  # times as far must the lags be from a steady one as from the change
_SIDE = 2  # stretches before and after a jump, at least


@dataclass(frozen=True)
class LagCourse:
    """What became of a view's lag; neither jump nor slope for a steady one.

    Attributes:
        jump: frames by which it changes at once: 1 less for each frame that the camera dropped.
        at: the frame before which it changes.
        slope: the camera's frames more than its rate says, to one of the scene's.
        start: its lag at the scene's frame 0 beyond its offset, where it has a slope [frames].
        scatter: root mean square of the lags about this course [frames].
    """

    jump: int = 0
    at: int = 0
    slope: float = 0.0
    start: float = 0.0
    scatter: float = field(default=0.0, compare=False)

    @property
    def changes(self) -> bool:
        """Whether the lag is not the same all along."""
        return self.jump != 0 or self.slope != 0.0


def lag_course(frame: np.ndarray, lag: np.ndarray) -> LagCourse:
    """What a view's lags in stretches of a recording say.

    Args:
        frame: (stretch,) the scene's frame in their middle, ascending.
        lag: (stretch,) beyond the view's offset [frames].
    """
    steady = _scatter(lag - lag.mean())
    if len(lag) < 2 * _SIDE:
        return LagCourse(scatter=steady)
    slope, start = np.polyfit(frame, lag, 1)
    line = _scatter(lag - start - slope * frame)
    splits = range(_SIDE, len(lag) - _SIDE + 1)
    sides = [(lag[:split], lag[split:]) for split in splits]
    stepped = [_scatter(np.concatenate([side - side.mean() for side in both])) for both in sides]
    best = int(np.argmin(stepped))
    before, after = sides[best]
    jump = float(after.mean() - before.mean())
    if line <= stepped[best]:
        changes = abs(slope) * (frame[-1] - frame[0]) > _LEAST_DRIFT and steady > _BETTER * line
        drift = LagCourse(slope=float(slope), start=float(start), scatter=line)
        return drift if changes else LagCourse(scatter=steady)
    if abs(jump) < _LEAST_JUMP or steady < _BETTER * stepped[best]:
        return LagCourse(scatter=steady)
    split = splits[best]
    return LagCourse(jump=round(jump), at=int(frame[split - 1] + frame[split]) // 2, scatter=stepped[best])


def _scatter(off: np.ndarray) -> float:
    return float(np.sqrt(np.mean(off**2)))
