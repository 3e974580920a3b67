"""Error against frame, as the paper's Fig. 10, for one result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.display.chart import axes, axis, curve, picture, text
from mmocap_warp.errors import InputError
from mmocap_warp.result.pose_errors import nanmedian
from mmocap_warp.whole_file import write_whole

_WIDTH, _PANEL_HEIGHT = 960.0, 260.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 14.0, 30.0, 46.0  # around a panel's axes

# What the first panel may show, best first: key in a report's series, label.
_ERRORS = (
    ("mpjpe_mm", "MPJPE [mm]"),
    ("eq20_as_printed_mm", "Eq. 20 as printed [mm]"),
    ("marker_error_mm", "Eq. 20 from own first answer [mm]"),
    ("cost", "cost"),
)


def plot_report(path: str | Path, report: dict[str, Any]) -> None:
    """Plot a report of ``evaluation.evaluate`` against frame: the error where truth is known, else the cost; and IoU.

    Every run is a thin line, their median a thick one; frames without a value are gaps.

    Raises:
        InputError: the name does not end in ``.svg``, or its folder cannot be written.
    """
    path = Path(path)
    if path.suffix != ".svg":
        raise InputError(path, "is not an SVG file name", "end it in .svg")
    series = {name: np.array(values, float) for name, values in report["series"].items()}  # None becomes NaN
    known = [(label, series[name]) for name, label in _ERRORS if name in series and np.isfinite(series[name]).any()]
    panels = [
        *((label, values, _over(values)) for label, values in known[:1]),
        ("IoU, mean over views", series["iou"], 1.0),
    ]
    parts = []
    for i, (label, values, high) in enumerate(panels):
        parts += _panel(label, series["frame"], values, high, i * _PANEL_HEIGHT)
    words = f"{' and '.join(label for label, *_ in panels)} against frame"
    write_whole(path, picture((_WIDTH, len(panels) * _PANEL_HEIGHT), words, parts).encode())


def _over(values: np.ndarray) -> float:
    """Where an axis ends that has room for all values."""
    return 1.05 * float(values[np.isfinite(values)].max()) or 1.0


def _panel(label: str, frame: np.ndarray, values: np.ndarray, high: float, top: float) -> list[str]:
    """A pair of axes, up to ``high``, with ``values`` (run, frame)."""
    x = axis(frame[0], max(frame[-1], frame[0] + 6), _LEFT, _WIDTH - _RIGHT, 8)
    y = axis(0.0, high, top + _PANEL_HEIGHT - _BOTTOM, top + _TOP)
    curves = [curve(x, y, zip(frame, nanmedian(values), strict=True))]
    if len(values) > 1:
        curves += [curve(x, y, zip(frame, run, strict=True), "thin") for run in values]
        curves.append(text((x.stop, y.stop - 9), f"median of {len(values)} runs", "series", "end"))
    return [axes(x, y, "frame", label), '<g class="first">', *curves, "</g>"]
