"""The report's sections beyond the paper's: error against time for all trackers, strangers, and the search radii."""

from __future__ import annotations

from html import escape

import numpy as np

from mmocap_warp.display.chart import axes, curve, dots, figure, line, logarithmic, text
from mmocap_warp.study import paper
from mmocap_warp.study.overview import (
    LOST_LIMB,
    TextTable,
    all_trackers,
    contenders,
    lead_table,
    leads,
    level,
    milliseconds,
    over,
    radii_tables,
    strangers_table,
    which_half,
)
from mmocap_warp.study.report_figures import baseline_words, curve_figure, legend, shown_others
from mmocap_warp.study.report_sections import Section, choice
from mmocap_warp.study.report_tables import grid_table
from mmocap_warp.study.summary import Measure, StudySummary
from mmocap_warp.study.tracker_labels import algorithm_label, mark_class
from mmocap_warp.study.wording import counted, extent, listed, named

_WIDTH, _HEIGHT = 960.0, 430.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 14.0, 30.0, 374.0
_LINE = 15.0  # from a name to the next
_WORD = 150.0  # that a name takes across
_DOT = 10.0  # across a dot


def trackers_section(study: StudySummary, measure: Measure) -> Section | None:
    """Error against time, our tracker against the best of the others, and everything in one table.

    None where there is nothing beside the grid.
    """
    drawing = time_error_figure(study, measure) if not measure.higher_is_better else ""
    table = lead_table(study, study.sequences)
    if not drawing and table is None and not study.baselines:
        return None
    parts = []
    if drawing:
        who = [each for each in contenders(study) if each.algorithm in _times_and_errors(study, measure)]
        cells = [cell for each in who for cell in study.known(each, study.sequences, measure).values()]
        caption = (
            f"{measure.label}, mean over {over(study.sequences)}, against the time that a frame takes, both "
            f"logarithmic, {study.models[0]} DOF. {extent(cells)}. Time: a single run at a time on the device, "
            "measured on a part of one sequence, with solving the clip as one problem where contours are fitted; "
            "solving the body comes to it, once a clip. A curve joins an "
            f"algorithm’s budgets ({listed(study.budgets)} evaluations). Rule: the paper’s "
            f"{paper.SECONDS_PER_500:g} s for 500 evaluations on one core, images included. Left out: what has not "
            "tracked every sequence."
        )
        marks = legend([*_times_and_errors(study, measure)])
        parts.append(
            f'<figure><div class="wide">{drawing}</div><figcaption>{escape(caption)}</figcaption>{marks}</figure>'
        )
    if table is not None:
        parts += [f"<p>{escape(lead_sentence(study))}</p>", html_table(table)]
    parts.append(html_table(all_trackers(study)))
    note = (
        "Stands still is the start pose throughout. Constant velocity goes on from it: every coordinate at the speed "
        "that it truly has between the first two frames. Neither looks at a mask, so that their fitness is unknown. "
        "What is not of the paper’s eight has no part in the rankings below."
    )
    return Section("trackers", "Error against time, all trackers", f"<p>{note}</p>", *parts)


def lead_sentence(study: StudySummary) -> str:
    """On how many sequences our tracker has half the best one's error in a tenth of its time."""
    found = leads(study, study.sequences)
    half = [lead for lead in found if lead.half]
    timed = [lead for lead in found if lead.timed]
    fast = [lead for lead in timed if lead.tenth]
    label = algorithm_label(found[0].ours.algorithm)
    sentence = (
        f"{label} has at most half the {named(study.measures[0])} of the best of the others on {len(half)} of "
        f"{counted(len(found), 'sequence')} ({listed(sorted({lead.best.evaluations for lead in found}))} evaluations)"
    )
    if timed:
        sentence += f", and takes at most a tenth of its time on {len(fast)} of {len(timed)}"
    not_half = [lead.sequence for lead in found if not lead.half]
    return f"{sentence}." + (f" Not half of it: {', '.join(not_half)}." if not_half else "")


def strangers_section(study: StudySummary) -> Section | None:
    """People outside the family of the tracker's bodies; None where none was tracked."""
    parts = []
    for measure in study.measures:
        table = strangers_table(study, measure)
        if table is not None:
            parts.append(choice(html_table(table), default=measure == study.measures[0], measure=measure.key))
    main = study.measures[0]
    leading = lead_table(study, study.strangers)
    parts += [html_table(leading)] if leading is not None else []
    for name in study.strangers:
        drawing = curve_figure(study, main, name, study.models[0], study.budgets[0])
        if drawing:
            size = extent(summary for cell, summary in study.cells.items() if cell.sequence == name)
            caption = (
                f"{main.label}, {name}, {study.models[0]} DOF, {study.budgets[0]:,} evaluations per frame. {size}."
            )
            parts.append(
                f'<figure><div class="wide">{drawing}</div><figcaption>{escape(caption)}</figcaption></figure>'
            )
    if not parts:
        return None
    marks = legend([*study.algorithms, *shown_others(study)])
    note = (
        "Sequences of people whom no shape of the tracker’s body comes near. They stand in no ranking and in no mean "
        "over the sequences above."
    )
    return Section("strangers", "People outside the family of bodies", f"<p>{note}</p>", *parts, marks)


