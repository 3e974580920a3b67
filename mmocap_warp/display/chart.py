"""Charts as SVG: axes, curves, boxes, and the words on them.

A part is a piece of SVG text, and a figure joins parts. Colours and type are CSS. ``MARKS`` says how parts look; it
uses variables that a page with figures sets: ``--paper``, ``--ink``, ``--soft``, ``--rule``, ``--sans``, and for each
series ``--c``, its colour. A picture that is a file of its own carries its style in it, for light and dark.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

import numpy as np

COLOURS = {
    "left": ("#007f5b", "#3cc296"),
    "right": ("#b84c00", "#ff8a3c"),
    "middle": ("#1b1f24", "#f5f5f5"),
    "mask": ("#ffd21f", "#ffd21f"),
    "model": ("#4aa3dc", "#4fb8f5"),
    "deviations": ("#b5179e", "#ff5cf0"),
    "truth": ("#6a3fc9", "#b79cff"),
}
"""What has one colour in videos, sheets, pages and plots: on white, and on black, where pictures are.

Readers who do not tell red from green see left and right apart, as a bluish green and an orange.
"""


def colour_rules(scope: str) -> str:
    """CSS that sets the variables ``--left`` and so on of what ``scope`` selects, for light and dark."""
    light, dark = ("".join(f"--{name}:{both[i]};" for name, both in COLOURS.items()) for i in range(2))
    return f"{scope}{{{light}}}\n@media(prefers-color-scheme:dark){{{scope}{{{dark}}}}}\n"


_STYLES = files("mmocap_warp.display")
MARKS = (_STYLES / "chart_marks.css").read_text(encoding="utf-8")  # how parts look by their class
# What a picture on its own needs beside MARKS.
_ALONE = colour_rules("svg") + (_STYLES / "chart_alone.css").read_text(encoding="utf-8")

_LINE = 15.0  # distance from a line of words to the next
_DIGIT = 8.0  # width of a digit on an axis, with the room around it

Place = tuple[float, float]


@dataclass(frozen=True)
class Axis:
    """Maps values to a figure's coordinates, evenly or evenly in their logarithm."""

    low: float  # value at one end
    high: float  # value at the other end
    start: float  # coordinate of ``low``
    stop: float  # coordinate of ``high``
    ticks: tuple[float, ...]  # values that are marked
    # How a tick is written.
    word: Callable[[float], str] = lambda value: f"{value:,.0f}" if abs(value) >= 1000 else f"{value:g}"
    logarithmic: bool = False  # whether the axis is
    kind: str = ""  # the class of its words: ``name`` where they are names of things, not values

    def at(self, value: float) -> float:
        """The coordinate of a value; a value beyond an end lies on the end, and NaN gives NaN."""
        low, high, value = (math.log(v) if self.logarithmic else v for v in (self.low, self.high, value))
        share = (min(max(value, low), high) - low) / (high - low)
        return self.start + share * (self.stop - self.start)


def axis(low: float, high: float, start: float, stop: float, ticks: int = 5) -> Axis:
    """An axis with about so many ticks, at multiples of 1, 2 or 5 times a power of ten."""
    if not high > low:
        high = low + 1.0
    raw = (high - low) / ticks
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return Axis(low, high, start, stop, tuple(round(step * i, 10) for i in range(first, last + 1)))


