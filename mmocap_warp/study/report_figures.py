"""The report's figures: ranks beside the paper's, Fig. 7's box plots, Fig. 10's curves, error and time by budget."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from mmocap_warp.study import paper
from mmocap_warp.study.summary import CellSummary, Measure, StudySummary
from mmocap_warp.study.svg import Axis, axis, figure, line, number, polyline, text, tick_label
from mmocap_warp.study.tables import Ranking

_WIDTH = 960.0
_LEFT, _RIGHT, _TOP = 58.0, 12.0, 14.0
_CURVE_POINTS = 300
_WHISKER_REACH = 2.0  # in upper quartiles; longer whiskers are cut off and marked


def rank_figure(ranking: Ranking, algorithms: Sequence[str]) -> str:
    """Average ranks with their intervals, beside the paper's where it has them: a line per algorithm."""
    row, top, left, width = 24.0, 30.0, 76.0, 320.0
    bottom = top + row * len(algorithms)
    x = axis(1, max(len(algorithms), 2), left + 14, width - 14, len(algorithms))
    first = ranking.rows[0].contender
    printed = paper.printed_ranks(first.dof, first.evaluations)
    parts = [text((left + 14, 14), f"{first.evaluations:,} evaluations", "head", "start")]
    parts += [text((x.at(tick), bottom + 16), tick_label(tick)) for tick in x.ticks]
    for i, name in enumerate(algorithms):
        y = top + row * (i + 0.5)
        parts.append(text((left - 6, y + 4), paper.ALGORITHM_NAMES[name], "name", "end"))
        parts.append(line((left, y), (width, y), "grid"))
        if name in printed:
            parts.append(_diamond(x.at(printed[name]), y))
        found = ranking.row(name, first.dof, first.evaluations)
        if found is not None:
            low, high = found.rank_interval
            dot = f'<circle class="dot" cx="{number(x.at(found.comparison.rank))}" cy="{number(y)}" r="5"/>'
            parts.append(f'<g class="a-{name}">{line((x.at(low), y), (x.at(high), y), "range")}{dot}</g>')
    label = f"Average rank of each algorithm, {first.dof} DOF, {first.evaluations} evaluations per frame"
    return figure((width, bottom + 22), label, parts)


def box_figure(study: StudySummary, measure: Measure, budget: int, algorithms: Sequence[str]) -> str:
    """Fig. 7: the spread over all frames and runs, by sequence, algorithm and model.

    A box holds the middle half, its line is the median, whiskers reach to minimum and maximum.
    """
    kinds = [(name, dof) for name in algorithms for dof in study.models]
    cells = {
        (sequence, *kind): cell
        for sequence in study.sequences
        for kind in kinds
        if (cell := study.find(sequence, *kind, budget)) is not None and measure.key in cell.spread
    }
    if not cells:
        return ""
    height, bottom = 292.0, 250.0
    y = _spread_axis(list(cells.values()), measure, bottom)
    parts = list(_horizontal_grid(y, _LEFT, _WIDTH - _RIGHT))
    group = (_WIDTH - _LEFT - _RIGHT) / len(study.sequences)
    pitch = min(group * 0.86 / len(kinds), 30.0)
    boxes: dict[tuple[str, int], list[str]] = {kind: [] for kind in kinds}
    medians: dict[tuple[str, int], list[str]] = {kind: [] for kind in kinds}
    for s, sequence in enumerate(study.sequences):
        middle = _LEFT + group * (s + 0.5)
        if s:
            parts.append(line((_LEFT + group * s, _TOP), (_LEFT + group * s, bottom), "grid"))
        subject, _, action = sequence.rpartition("/")
        parts.append(text((middle, bottom + 17), action or sequence))
        parts.append(text((middle, bottom + 32), subject))
        for k, kind in enumerate(kinds):
            cell = cells.get((sequence, *kind))
            if cell is not None:
                centre = middle + (k - (len(kinds) - 1) / 2) * pitch
                box, median = _box(cell.spread[measure.key], y, centre, pitch * 0.72)
                boxes[kind].append(box)
                medians[kind].append(median)
    for name, dof in kinds:
        model = "large" if dof == study.models[0] else "small"
        parts.append(f'<g class="a-{name} {model}"><path class="box" d="{"".join(boxes[name, dof])}"/>')
        parts.append(f'<path class="median" d="{"".join(medians[name, dof])}"/></g>')
    parts.append(_vertical_label(y, _unit_label(measure)))
    names = ", ".join(paper.ALGORITHM_NAMES[name] for name in algorithms)
    return figure((_WIDTH, height), f"{measure.label} of {names} by sequence, {budget} evaluations per frame", parts)


