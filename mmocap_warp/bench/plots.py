"""Time against each size, both axes logarithmic, a line for each device and renderer: one SVG file a size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from mmocap_warp.bench.growth import AXES, BATCH, BUDGET, group
from mmocap_warp.bench.tables import Report

_WIDTH, _HEIGHT = 640, 400
_LEFT, _RIGHT, _TOP, _BOTTOM = 76, 108, 40, 52  # around the axes; lines are named on the right
_NAME_HEIGHT = 16  # so that names do not overlap
_COLOURS = {"raycast": "#0b62a8", "raster": "#c2410c"}
_STYLE = (
    "text{font:13px system-ui,sans-serif;fill:#333}.small{font-size:12px;fill:#666}"
    ".grid{stroke:#e2e2e2}.axis{stroke:#888}path{fill:none;stroke-width:2}"
)
_EACH = f"time of an evaluation, of {BATCH['cpu']} in a call on the CPU and {BATCH['cuda']:,} on the GPU"
_TITLES = {
    "candidates": ("time of a call", "candidates in a call"),
    "cameras": (_EACH, "cameras"),
    "pixels": (_EACH, "pixels of a camera, of which the body fills the same share"),
    "triangles": (_EACH, "triangles"),
    "runs": (f"time of a frame of {BUDGET} evaluations a run", "runs at once"),
}


@dataclass(frozen=True)
class Line:
    """Times [s] against a size, of a renderer on a device."""

    device: str
    renderer: str
    is_gpu: bool
    points: list[tuple[float, float]]


def growth_lines(reports: Sequence[Report], axis: str) -> list[Line]:
    """The lines along one of ``AXES``; reports without growth have none. On the CPU, one thread."""
    lines: dict[tuple[str, str], Line] = {}
    for report in reports:
        for row in report["measurements"]:
            if row["group"] != group(axis):
                continue
            key = report["device"], row["sizes"]["renderer"]
            line = lines.setdefault(key, Line(*key, report["kind"] == "cuda", []))
            each = 1 if axis in ("candidates", "runs") else row["evaluations"]
            # One thread's time of the processor is what it took, whatever else the machine did.
            seconds = row["median"] if line.is_gpu else row["processor"]
            line.points.append((row["sizes"][axis], seconds / each))
    return list(lines.values())


def slope(line: Line) -> float:
    """The exponent with which time grows over the last factor of the size."""
    (x0, y0), (x1, y1) = sorted(line.points)[-2:]
    return math.log(y1 / y0) / math.log(x1 / x0)


def growth_plots(reports: Sequence[Report]) -> dict[str, str]:
    """SVG files by the size along their axis."""
    plots = {}
    for axis in AXES:
        lines = growth_lines(reports, axis)
        if lines:
            plots[axis] = _plot(axis, lines)
    return plots


@dataclass(frozen=True)
class _Scale:
    """Maps values to coordinates, evenly in their logarithm."""

    low: float
    high: float
    start: float
    stop: float

    def at(self, value: float) -> float:
        """Where a value lies."""
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return round(self.start + share * (self.stop - self.start), 1)


def _plot(axis: str, lines: list[Line]) -> str:
    sizes = sorted({x for line in lines for x, _ in line.points})
    times = [y for line in lines for _, y in line.points]
    decades = range(math.floor(math.log10(min(times))), math.ceil(math.log10(max(times))) + 1)
    x = _Scale(sizes[0], sizes[-1], _LEFT, _WIDTH - _RIGHT)
    y = _Scale(10.0 ** decades[0], 10.0 ** decades[-1], _HEIGHT - _BOTTOM, _TOP)
    title, below = _TITLES[axis]
    parts = [_text(_LEFT, 22, title, "start"), _text((x.start + x.stop) / 2, _HEIGHT - 12, below, "middle")]
    for decade in decades:
        height = y.at(10.0**decade)
        parts += [_rule(x.start, height, x.stop, height), _text(_LEFT - 8, height + 4, _time(decade), "end", "small")]
    for size in _apart(sizes, x):
        parts += [
            _rule(x.at(size), y.start, x.at(size), y.start + 5, "axis"),
            _text(x.at(size), y.start + 20, f"{size:,}", "middle", "small"),
        ]
    parts.append(_rule(x.start, y.start, x.stop, y.start, "axis"))
    for line, height in _named(lines, y):
        parts.append(_curve(line, x, y))
        parts.append(_text(x.stop + 12, height + 4, line_name(line), "start", "small", _COLOURS[line.renderer]))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" '
        f'height="{_HEIGHT}" role="img" aria-label="{escape(f"{title} against {below}")}"><style>{_STYLE}</style>'
        f'<rect width="100%" height="100%" fill="#fff"/>{"".join(parts)}</svg>\n'
    )


def _apart(sizes: list[float], x: _Scale) -> list[float]:
    """Sizes whose labels do not touch, from the largest down."""
    kept: list[float] = []
    for size in reversed(sizes):
        if not kept or x.at(kept[-1]) - x.at(size) > 8 * max(len(f"{kept[-1]:,}"), len(f"{size:,}")):
            kept.append(size)
    return kept


def _named(lines: list[Line], y: _Scale) -> list[tuple[Line, float]]:
    """Lines from the lowest up, each with the height of its name, at its last point or a little above."""
    named: list[tuple[Line, float]] = []
    for line in sorted(lines, key=lambda line: max(line.points)[1]):
        height = y.at(max(line.points)[1])
        if named:
            height = min(height, named[-1][1] - _NAME_HEIGHT)
        named.append((line, height))
    return named


def line_name(line: Line) -> str:
    """What a line is called."""
    return f"{'GPU' if line.is_gpu else 'CPU'}, {line.renderer}"


def _curve(line: Line, x: _Scale, y: _Scale) -> str:
    points = [(x.at(size), y.at(seconds)) for size, seconds in sorted(line.points)]
    path = "M" + "L".join(f"{a} {b}" for a, b in points)
    dashed = "" if line.is_gpu else ' stroke-dasharray="6 4"'
    colour = _COLOURS[line.renderer]
    dots = "".join(f'<circle cx="{a}" cy="{b}" r="3" fill="{colour}"/>' for a, b in points)
    return f'<path d="{path}" stroke="{colour}"{dashed}/>{dots}'


def _rule(x1: float, y1: float, x2: float, y2: float, kind: str = "grid") -> str:
    return f'<line class="{kind}" x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}"/>'


def _text(x: float, y: float, words: str, anchor: str, kind: str = "", colour: str = "") -> str:
    style = f' style="fill:{colour}"' if colour else ""
    name = f' class="{kind}"' if kind else ""
    return f'<text x="{x}" y="{y}" text-anchor="{anchor}"{name}{style}>{escape(words)}</text>'


def _time(decade: int) -> str:
    """A power of ten of seconds."""
    unit, first = next((u, d) for u, d in (("s", 0), ("ms", -3), ("µs", -6), ("ns", -9)) if decade >= d or d == -9)
    return f"{10 ** (decade - first):,} {unit}"