def logarithmic(low: float, high: float, start: float, stop: float) -> Axis:
    """A logarithmic axis from ``low`` to ``high``, both above zero; 1, 2 and 5 times the powers of ten are marked."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = (float(f"{factor}e{power}") for power in exponents for factor in (1, 2, 5))
    marked = tuple(tick for tick in ticks if low * 0.999 <= tick <= high * 1.001)
    return Axis(low, high, start, stop, marked, logarithmic=True)


def categories(names: Sequence[str], start: float, stop: float) -> Axis:
    """An axis of equal stretches, from 0 to 1, 1 to 2 and so on, with a name in the middle of each."""
    ticks = tuple(i + 0.5 for i in range(len(names)))
    return Axis(0.0, len(names), start, stop, ticks, lambda value: names[int(value)], kind="name")


def axes(x: Axis, y: Axis, x_label: str = "", y_label: str = "") -> str:
    """Both axes: rules across at the ticks of y with their words on the left, the words of x below.

    The labels stand under x and over y. Words of x have several lines where they have line breaks; words that would
    touch those of a larger value are left out.
    """
    bottom, top = max(y.start, y.stop), min(y.start, y.stop)
    parts = []
    for tick in y.ticks:
        parts.append(line((x.start, y.at(tick)), (x.stop, y.at(tick)), "grid"))
        parts.append(text((x.start - 8, y.at(tick) + 4), y.word(tick), y.kind, "end"))
    lines = 1
    for tick in _separate_ticks(x):
        rows = x.word(tick).split("\n")
        parts += [text((x.at(tick), bottom + 17 + _LINE * i), row, x.kind) for i, row in enumerate(rows)]
        lines = max(lines, len(rows))
    if x_label:
        parts.append(text(((x.start + x.stop) / 2, bottom + 21 + _LINE * lines), x_label))
    if y_label:
        parts.append(text((x.start, top - 9), y_label, anchor="start"))
    return "".join(parts)


def _separate_ticks(x: Axis) -> list[float]:
    """Ticks whose words do not touch, from the largest down; names are all kept."""
    kept: list[float] = []
    for tick in sorted(x.ticks, reverse=True):
        width = max(len(x.word(value)) for value in (tick, *kept[-1:]))
        if not kept or x.kind == "name" or x.at(kept[-1]) - x.at(tick) > _DIGIT * width:
            kept.append(tick)
    return kept[::-1]


def curve(x: Axis, y: Axis, points: Iterable[Place], kind: str = "") -> str:
    """A line through values, with a gap where one is not finite."""
    places = np.array([(x.at(a), y.at(b)) for a, b in points]).reshape(-1, 2)
    return f'<path class="{f"curve {kind}".rstrip()}" d="{polyline(*places.T)}"/>'


def dots(x: Axis, y: Axis, points: Iterable[Place], radius: float = 3.2) -> str:
    """A dot at each of the values."""
    places = ((number(x.at(a)), number(y.at(b))) for a, b in points)
    return "".join(f'<circle class="dot" cx="{a}" cy="{b}" r="{number(radius)}"/>' for a, b in places)


def box(spread: Sequence[float] | np.ndarray, y: Axis, centre: float, width: float) -> tuple[str, str]:
    """Path data of a box of some ``centre`` and ``width`` with its whiskers, and of its median, on the axis ``y``.

    Its ``spread`` is minimum, lower quartile, median, upper quartile and maximum. A whisker that leaves the axis ends
    in an arrow.
    """
    least, lower, median, upper, most = (y.at(value) for value in spread)
    left, half = centre - width / 2, number(width / 2)
    shape = f"M{number(left)} {number(lower)}h{number(width)}V{number(upper)}h{number(-width)}z"
    whiskers = f"M{number(centre)} {number(lower)}V{number(least)}M{number(centre)} {number(upper)}V{number(most)}"
    if spread[4] > y.high:
        whiskers += f"m-{half} 4l{half} -4l{half} 4"
    if spread[0] < y.low:
        whiskers += f"M{number(left)} {number(least - 4)}l{half} 4l{half} -4"
    return shape + whiskers, f"M{number(left)} {number(median)}h{number(width)}"


def figure(size: tuple[float, float], label: str, parts: Iterable[str], attributes: str = "") -> str:
    """An ``svg`` element of that width and height, with a label for those who do not see it."""
    width, height = size
    head = f'viewBox="0 0 {number(width)} {number(height)}" role="img" aria-label="{escape(label)}"{attributes}'
    return f"<svg {head}>{''.join(parts)}</svg>"


def picture(size: tuple[float, float], label: str, parts: Iterable[str]) -> str:
    """A figure that is a file of its own."""
    width, height = (number(extent) for extent in size)
    alone = f' xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}"'
    background = f'<style>\n{_ALONE}{MARKS}</style><rect width="100%" height="100%"/>'
    return figure(size, label, [background, *parts], alone) + "\n"


def line(start: Place, end: Place, kind: str) -> str:
    """A straight line of a class."""
    (x1, y1), (x2, y2) = start, end
    return f'<path class="{kind}" d="M{number(x1)} {number(y1)}L{number(x2)} {number(y2)}"/>'


def text(place: Place, content: str, kind: str = "", anchor: str = "middle") -> str:
    """A line of text; ``place`` is on its base line."""
    name = f' class="{kind}"' if kind else ""
    x, y = place
    return f'<text x="{number(x)}" y="{number(y)}" text-anchor="{anchor}"{name}>{escape(content)}</text>'


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
        moves = "".join(f"l{x} {y}" for x, y in np.diff(points, axis=0).tolist())
        parts.append(f"M{points[0, 0]} {points[0, 1]}{moves}z")
    return "".join(parts).replace(" -", "-")


def number(value: float) -> str:
    """A coordinate, to a tenth."""
    return f"{value:.1f}".removesuffix(".0")