def curve_figure(study: StudySummary, measure: Measure, sequence: str, dof: int, budget: int) -> str:
    """Fig. 10: the median over runs against frame; frames without truth are gaps. Empty where nothing is known."""
    curves = {
        name: cell
        for name in study.algorithms
        if (cell := study.find(sequence, name, dof, budget)) is not None and measure.key in cell.curve
    }
    if not curves:
        return ""
    height, bottom = 300.0, 256.0
    values = np.concatenate([cell.curve[measure.key] for cell in curves.values()])
    low = float(np.nanmin(values)) if measure.higher_is_better else 0.0
    y = axis(low, float(np.nanmax(values)) * (1.0 if measure.higher_is_better else 1.05), bottom, _TOP)
    frames = np.concatenate([cell.frames for cell in curves.values()])
    x = axis(float(frames.min()), float(frames.max()), _LEFT, _WIDTH - _RIGHT, 8)
    parts = list(_horizontal_grid(y, x.start, x.stop))
    parts += [text((x.at(tick), bottom + 17), tick_label(tick)) for tick in x.ticks]
    parts.append(text(((x.start + x.stop) / 2, bottom + 36), "frame", "axis"))
    for name in reversed(curves):  # the best are drawn last, over the others
        frame, curve = _thinned(curves[name].frames, curves[name].curve[measure.key])
        path = polyline([x.at(f) for f in frame], [y.at(v) if np.isfinite(v) else np.nan for v in curve])
        parts.append(f'<path class="curve a-{name}" d="{path}"/>')
    parts.append(_vertical_label(y, _unit_label(measure)))
    label = f"{measure.label} against frame in {sequence}, {dof} DOF, {budget} evaluations per frame"
    return figure((_WIDTH, height), label, parts)


def budget_figure(study: StudySummary, measure: Measure, dof: int) -> str:
    """The mean over sequences and runs against the budget, a curve per algorithm."""
    points = {
        name: [
            (budget, _mean_of([cell.runs[measure.key].mean() for cell in _known(study, measure, name, dof, budget)]))
            for budget in study.budgets
        ]
        for name in study.algorithms
    }
    return _by_budget(study, points, _unit_label(measure), f"{measure.label} by budget, {dof} DOF")


def time_figure(study: StudySummary, dof: int) -> str:
    """Milliseconds per frame and run against the budget, a curve per algorithm."""
    points = {
        name: [
            (budget, _mean_of([1000 * seconds_per_frame(cell) for cell in _all(study, name, dof, budget)]))
            for budget in study.budgets
        ]
        for name in study.algorithms
    }
    return _by_budget(study, points, "ms per frame and run", f"Time per frame by budget, {dof} DOF")


def seconds_per_frame(cell: CellSummary) -> float:
    """Search time of a frame of a run; runs of a cell are tracked together, so this is a share."""
    return cell.seconds / (len(cell.frames) * len(cell.seeds))


def legend(algorithms: Sequence[str]) -> str:
    """Algorithm names with their marks; the script makes buttons of them that single an algorithm out."""
    items = "".join(
        f'<li class="a-{name}"><button type="button" value="{name}" aria-pressed="false" disabled>'
        '<svg viewBox="0 0 28 12" aria-hidden="true"><path class="curve" d="M1 6L27 6"/></svg>'
        f"{escape(paper.ALGORITHM_NAMES[name])}</button></li>"
        for name in algorithms
    )
    return f'<ul class="legend">{items}</ul>'


