"""Curves of a result as SVG files: joint angles, feet over the floor, and errors by frame (Fig. 10 of the paper)."""

from itertools import count, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.biomechanics.measure_all import Measures
from mmocap_warp.biomechanics.steps import Foot
from mmocap_warp.display.chart import COLOURS, Axis, axes, axis, curve, line, picture, text
from mmocap_warp.errors import InputError
from mmocap_warp.result.pose_errors import nanmedian
from mmocap_warp.whole_file import write_whole

_WIDTH, _LEFT, _RIGHT = 960.0, 46.0, 14.0
_ROW, _TOP, _BOTTOM = 170.0, 30.0, 46.0  # height of a row of panels, and of what is around a panel's axes
_LEGEND = 20.0  # height of the line above the rows
_LEAST_RANGE = 10.0  # least range of an axis of angles, so that what hardly moves looks so [degrees]
_MOST_POINTS = 1000  # points of a curve, at most: more than its panel has pixels
_LEAST_HEIGHT = 100.0  # least range of the axis of the feet's heights [mm]

Curves = dict[str, np.ndarray]  # (frame,) each, by side


def plot_angles(path: Path, measures: Measures) -> None:
    """Write an SVG with a row for each joint and a panel for each of its angles, left and right in one."""
    rows, parts = _by_joint(measures), []
    for number, (joint, panels) in enumerate(rows.items()):
        top, width = _LEGEND + number * _ROW, (_WIDTH - _LEFT - _RIGHT) / len(panels)
        for column, (name, curves) in enumerate(panels.items()):
            left = _LEFT + column * width
            parts.append(_panel(f"{joint}: {name} [°]", measures.seconds, curves, left, left + width - 40, top))
    words = "joint angles against time, left and right"
    write_whole(path, picture((_WIDTH, _LEGEND + len(rows) * _ROW), words, [_legend(), *parts]).encode())


def plot_feet(path: Path, measures: Measures) -> None:
    """Write an SVG with the height of each foot's lowest skin over the floor, and a bar while it stands."""
    feet, seconds = measures.shown.feet, measures.seconds
    x = axis(seconds[0], seconds[-1], _LEFT, _WIDTH - _RIGHT)
    most = max([1000 * float(foot.height.max()) for foot in feet.values()], default=0.0)
    y = axis(-30.0, max(1.05 * most, _LEAST_HEIGHT), _LEGEND + 2 * _ROW - _BOTTOM, _LEGEND + _TOP)
    parts = [_legend(), axes(x, y, "time [s]", "lowest skin over the floor [mm]; bars: on the floor")]
    skeleton = measures.result.subject.body.skeleton
    for number, (name, foot) in enumerate(feet.items()):
        track = _track(x, y, seconds, 1000 * foot.height)
        side = name if name in COLOURS else skeleton.side(name)
        parts.append(f'<g class="{side}">{track}{_bars(foot, seconds, x, y.at(-12.0 - 9.0 * number))}</g>')
    write_whole(path, picture((_WIDTH, _LEGEND + 2 * _ROW), "feet over the floor against time", parts).encode())


def _by_joint(measures: Measures) -> dict[str, dict[str, Curves]]:
    """Angles of the run that is shown, by joint without its side, name and side."""
    skeleton = measures.result.subject.body.skeleton
    both = {left: left[1:] if left[1:] == right[1:] else name for name, left, right in skeleton.pairs}
    both |= {right: both[left] for _, left, right in skeleton.pairs}
    rows: dict[str, dict[str, Curves]] = {}
    for joint, angles in measures.shown.angles.items():
        panels = rows.setdefault(both.get(joint, joint), {})
        for name, angle in angles.items():
            panels.setdefault(name.replace("_", " "), {})[skeleton.side(joint)] = angle
    return rows


