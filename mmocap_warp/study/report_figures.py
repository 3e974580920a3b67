"""The report's figures: ranks beside the paper's, Fig. 7's box plots, Fig. 10's curves, error and time by budget."""

from collections.abc import Callable, Sequence
from html import escape

import numpy as np

from mmocap_warp.display import chart
from mmocap_warp.result.pose_errors import nanmean
from mmocap_warp.study import paper
from mmocap_warp.study.report_parts import Html, fill
from mmocap_warp.study.study_tables import Ranking
from mmocap_warp.study.summary import CellSummary, Contender, Measure, StudySummary, algorithm_label
from mmocap_warp.study.wording import with_unit

_WIDTH = 960.0
_LEFT, _RIGHT, _TOP = 58.0, 12.0, 26.0
_CURVE_POINTS = 120
_TENTHS = 10
_WIDE_SPAN = 8.0  # from the least to the largest value of a figure, from which on its axis is logarithmic
_NAME_HEIGHT, _NAME_WIDTH, _DOT_WIDTH = 15.0, 150.0, 10.0  # of what stands beside each other in a figure
_WHISKER_REACH = 2.0  # in upper quartiles; longer whiskers are cut off and marked


def rank_figure(ranking: Ranking, algorithms: Sequence[str]) -> str:
    """Average ranks with their intervals, beside the paper's where it has them: a line per algorithm."""
    top, width, worst = 24.0, 320.0, max(len(algorithms), 2)
    bottom = top + 24.0 * len(algorithms)
    x = chart.Axis(0.6, worst + 0.4, 76.0, width, tuple(range(1, worst + 1)))
    y = chart.categories([algorithm_label(name) for name in algorithms], top, bottom)
    first = ranking.rows[0].contender
    printed = paper.printed_ranks(first.dof, first.evaluations)
    parts = [chart.text((x.at(1), 14), f"{first.evaluations:,} evaluations", "head", "start"), chart.axes(x, y)]
    for name, row in zip(algorithms, y.ticks, strict=True):
        if name in printed:
            left, middle = chart.number(x.at(printed[name]) - 6), chart.number(y.at(row))
            parts.append(f'<path class="paper" d="M{left} {middle}l6 -6 6 6 -6 6z"/>')
        found = ranking.row(name, first.dof, first.evaluations)
        if found is not None:
            rank = found.comparison.rank
            low, high = ((x.at(end), y.at(row)) for end in np.nan_to_num(found.rank_interval, nan=rank))
            dot = chart.dots(x, y, [(rank, row)], 5)
            parts.append(_marked(name, chart.line(low, high, "range") + dot))
    label = f"Average rank of each algorithm, {first.dof} DOF, {first.evaluations} evaluations per frame"
    return chart.figure((width, bottom + 22), label, parts)


def _marked(name: str, shape: str, kind: str = "") -> str:
    """A shape in an algorithm's colour."""
    return f'<g class="{escape(mark_class(name))}{kind}">{shape}</g>'