def _by_budget(study: StudySummary, points: dict[str, list[tuple[int, float]]], unit: str, label: str) -> str:
    width, height, bottom = 470.0, 260.0, 212.0
    known = [value for curve in points.values() for _, value in curve if np.isfinite(value)]
    if not known:
        return ""
    high = max(known)
    low = min(known) - 0.1 * (high - min(known)) if high <= 1.0 else 0.0
    y = axis(low, high * 1.04, bottom, _TOP + 14)
    x = axis(0, study.budgets[-1] * 1.04, _LEFT, width - _RIGHT)
    parts = list(_horizontal_grid(y, x.start, x.stop))
    parts += [text((x.at(budget), bottom + 17), tick_label(budget)) for budget in study.budgets]
    parts.append(text(((x.start + x.stop) / 2, bottom + 36), "evaluations per frame", "axis"))
    for name in reversed(points):
        curve = [(x.at(budget), y.at(value)) for budget, value in points[name] if np.isfinite(value)]
        dots = "".join(f'<circle class="dot" cx="{number(a)}" cy="{number(b)}" r="3.2"/>' for a, b in curve)
        path = polyline([a for a, _ in curve], [b for _, b in curve])
        parts.append(f'<g class="a-{name}"><path class="curve" d="{path}"/>{dots}</g>')
    parts.append(_vertical_label(y, unit))
    return figure((width, height), label, parts)


def _spread_axis(cells: list[CellSummary], measure: Measure, bottom: float) -> Axis:
    """Long enough for every box and for all but the longest whiskers."""
    spread = np.array([cell.spread[measure.key] for cell in cells])
    if measure.higher_is_better:
        high, quartile = spread[:, 4].max(), spread[:, 1].min()
        low = max(spread[:, 0].min(), quartile - (_WHISKER_REACH - 1) * (high - quartile))
    else:
        low, high = 0.0, min(spread[:, 4].max(), _WHISKER_REACH * spread[:, 3].max())
    return axis(float(low), float(high), bottom, _TOP)


def _box(spread: np.ndarray, y: Axis, centre: float, width: float) -> tuple[str, str]:
    """Path data of a box with its whiskers, and of its median."""
    least, lower, median, upper, most = (y.at(value) for value in spread)
    left = centre - width / 2
    box = f"M{number(left)} {number(lower)}h{number(width)}V{number(upper)}h{number(-width)}z"
    whiskers = f"M{number(centre)} {number(lower)}V{number(least)}M{number(centre)} {number(upper)}V{number(most)}"
    if spread[4] > y.high:  # an arrow: it goes on
        whiskers += f"m{number(-width / 2)} 4l{number(width / 2)} -4l{number(width / 2)} 4"
    if spread[0] < y.low:
        whiskers += f"M{number(left)} {number(least - 4)}l{number(width / 2)} 4l{number(width / 2)} -4"
    return box + whiskers, f"M{number(left)} {number(median)}h{number(width)}"


def _thinned(frames: np.ndarray, curve: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The curve's means over a few frames at a time where there are more than a figure can show."""
    step = -(-len(frames) // _CURVE_POINTS)
    if step == 1:
        return frames, curve
    starts = range(0, len(frames), step)
    pieces = [curve[start : start + step] for start in starts]
    means = [float(np.mean(piece[np.isfinite(piece)])) if np.isfinite(piece).any() else np.nan for piece in pieces]
    return frames[::step], np.array(means)


def _horizontal_grid(y: Axis, left: float, right: float) -> Iterator[str]:
    for tick in y.ticks:
        yield line((left, y.at(tick)), (right, y.at(tick)), "grid")
        yield text((left - 8, y.at(tick) + 4), tick_label(tick), anchor="end")


def _vertical_label(y: Axis, label: str) -> str:
    middle = (y.start + y.stop) / 2
    turned = f'transform="rotate(-90 13 {number(middle)})"'
    return f'<text class="axis" x="13" y="{number(middle)}" text-anchor="middle" {turned}>{escape(label)}</text>'


def _unit_label(measure: Measure) -> str:
    return f"{measure.label} [{measure.unit}]" if measure.unit else measure.label


def _diamond(x: float, y: float) -> str:
    return f'<path class="paper" d="M{number(x - 6)} {number(y)}l6 -6 6 6 -6 6z"/>'


def _all(study: StudySummary, algorithm: str, dof: int, budget: int) -> list[CellSummary]:
    found = (study.find(sequence, algorithm, dof, budget) for sequence in study.sequences)
    return [cell for cell in found if cell is not None]


def _known(study: StudySummary, measure: Measure, algorithm: str, dof: int, budget: int) -> list[CellSummary]:
    return [cell for cell in _all(study, algorithm, dof, budget) if measure.key in cell.runs]


def _mean_of(values: list[float]) -> float:
    return float(np.mean(values)) if values else np.nan
