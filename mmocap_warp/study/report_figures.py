"""The report's figures: ranks beside the paper's, Fig. 7's box plots, Fig. 10's curves, error and time by budget."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from mmocap_warp.drawing.chart import Axis, axes, axis, box, categories, curve, dots, figure, line, number, text
from mmocap_warp.study import paper
from mmocap_warp.study.summary import CellSummary, Measure, StudySummary
from mmocap_warp.study.tables import Ranking
from mmocap_warp.study.wording import algorithm_label

_WIDTH = 960.0
_LEFT, _RIGHT, _TOP = 58.0, 12.0, 26.0
_CURVE_POINTS = 300
_WHISKER_REACH = 2.0  # in upper quartiles; longer whiskers are cut off and marked


def rank_figure(ranking: Ranking, algorithms: Sequence[str]) -> str:
    """Average ranks with their intervals, beside the paper's where it has them: a line per algorithm."""
    top, left, width = 24.0, 76.0, 320.0
    bottom = top + 24.0 * len(algorithms)
    worst = max(len(algorithms), 2)
    x = Axis(0.6, worst + 0.4, left, width, tuple(range(1, worst + 1)))
    y = categories([algorithm_label(name) for name in algorithms], top, bottom)
    first = ranking.rows[0].contender
    printed = paper.printed_ranks(first.dof, first.evaluations)
    parts = [text((x.at(1), 14), f"{first.evaluations:,} evaluations", "head", "start"), axes(x, y)]
    for name, row in zip(algorithms, y.ticks, strict=True):
        if name in printed:
            parts.append(_diamond(x.at(printed[name]), y.at(row)))
        found = ranking.row(name, first.dof, first.evaluations)
        if found is not None:
            low, high = ((x.at(end), y.at(row)) for end in found.rank_interval)
            dot = dots(x, y, [(found.comparison.rank, row)], 5)
            parts.append(f'<g class="a-{escape(name)}">{line(low, high, "range")}{dot}</g>')
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
    height, bottom = 304.0, 262.0
    x = categories([_two_lines(sequence) for sequence in study.sequences], _LEFT, _WIDTH - _RIGHT)
    y = _spread_axis(list(cells.values()), measure, bottom)
    parts = [axes(x, y, y_label=_unit_label(measure))]
    parts += [line((x.at(s), _TOP), (x.at(s), bottom), "grid") for s in range(1, len(study.sequences))]
    pitch = min((x.at(1) - x.at(0)) * 0.86 / len(kinds), 30.0)
    for k, (name, dof) in enumerate(kinds):
        shift = (k - (len(kinds) - 1) / 2) * pitch
        drawn = [
            box(cell.spread[measure.key], y, x.at(tick) + shift, pitch * 0.72)
            for tick, sequence in zip(x.ticks, study.sequences, strict=True)
            if (cell := cells.get((sequence, name, dof))) is not None
        ]
        model = "large" if dof == study.models[0] else "small"
        parts.append(
            f'<g class="a-{escape(name)} {model}"><path class="box" d="{"".join(shape for shape, _ in drawn)}"/>'
        )
        parts.append(f'<path class="median" d="{"".join(median for _, median in drawn)}"/></g>')
    names = ", ".join(algorithm_label(name) for name in algorithms)
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
    height, bottom = 312.0, 268.0
    values = np.concatenate([cell.curve[measure.key] for cell in curves.values()])
    low = float(np.nanmin(values)) if measure.higher_is_better else 0.0
    y = axis(low, float(np.nanmax(values)) * (1.0 if measure.higher_is_better else 1.05), bottom, _TOP)
    frames = np.concatenate([cell.frames for cell in curves.values()])
    x = axis(float(frames.min()), float(frames.max()), _LEFT, _WIDTH - _RIGHT, 8)
    parts = [axes(x, y, "frame", _unit_label(measure))]
    for name in reversed(curves):  # the best are drawn last, over the others
        frame, values = _thinned(curves[name].frames, curves[name].curve[measure.key])
        parts.append(curve(x, y, zip(frame, values, strict=True), f"a-{escape(name)}"))
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
        f'<li class="a-{escape(name)}"><button type="button" value="{escape(name)}" aria-pressed="false" disabled>'
        '<svg viewBox="0 0 28 12" aria-hidden="true"><path class="curve" d="M1 6L27 6"/></svg>'
        f"{escape(algorithm_label(name))}</button></li>"
        for name in algorithms
    )
    return f'<ul class="legend">{items}</ul>'


def _by_budget(study: StudySummary, points: dict[str, list[tuple[int, float]]], unit: str, label: str) -> str:
    width, height, bottom = 470.0, 258.0, 210.0
    known = [value for measured in points.values() for _, value in measured if np.isfinite(value)]
    if not known:
        return ""
    high = max(known)
    low = min(known) - 0.1 * (high - min(known)) if high <= 1.0 else 0.0
    y = axis(low, high * 1.04, bottom, _TOP)
    x = Axis(0.0, study.budgets[-1] * 1.04, _LEFT, width - _RIGHT, tuple(study.budgets))
    parts = [axes(x, y, "evaluations per frame", unit)]
    for name in reversed(points):
        measured = [(budget, value) for budget, value in points[name] if np.isfinite(value)]
        parts.append(f'<g class="a-{escape(name)}">{curve(x, y, measured)}{dots(x, y, measured)}</g>')
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


def _two_lines(sequence: str) -> str:
    """The action, and below it the subject."""
    subject, _, action = sequence.rpartition("/")
    return f"{action}\n{subject}"


def _thinned(frames: np.ndarray, curve: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The curve's means over a few frames at a time where there are more than a figure can show."""
    step = -(-len(frames) // _CURVE_POINTS)
    if step == 1:
        return frames, curve
    starts = range(0, len(frames), step)
    pieces = [curve[start : start + step] for start in starts]
    means = [float(np.mean(piece[np.isfinite(piece)])) if np.isfinite(piece).any() else np.nan for piece in pieces]
    return frames[::step], np.array(means)


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