def box_figure(study: StudySummary, measure: Measure, title: str, kinds: Sequence[Contender]) -> str:
    """Fig. 7: the spread over all frames and runs, by sequence and contender.

    A box holds the middle half, its line is the median, whiskers reach to minimum and maximum. A rule through a
    sequence is the median of a baseline, where it lies within.
    """

    def spreads(who: Contender) -> dict[str, np.ndarray]:
        known = study.known(who, study.sequences, measure)
        return {name: cell.spread[measure.key] for name, cell in known.items() if measure.key in cell.spread}

    boxes = {who: spreads(who) for who in kinds}
    every = np.array([spread for of in boxes.values() for spread in of.values()])
    if not len(every):
        return ""
    height, bottom = 304.0, 262.0
    # The action, and below it the subject.
    x = chart.categories(["\n".join(name.rpartition("/")[::-2]) for name in study.sequences], _LEFT, _WIDTH - _RIGHT)
    y = _spread_axis(every, measure, bottom)
    parts = [chart.axes(x, y, y_label=measure.title)]
    parts += [chart.line((x.at(s), _TOP), (x.at(s), bottom), "grid") for s in range(1, len(study.sequences))]
    for who in study.baseline_contenders:
        # A rule at the median through each sequence's stretch, where the axis reaches that far.
        levels = {study.sequences.index(name): spread[2] for name, spread in spreads(who).items()}
        ends = [((x.at(i), y.at(at)), (x.at(i + 1), y.at(at))) for i, at in levels.items() if at <= y.high]
        parts.append(_marked(who.algorithm, "".join(chart.line(*both, "curve") for both in ends)))
    pitch = min((x.at(1) - x.at(0)) * 0.86 / len(kinds), 30.0)
    for k, who in enumerate(kinds):
        shift = (k - (len(kinds) - 1) / 2) * pitch
        at = {name: x.at(tick) + shift for name, tick in zip(study.sequences, x.ticks, strict=True)}
        drawn = [chart.box(spread, y, at[name], pitch * 0.72) for name, spread in boxes[who].items()]
        shapes, medians = ("".join(each) for each in zip(*drawn, strict=True)) if drawn else ("", "")
        shape = f'<path class="box" d="{shapes}"/><path class="median" d="{medians}"/>'
        parts.append(_marked(who.algorithm, shape, " large" if who.dof == study.models[0] else " small"))
    return chart.figure((_WIDTH, height), f"{measure.label} of {title} by sequence", parts)


def _drawn_curves(study: StudySummary, dof: int, budget: int) -> list[Contender]:
    """Whose curves are drawn: of our trackers those with the best known body, and the baselines, beside the grid."""
    first: dict[str, Contender] = {}
    for who in study.others:
        if "+polish" not in who.algorithm:
            first.setdefault(who.algorithm.partition("+")[0], who)
    return [*(Contender(name, dof, budget) for name in study.algorithms), *first.values(), *study.baseline_contenders]


def curves_legend(study: StudySummary) -> Html:
    """The names of all curves of :func:`curve_figure` and :func:`growth_figure`."""
    return legend([who.algorithm for who in _drawn_curves(study, 0, 0)])


