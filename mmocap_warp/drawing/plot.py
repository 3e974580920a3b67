"""Error against frame, as the paper's Fig. 10, drawn without a plotting library."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mmocap_warp.formats.png import write_png

_WIDTH, _PANEL_HEIGHT = 1200, 340  # [px]
_LEFT, _RIGHT, _TOP, _BOTTOM = 84, 24, 44, 56  # [px], around a panel's axes
_PAPER, _GRID, _INK = (255, 255, 255), (228, 228, 228), (60, 60, 60)
_RUN, _MEDIAN = (215, 185, 160), (150, 75, 0)  # blue, green, red
_SUBPIXEL_BITS = 4

# What the first panel may show, best first: key in a report's series, label.
_ERRORS = (
    ("marker_error_mm", "marker error (Eq. 20) [mm]"),
    ("mpjpe_mm", "mean joint error [mm]"),
    ("cost", "cost"),
)


@dataclass(frozen=True)
class _Axis:
    """Maps values to pixels.

    Attributes:
        low, high: values at the two ends.
        start, stop: their pixels.
        ticks: values that are marked.
    """

    low: float
    high: float
    start: float
    stop: float
    ticks: list[float]

    def pixel(self, value: Any) -> Any:
        """Where a value, or each of an array, lies."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.stop - self.start)


def plot_report(path: str | Path, report: dict[str, Any]) -> None:
    """Plot a report of ``evaluation.evaluate`` against frame: the error where truth is known, else the cost; and IoU.

    Every run is a thin line, their median a thick one; frames without a value are gaps.

    Raises:
        InputError: the name does not end in ``.png``, or its folder cannot be written.
    """
    series = {name: np.array(values, float) for name, values in report["series"].items()}  # None becomes NaN
    known = [(label, series[name]) for name, label in _ERRORS if name in series and np.isfinite(series[name]).any()]
    panels = [*known[:1], ("IoU, mean over views", series["iou"])]
    write_png(path, np.concatenate([_panel(label, series["frame"], values) for label, values in panels]))


def _panel(label: str, frame: np.ndarray, values: np.ndarray) -> np.ndarray:
    """One pair of axes; ``values`` is (run, frame)."""
    canvas = np.full((_PANEL_HEIGHT, _WIDTH, 3), _PAPER, np.uint8)
    x = _axis(frame[0], max(frame[-1], frame[0] + 6), _LEFT, _WIDTH - _RIGHT, tight=True)
    known = values[np.isfinite(values)]
    y = _axis(0.0, float(known.max(initial=0.0)) or 1.0, _PANEL_HEIGHT - _BOTTOM, _TOP, tight=False)
    for tick in y.ticks:
        _line(canvas, [(x.start, y.pixel(tick)), (x.stop, y.pixel(tick))], _GRID, 1)
        _text(canvas, f"{tick:g}", (x.start - 10, y.pixel(tick)), align=1.0)
    for tick in x.ticks:
        _line(canvas, [(x.pixel(tick), y.start), (x.pixel(tick), y.start + 5)], _INK, 1)
        _text(canvas, f"{tick:g}", (x.pixel(tick), y.start + 16), align=0.5)
    _line(canvas, [(x.start, y.start), (x.stop, y.start)], _INK, 1)
    _text(canvas, "frame", ((x.start + x.stop) / 2, y.start + 38), align=0.5)
    _text(canvas, label, (x.start, _TOP / 2), align=0.0)

    middle = _median(values)
    if len(values) > 1:
        for run in values:
            _curve(canvas, x.pixel(frame), y.pixel(run), _RUN, 1)
        _text(canvas, f"{len(values)} runs", (x.stop, _TOP / 2), align=1.0, colour=_darker(_RUN))
        _text(canvas, "median", (x.stop - 70, _TOP / 2), align=1.0, colour=_MEDIAN)
    _curve(canvas, x.pixel(frame), y.pixel(middle), _MEDIAN, 2)
    return canvas


def _axis(low: float, high: float, start: float, stop: float, *, tight: bool) -> _Axis:
    """An axis with about six ticks at 1, 2 or 5 times a power of ten; unless tight, it ends at a tick."""
    raw = (high - low) / 6
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw * 0.999)
    if not tight:
        high = low + step * math.ceil((high - low) / step - 1e-9)
    first = math.ceil(low / step - 1e-9)
    ticks = [step * i for i in range(first, math.floor(high / step + 1e-9) + 1)]
    return _Axis(low, high, start, stop, ticks)


def _median(values: np.ndarray) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice encountered", RuntimeWarning)
        return np.nanmedian(values, axis=0)


def _curve(canvas: np.ndarray, x: np.ndarray, y: np.ndarray, colour: tuple[int, int, int], thickness: int) -> None:
    """A line through the known points; a lone one between gaps is a dot."""
    known = np.isfinite(y)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]])))
    for first, past in ends.reshape(-1, 2):
        points = list(zip(x[first:past], y[first:past], strict=True))
        _line(canvas, points if len(points) > 1 else points * 2, colour, thickness if len(points) > 1 else 4)


def _line(canvas: np.ndarray, points: list[tuple], colour: tuple[int, int, int], thickness: int) -> None:
    fixed = np.rint(np.array(points, float) * (1 << _SUBPIXEL_BITS)).astype(np.int32)
    cv2.polylines(canvas, [fixed], False, colour, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)


def _text(
    canvas: np.ndarray, text: str, place: tuple[float, float], *, align: float, colour: tuple[int, int, int] = _INK
) -> None:
    """Write beside a point, centred vertically; ``align`` 0 starts there, 1 ends there."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    origin = (round(float(place[0]) - align * width), round(float(place[1]) + height / 2))
    cv2.putText(canvas, text, origin, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)


def _darker(colour: tuple[int, int, int]) -> tuple[int, int, int]:
    blue, green, red = (round(0.75 * part) for part in colour)
    return blue, green, red