def presets_section(study: StudySummary, radii: list[str]) -> Section | None:
    """The other presets beside the main one, by budget; None with one preset."""
    tables = [(measure, table) for measure in study.measures for table in radii_tables(study, measure)]
    if not tables:
        return None
    parts = [f"<p>{escape(' '.join(radii))}</p>", *(f"<p>{escape(each)}</p>" for each in which_half(study))]
    for measure in dict.fromkeys(measure for measure, _ in tables):
        beside = (measure, LOST_LIMB) if measure == study.measures[0] else (measure,)
        content = "".join(html_table(table) for each in beside for of, table in tables if of == each)
        parts.append(choice(content, default=measure == study.measures[0], measure=measure.key))
    return Section("presets", "Search radii", *parts)


def html_table(table: TextTable) -> str:
    """A text table as a figure."""
    return grid_table(table.caption, table.head, table.rows, "compared")


def time_error_figure(study: StudySummary, measure: Measure) -> str:
    """The main measure against a frame's time, of all that has tracked every sequence; empty without times."""
    placed = _times_and_errors(study, measure)
    if not placed:
        return ""
    times, errors = np.array([place for places in placed.values() for place in places]).T
    theirs = 1000 * paper.SECONDS_PER_500
    x = logarithmic(min(times) * 0.7, max(*times, theirs) * 1.5, _LEFT, _WIDTH - _RIGHT)
    y = logarithmic(min(errors) * 0.8, max(errors) * 1.25, _BOTTOM, _TOP)
    unit = f" [{measure.unit}]" if measure.unit else ""
    parts = [axes(x, y, "ms a frame, one run alone", measure.label + unit)]
    parts.append(line((x.at(theirs), _TOP), (x.at(theirs), _BOTTOM), "mark"))
    parts.append(text((x.at(theirs) - 6, _BOTTOM - 8), "the paper, 500 evaluations", anchor="end"))
    for name, places in placed.items():
        shape = f"{curve(x, y, places) if len(places) > 1 else ''}{dots(x, y, places, 4.5)}"
        parts.append(f'<g class="{mark_class(name)}">{shape}</g>')
    ours = {
        name: [(x.at(time), y.at(error)) for time, error in places]
        for name, places in placed.items()
        if name not in study.algorithms
    }
    parts += _names(ours)
    words = baseline_words(study, measure)
    parts.append(text((_WIDTH - _RIGHT, _TOP - 9), f"{words} ↑" if words else "", anchor="end"))
    return figure((_WIDTH, _HEIGHT), f"{measure.label} against time per frame of all trackers", parts)


def _times_and_errors(study: StudySummary, measure: Measure) -> dict[str, list[tuple[float, float]]]:
    """By algorithm, a frame's milliseconds and the measure at each budget, where it has tracked every sequence."""
    placed: dict[str, list[tuple[float, float]]] = {}
    for who in contenders(study):
        place = milliseconds(study, who), level(study, who, measure, study.sequences)
        if np.isfinite(place).all():
            placed.setdefault(who.algorithm, []).append(place)
    return placed


def _names(dots_of: dict[str, list[tuple[float, float]]]) -> list[str]:
    """Names by the first dot (x, y) of each algorithm: right of it, left of it or above it, where no other dot is."""
    every = [dot for places in dots_of.values() for dot in places]
    parts, below = [], {"start": -np.inf, "end": -np.inf, "middle": -np.inf}
    first = [(name, *places[0]) for name, places in dots_of.items()]
    for name, across, height in sorted(first, key=lambda dot: dot[2]):
        apart = [x - across for x, y in every if abs(y - height) < _LINE]
        if not any(0 < away < _WORD for away in apart):
            anchor, x, y = "start", across + 9, height + 4
        elif not any(_DOT < -away < _WORD for away in apart):  # nearer dots' names are on the left, too
            anchor, x, y = "end", across - 9, height + 4
        else:
            anchor, x, y = "middle", across, height - 13
        below[anchor] = max(y, below[anchor] + _LINE)
        word = text((x, below[anchor]), algorithm_label(name), "series", anchor)
        parts.append(f'<g class="{mark_class(name)}">{word}</g>')
    return parts