def curve_figure(study: StudySummary, measure: Measure, sequence: str, dof: int, budget: int) -> str:
    """Fig. 10: the median over runs against frame; frames without truth are gaps. Empty where nothing is known.

    Our trackers and the baselines are drawn as well. The axis is logarithmic where values are far apart.
    """
    points = {}
    for who in _drawn_curves(study, dof, budget):
        for cell in study.known(who, [sequence], measure).values():
            if (values := cell.curve.get(measure.key)) is not None:
                # Where there are more frames than a figure can show, the curve's means over a few at a time.
                step = -(-len(cell.frames) // _CURVE_POINTS)
                means = np.array([nanmean(values[at : at + step], axis=0) for at in range(0, len(values), step)])
                points[who.algorithm] = cell.frames[::step], means, cell.frames[-1]
    if not points.keys() & set(study.algorithms):
        return ""
    first, last = min(numbers[0] for numbers, *_ in points.values()), max(last for *_, last in points.values())
    x = chart.axis(float(first), float(last), _LEFT, _WIDTH - _RIGHT, 8)
    label = f"{measure.label} against frame in {sequence}, {dof} DOF, {budget} evaluations per frame"
    return _curves({name: of[:2] for name, of in points.items()}, measure, x, "frame", label)


def growth_figure(study: StudySummary, measure: Measure, dof: int, budget: int) -> str:
    """The mean over sequences of each tenth of the clips, a curve per tracker; empty where nothing is known."""
    points = {}
    for who in _drawn_curves(study, dof, budget):
        curves = [cell.curve[measure.key] for cell in study.cells_of([who], measure) if measure.key in cell.curve]
        if len(curves) == len(study.sequences) and min(len(values) for values in curves) >= _TENTHS:
            means = [[nanmean(part, axis=0) for part in np.array_split(values, _TENTHS)] for values in curves]
            points[who.algorithm] = np.arange(_TENTHS) * 10.0 + 5, np.mean(means, axis=0)
    if not points.keys() & set(study.algorithms):
        return ""
    x = chart.Axis(0.0, 100.0, _LEFT, _WIDTH - _RIGHT, tuple(range(0, 101, 10)))
    label = f"{measure.label} over the clips, {dof} DOF, {budget} evaluations per frame"
    return _curves(points, measure, x, "share of the clip [%]", label)


def _curves(
    points: dict[str, tuple[np.ndarray, np.ndarray]], measure: Measure, x: chart.Axis, x_label: str, label: str
) -> str:
    """Curves by algorithm, the first drawn last, over the others."""
    height, bottom = 312.0, 268.0
    values = np.concatenate([each for _, each in points.values()])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if measure.higher_is_better:
        y = chart.axis(low, high, bottom, _TOP)
    elif low > 0 and high > _WIDE_SPAN * low:
        y = chart.logarithmic(low * 0.9, high * 1.1, bottom, _TOP)
    else:
        y = chart.axis(0.0, high * 1.05, bottom, _TOP)
    lines = (chart.curve(x, y, zip(*points[key], strict=True), escape(mark_class(key))) for key in reversed(points))
    return chart.figure((_WIDTH, height), label, [chart.axes(x, y, x_label, measure.title), *lines])


def baseline_words(study: StudySummary, measure: Measure) -> str:
    """The baselines' means over the sequences, for figures whose axis does not reach them; empty without any."""
    values = [(who, study.level(who, measure)) for who in study.baseline_contenders]
    return " · ".join(f"{who}: {with_unit(value, measure)}" for who, value in values if np.isfinite(value))


def time_error_figure(study: StudySummary, measure: Measure) -> str:
    """The main measure against a frame's time, of all that has tracked every sequence; empty without times."""
    placed = times_and_errors(study, measure)
    if not placed:
        return ""
    times, errors = np.array([place for places in placed.values() for place in places]).T
    theirs = 1000 * paper.SECONDS_PER_500
    height, top, bottom, right = 430.0, 30.0, 374.0, 14.0
    x = chart.logarithmic(min(times) * 0.7, max(*times, theirs) * 1.5, _LEFT, _WIDTH - right)
    y = chart.logarithmic(min(errors) * 0.8, max(errors) * 1.25, bottom, top)
    parts = [chart.axes(x, y, "ms a frame, one run alone", measure.title)]
    parts.append(chart.line((x.at(theirs), top), (x.at(theirs), bottom), "mark"))
    parts.append(chart.text((x.at(theirs) - 6, bottom - 8), "the paper, 500 evaluations", anchor="end"))
    for name, places in placed.items():
        curve = chart.curve(x, y, places) if len(places) > 1 else ""
        parts.append(_marked(name, curve + chart.dots(x, y, places, 4.5)))
    ours = {name: places for name, places in placed.items() if name not in study.algorithms}
    parts += _names_beside({name: [(x.at(a), y.at(b)) for a, b in places] for name, places in ours.items()})
    words = baseline_words(study, measure)
    parts.append(chart.text((_WIDTH - right, top - 9), f"{words} ↑" if words else "", anchor="end"))
    return chart.figure((_WIDTH, height), f"{measure.label} against time per frame of all trackers", parts)


def times_and_errors(study: StudySummary, measure: Measure) -> dict[str, list[tuple[float, float]]]:
    """By algorithm, a frame's milliseconds and the measure at each budget, where it has tracked every sequence."""
    placed: dict[str, list[tuple[float, float]]] = {}
    for who in study.contenders:
        place = study.milliseconds(who), study.level(who, measure)
        if np.isfinite(place).all():
            placed.setdefault(who.algorithm, []).append(place)
    return placed


def _names_beside(dots_of: dict[str, list[tuple[float, float]]]) -> list[str]:
    """Names by the first dot (x, y) of each algorithm: right of it, left of it or above it, where no other dot is."""
    every = [dot for places in dots_of.values() for dot in places]
    parts, above = [], {"start": np.inf, "end": np.inf, "middle": np.inf}
    first = {name: places[0] for name, places in dots_of.items()}
    for name, (across, height) in sorted(first.items(), key=lambda dot: -dot[1][1]):
        apart = [x - across for x, y in every if abs(y - height) < _NAME_HEIGHT]
        anchor, x, y = "middle", across, height - 13
        if not any(0 < away < _NAME_WIDTH for away in apart):
            anchor, x, y = "start", across + 9, height + 4
        elif not any(_DOT_WIDTH < -away < _NAME_WIDTH for away in apart):  # nearer dots' names are on the left, too
            anchor, x, y = "end", across - 9, height + 4
        above[anchor] = min(y, above[anchor] - _NAME_HEIGHT)  # downwards a name would meet a dot
        parts.append(_marked(name, chart.text((x, above[anchor]), algorithm_label(name), "series", anchor)))
    return parts


def budget_figures(study: StudySummary, measure: Measure, dof: int) -> tuple[str, str]:
    """The mean over sequences and runs, and milliseconds per frame and run, against the budget.

    There is a curve per algorithm, of the mean for those that have tracked all sequences.
    """

    def milliseconds(who: Contender) -> float:
        of = study.of_grid(algorithm=who.algorithm, dof=dof, evaluations=who.evaluations)
        return float(np.mean([1000 * seconds_per_frame(cell) for cell in of])) if of else np.nan

    title = f"{measure.label} by budget, {dof} DOF"
    error = _by_budget(study, dof, lambda who: study.level(who, measure), measure.title, title)
    return error, _by_budget(study, dof, milliseconds, "ms per frame and run", f"Time per frame by budget, {dof} DOF")


def seconds_per_frame(cell: CellSummary) -> float:
    """Search time of a frame of a run; runs of a cell are tracked together, so this is a share."""
    return cell.seconds / (len(cell.frames) * len(cell.seeds))


def legend(algorithms: Sequence[str]) -> Html:
    """Algorithm names with their marks; the script makes buttons of them that single an algorithm out."""
    marks = {name: mark_class(name) for name in algorithms}
    items = [fill("legend-item", mark=mark, name=mark[2:], label=algorithm_label(name)) for name, mark in marks.items()]
    return fill("legend", items=items)


def mark_class(name: str) -> str:
    """The class of an algorithm's marks in figures."""
    return "a-" + name.replace("+", "-")


def _by_budget(study: StudySummary, dof: int, value_of: Callable[[Contender], float], unit: str, label: str) -> str:
    width, height, bottom = 470.0, 258.0, 210.0
    rows = {name: [Contender(name, dof, budget) for budget in study.budgets] for name in study.algorithms}
    values = {name: [(who.evaluations, value_of(who)) for who in row] for name, row in rows.items()}
    points = {name: [point for point in of if np.isfinite(point[1])] for name, of in values.items()}
    known = [value for measured in points.values() for _, value in measured]
    if not known:
        return ""
    high = max(known)
    low = min(known) - 0.1 * (high - min(known)) if high <= 1.0 else 0.0
    y = chart.axis(low, high * 1.04, bottom, _TOP)
    x = chart.Axis(0.0, study.budgets[-1] * 1.04 or 1.0, _LEFT, width - _RIGHT, tuple(study.budgets))
    curves = (_marked(name, chart.curve(x, y, of) + chart.dots(x, y, of)) for name, of in reversed(points.items()))
    return chart.figure((width, height), label, [chart.axes(x, y, "evaluations per frame", unit), *curves])


def _spread_axis(spread: np.ndarray, measure: Measure, bottom: float) -> chart.Axis:
    """Long enough for every box (box, 5) and for all but the longest whiskers."""
    low, high = 0.0, min(spread[:, 4].max(), _WHISKER_REACH * spread[:, 3].max())
    if measure.higher_is_better:
        high, quartile = spread[:, 4].max(), spread[:, 1].min()
        low = max(spread[:, 0].min(), quartile - (_WHISKER_REACH - 1) * (high - quartile))
    return chart.axis(float(low), float(high), bottom, _TOP)
