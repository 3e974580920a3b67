"""The few parts of which the report's figures are made. Colours and type are the style sheet's, so they follow it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np


@dataclass(frozen=True)
class Axis:
    """Maps values to a figure's coordinates, linearly.

    Attributes:
        low, high: values at the two ends.
        start, stop: their coordinates.
        ticks: values that are marked.
    """

    low: float
    high: float
    start: float
    stop: float
    ticks: tuple[float, ...]

    def at(self, value: float) -> float:
        """Where a value lies; what is beyond an end lies on it."""
        share = (min(max(value, self.low), self.high) - self.low) / (self.high - self.low)
        return self.start + share * (self.stop - self.start)


def axis(low: float, high: float, start: float, stop: float, ticks: int = 5) -> Axis:
    """An axis whose ticks are about so many multiples of 1, 2 or 5 times a power of ten."""
    if not high > low:
        high = low + 1.0
    raw = (high - low) / ticks
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return Axis(low, high, start, stop, tuple(round(step * i, 10) for i in range(first, last + 1)))


def figure(size: tuple[float, float], label: str, parts: Iterable[str]) -> str:
    """An ``svg`` element of that width and height, with a label for those who do not see it."""
    width, height = size
    return (
        f'<svg viewBox="0 0 {number(width)} {number(height)}" role="img" aria-label="{escape(label)}">'
        + "".join(parts)
        + "</svg>"
    )


def line(start: tuple[float, float], end: tuple[float, float], name: str) -> str:
    """A straight line of a class."""
    (x1, y1), (x2, y2) = start, end
    return f'<path class="{name}" d="M{number(x1)} {number(y1)}L{number(x2)} {number(y2)}"/>'


def text(place: tuple[float, float], content: str, name: str = "", anchor: str = "middle") -> str:
    """A line of text; ``place`` is on its base line."""
    kind = f' class="{name}"' if name else ""
    x, y = place
    return f'<text x="{number(x)}" y="{number(y)}" text-anchor="{anchor}"{kind}>{escape(content)}</text>'


def polyline(x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray) -> str:
    """Path data through points at whole coordinates; points that are not finite leave a gap."""
    commands, before = [], None
    for at in zip(x, y, strict=True):
        if not (math.isfinite(at[0]) and math.isfinite(at[1])):
            before = None
            continue
        place = round(at[0]), round(at[1])
        if before is None:
            commands.append(f"M{place[0]} {place[1]}l0 0")  # a lone point is a dot
        else:
            commands.append(f"l{place[0] - before[0]} {place[1] - before[1]}")
        before = place
    return "".join(commands).replace(" -", "-")


def outline(contours: Iterable[np.ndarray]) -> str:
    """Path data of closed polygons, each (point, 2)."""
    parts = []
    for contour in contours:
        points = np.rint(contour).astype(int)
        steps = np.diff(points, axis=0)
        moves = "".join(f"l{x} {y}" for x, y in steps.tolist())
        parts.append(f"M{points[0, 0]} {points[0, 1]}{moves}z")
    return "".join(parts).replace(" -", "-")


def number(value: float) -> str:
    """A coordinate, to a tenth."""
    return f"{value:.1f}".removesuffix(".0")


def tick_label(value: float) -> str:
    """A value on an axis."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:g}"