def _panel(label: str, seconds: np.ndarray, curves: Curves, left: float, right: float, top: float) -> str:
    known = np.concatenate([angle[np.isfinite(angle)] for angle in curves.values()])
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    room = max(_LEAST_RANGE - (high - low), 0.1 * (high - low)) / 2
    y = axis(low - room, high + room, top + _ROW - _BOTTOM, top + _TOP, 4)
    x = axis(seconds[0], seconds[-1], left, right)
    drawn = [f'<g class="{side}">{_track(x, y, seconds, angle)}</g>' for side, angle in curves.items()]
    return "".join([axes(x, y, "time [s]", label), *drawn])


def _track(x: Axis, y: Axis, seconds: np.ndarray, values: np.ndarray) -> str:
    step = -(-len(seconds) // _MOST_POINTS)
    return curve(x, y, zip(seconds[::step], values[::step], strict=True))


def _bars(foot: Foot, seconds: np.ndarray, x: Axis, height: float) -> str:
    """A line from the first frame of each contact to the first after it."""
    return "".join(
        line((x.at(seconds[start]), height), (x.at(seconds[min(stop, len(seconds) - 1)]), height), "curve")
        for start, stop in pairwise([0, *(1 + np.flatnonzero(np.diff(foot.on_floor))).tolist(), len(seconds)])
        if foot.on_floor[start]
    )


def _legend() -> str:
    """The colours of the sides, above the right end."""
    return "".join(
        f'<g class="{side}">{text((_WIDTH - _RIGHT - back, _LEGEND - 5), side, "series", "end")}</g>'
        for side, back in (("left", 110.0), ("right", 60.0), ("middle", 0.0))
    )


_ERROR_HEIGHT, _ERROR_LEFT = 260.0, 58.0  # of a panel against frame: its height, and the room for the words of y

# What the first panel may show, best first: key in a report's series, label.
_ERRORS = (
    ("mpjpe_mm", "MPJPE [mm]"),
    ("eq20_as_printed_mm", "Eq. 20 as printed [mm]"),
    ("marker_error_mm", "Eq. 20 from own first answer [mm]"),
    ("cost", "cost"),
)
_IOU = "IoU, mean over views"


def plot_report(path: str | Path, report: dict[str, Any]) -> None:
    """Plot a report of ``evaluation.evaluate`` against frame: the error where truth is known, else the cost; and IoU.

    Every run is a thin line, their median a thick one; frames without a value are gaps.
    """
    path = Path(path)
    if path.suffix != ".svg":
        raise InputError(path, "is not an SVG file name", "end it in .svg")
    series = {name: np.array(values, float) for name, values in report["series"].items()}  # None becomes NaN
    known = [(label, series[name]) for name, label in _ERRORS if name in series and np.isfinite(series[name]).any()]
    # A pair of axes for each, with room for all values (run, frame).
    panels, frame, parts = [*known[:1], (_IOU, series["iou"])], series["frame"], []
    for top, (label, values) in zip(count(0.0, _ERROR_HEIGHT), panels):
        high = 1.0 if label == _IOU else 1.05 * float(values[np.isfinite(values)].max()) or 1.0
        x = axis(frame[0], max(frame[-1], frame[0] + 6), _ERROR_LEFT, _WIDTH - _RIGHT, 8)
        y = axis(0.0, high, top + _ERROR_HEIGHT - _BOTTOM, top + _TOP)
        curves = [curve(x, y, zip(frame, nanmedian(values), strict=True))]
        if len(values) > 1:
            curves += [curve(x, y, zip(frame, run, strict=True), "thin") for run in values]
            curves.append(text((x.stop, y.stop - 9), f"median of {len(values)} runs", "series", "end"))
        parts += [axes(x, y, "frame", label), '<g class="first">', *curves, "</g>"]
    words = f"{' and '.join(label for label, _ in panels)} against frame"
    write_whole(path, picture((_WIDTH, len(panels) * _ERROR_HEIGHT), words, parts).encode())
