"""Tables that set everything tracked side by side: our trackers, baselines, strangers, radii, and what is missing.

They are rows of text, so that the page and the Markdown say the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.study import paper
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.study_tables import by_algorithm
from mmocap_warp.study.summary import EQ_20, MEASURES, CellSummary, Contender, Measure, StudySummary, in_order
from mmocap_warp.study.tracker_labels import BASELINES, algorithm_label
from mmocap_warp.study.wording import counted, extent, in_unit, listed, named, shown

LOST_LIMB = next(measure for measure in MEASURES if measure.key == "limb_lost")
FITNESS = next(measure for measure in MEASURES if measure.key == "cost")
_DASH = "–"
_HALVES = ("common", "paper-rotation", "paper-translation", "paper")
_POINTS = 5  # of a hundred frames, from which on a difference in lost limbs is told
_BESIDE = ("mpjpe", *EQ_20, "pa_mpjpe", "cost", "iou", "limb_lost", "growth", "shake")


@dataclass(frozen=True)
class TextTable:
    """A table: the first column names its rows.

    Attributes:
        caption: above it.
        head: a title per column.
        rows: texts, as many as the head has.
    """

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


def contenders(study: StudySummary) -> list[Contender]:
    """All that can be compared with the larger model: our trackers, the grid's, the baselines."""
    dof = study.models[0]
    grid = [Contender(name, dof, budget) for name in study.algorithms for budget in study.budgets]
    return [*study.others, *grid, *baseline_contenders(study)]


def baseline_contenders(study: StudySummary) -> list[Contender]:
    """Those that are known."""
    known = {name for _, name in study.baselines}
    return [Contender(name, study.models[0], 0) for name in BASELINES if name in known]


def milliseconds(study: StudySummary, who: Contender) -> float:
    """Of a frame of a run that is tracked alone; NaN where unknown. Solving the body is not in it."""
    for algorithm in (who.algorithm, who.algorithm.replace("+solved", "")):
        seconds = study.alone.get(Contender(algorithm, who.dof, who.evaluations))
        if seconds is not None:
            return 1000 * seconds
    return float("nan")


def level(study: StudySummary, who: Contender, measure: Measure, sequences: Iterable[str]) -> float:
    """Mean of a measure over sequences and runs; NaN unless it is known of every one of them."""
    sequences = list(sequences)
    cells = study.known(who, sequences, measure)
    if not sequences or len(cells) < len(sequences):
        return float("nan")
    return float(np.mean([cell.runs[measure.key].mean() for cell in cells.values()]))


def all_trackers(study: StudySummary) -> TextTable:
    """Every contender that has tracked all sequences, by every measure that tells them apart, the best first."""
    measures = [measure for measure in study.measures if measure.key in _BESIDE]
    main = study.measures[0]
    whole = [who for who in contenders(study) if np.isfinite(level(study, who, main, study.sequences))]
    whole.sort(key=lambda who: (-1 if main.higher_is_better else 1) * level(study, who, main, study.sequences))
    rows, cells = [], []
    for who in whole:
        tracked = study.known(who, study.sequences, main)
        cells += list(tracked.values()) if who.algorithm not in BASELINES else []
        seeds = sorted({len(cell.seeds) for cell in tracked.values()})
        rows.append(
            [
                str(who),
                *(or_dash(level(study, who, measure, study.sequences), measure) for measure in measures),
                _time(milliseconds(study, who)),
                _DASH if who.algorithm in BASELINES else listed(seeds),
            ]
        )
    head = ["Tracker", *(f"{measure.label}{in_unit(measure)}" for measure in measures), "ms a frame, alone", "seeds"]
    return TextTable(
        f"All that has tracked {over(study.sequences)}, best first; mean over the sequences. "
        f"{extent(cells) if cells else ''}. Time: of a single run, where it was measured.",
        head,
        rows,
    )


@dataclass(frozen=True)
class Lead:
    """Our tracker against the best of the grid on a sequence.

    Attributes:
        sequence: which.
        ours, best: the two.
        error: the main measure of either.
        seconds: of a frame of a run that is tracked alone, of either; NaN where unknown.
    """

    sequence: str
    ours: Contender
    best: Contender
    error: tuple[float, float]
    seconds: tuple[float, float]

    @property
    def half(self) -> bool:
        """Whether ours has at most half the error."""
        return self.error[0] <= 0.5 * self.error[1]

    @property
    def timed(self) -> bool:
        """Whether both times are known."""
        return bool(np.isfinite(self.seconds).all())

    @property
    def tenth(self) -> bool:
        """Whether ours takes at most a tenth of the time."""
        return self.seconds[0] <= 0.1 * self.seconds[1]


def leads(study: StudySummary, sequences: Iterable[str]) -> list[Lead]:
    """The first of our trackers against the best of the grid at the largest budget that the sequence was tracked with.

    The best of all models; empty without a tracker of ours.
    """
    main, found = study.measures[0], []
    for sequence in sequences if study.others else ():
        ours = study.others[0]
        rivals = [
            Contender(cell.algorithm, cell.dof, cell.evaluations)
            for cell in study.cells
            if cell.preset == study.preset and cell.sequence == sequence and cell.algorithm in study.algorithms
        ]
        most = max((who.evaluations for who in rivals), default=0)
        of = {who: level(study, who, main, [sequence]) for who in rivals if who.evaluations == most}
        of = {who: value for who, value in of.items() if np.isfinite(value)}
        error = level(study, ours, main, [sequence])
        if not of or not np.isfinite(error):
            continue
        best = min(of, key=lambda who: (-of[who] if main.higher_is_better else of[who], who))
        seconds = milliseconds(study, ours) / 1000, milliseconds(study, best) / 1000
        found.append(Lead(sequence, ours, best, (error, of[best]), seconds))
    return found


def lead_table(study: StudySummary, sequences: Sequence[str]) -> TextTable | None:
    """:func:`leads` with both readings of Eq. 20 beside; None without any."""
    found = leads(study, sequences)
    if not found:
        return None
    main = study.measures[0]
    beside = [measure for measure in study.measures if measure.key in EQ_20]
    rows, cells = [], []
    for lead in found:
        known = [study.find(lead.sequence, who.algorithm, who.dof, who.evaluations) for who in (lead.ours, lead.best)]
        cells += [cell for cell in known if cell is not None]
        values = [
            " / ".join(or_dash(level(study, who, measure, [lead.sequence]), measure) for who in (lead.ours, lead.best))
            for measure in beside
        ]
        rows.append(
            [
                lead.sequence,
                shown(lead.error[0], main),
                f"{shown(lead.error[1], main)} {lead.best}",
                f"{lead.error[0] / lead.error[1]:.2f}",
                "yes" if lead.half else "no",
                *values,
                " / ".join(_time(1000 * seconds) for seconds in lead.seconds),
                ("yes" if lead.tenth else "no") if lead.timed else _DASH,
            ]
        )
    head = [
        "Sequence",
        f"{main.label}{in_unit(main)}",
        "best of the others",
        "ratio",
        "half",
        *(f"{measure.label}{in_unit(measure)}, both" for measure in beside),
        "ms a frame, both",
        "a tenth",
    ]
    label = algorithm_label(found[0].ours.algorithm)
    caption = (
        f"{label}, against the best of the others at its largest budget, on each sequence. {extent(cells)}. Time: of a "
        "single run; solving the body comes to it, once."
    )
    return TextTable(caption, head, rows)


def strangers_table(study: StudySummary, measure: Measure) -> TextTable | None:
    """Everybody on people outside the family of the tracker's bodies; None without any such sequence."""
    rows, cells = [], []
    for who in contenders(study):
        known = study.known(who, study.strangers, measure)
        if known:
            cells += list(known.values()) if who.algorithm not in BASELINES else []
            values = [level(study, who, measure, [name]) for name in study.strangers]
            mean = level(study, who, measure, study.strangers)
            rows.append([str(who), *(or_dash(value, measure) for value in (*values, mean))])
    if not rows or not cells:
        return None
    caption = f"{measure.label}{in_unit(measure)}, mean over runs. {extent(cells)}."
    return TextTable(caption, ["Tracker", *study.strangers, "mean"], rows)


def rank_pairs(study: StudySummary, dof: int) -> TextTable | None:
    """Ranks by the main measure, by fitness and the paper's, side by side; None without fitness or rankings."""
    main = study.measures[0]
    columns: list[tuple[str, dict[str, str]]] = []
    blocks = set()
    for budget in study.budgets:
        for measure in (main, FITNESS):
            ranking = by_algorithm(study, measure, dof, budget)
            if ranking is not None:
                of = {row.contender.algorithm: f"{row.comparison.rank:.3f}" for row in ranking.rows}
                columns.append((f"{budget:,}: {named(measure)}", of))
                blocks.add(len(ranking.sequences))
        printed = paper.printed_ranks(dof, budget)
        if printed and columns and columns[-1][0].startswith(f"{budget:,}:"):
            columns.append((f"{budget:,}: the paper", {name: f"{rank:.3f}" for name, rank in printed.items()}))
    if not blocks or FITNESS not in study.measures or main == FITNESS:
        return None
    rows = [[algorithm_label(name), *(of.get(name, _DASH) for _, of in columns)] for name in study.algorithms]
    over_blocks = " to ".join(str(number) for number in sorted({min(blocks), max(blocks)}))
    caption = (
        f"Average ranks by the error and by the fitness that was searched, {dof} DOF, over {over_blocks} sequences. "
        f"{extent(study.cells[cell] for cell in study.grid if cell.dof == dof)}."
    )
    return TextTable(caption, ["Algorithm", *(title for title, _ in columns)], rows)


def radii_tables(study: StudySummary, measure: Measure) -> list[TextTable]:
    """Presets beside the main one, over the sequences that all of them have; empty with one preset.

    Where some lack sequences, a second table is over all of them, with dashes for what is not whole.
    """
    found = [radii_table(study, measure), radii_table(study, measure, every=True)]
    return [table for place, table in enumerate(found) if table is not None and table not in found[:place]]


def radii_table(study: StudySummary, measure: Measure, *, every: bool = False) -> TextTable | None:
    """One of :func:`radii_tables`: at each budget over the sequences that all presets have, or over every one."""
    others = [cell for cell in study.cells if cell.preset != study.preset and measure.key in study.cells[cell].runs]
    if not others:
        return None
    order = [study.preset, *_HALVES]
    presets = sorted({study.preset, *(cell.preset for cell in others)}, key=lambda name: (_place(order, name), name))
    budgets = sorted({cell.evaluations for cell in others})
    shared = {
        budget: _shared(study, [cell for cell in others if cell.evaluations == budget], every) for budget in budgets
    }
    columns = [(budget, preset) for budget in budgets for preset in presets]
    drawn: list[CellSummary] = []

    def mean(budget: int, preset: str, algorithm: str | None = None) -> float:
        wanted = {
            replace(cell, preset=preset)
            for cell in others
            if (cell.evaluations, cell.sequence) in {(budget, name) for name in shared[budget]}
            and algorithm in (None, cell.algorithm)
        }
        found = [summary for cell in wanted if (summary := study.cells.get(cell)) and measure.key in summary.runs]
        drawn.extend(found)
        complete = found and len(found) == len(wanted)
        return float(np.mean([cell.runs[measure.key].mean() for cell in found])) if complete else float("nan")

    names = in_order(cell.algorithm for cell in others)
    rows = [[algorithm_label(name), *(or_dash(mean(*at, name), measure) for at in columns)] for name in names]
    rows.append(["All", *(or_dash(mean(*at), measure) for at in columns)])
    for who in baseline_contenders(study):
        values = {budget: or_dash(level(study, who, measure, shared[budget]), measure) for budget in budgets}
        rows.append([str(who), *(values[budget] for budget, _ in columns)])
    where = "; ".join(f"{budget:,} evaluations over {over(shared[budget])}" for budget in budgets)
    caption = f"{measure.label}{in_unit(measure)} by evaluations per frame and preset, {where}. {extent(drawn)}."
    return TextTable(caption, ["Algorithm", *(f"{budget:,}: {preset}" for budget, preset in columns)], rows)


def _shared(study: StudySummary, cells: Sequence[Cell], every: bool) -> list[str]:
    """The sequences that all presets and algorithms of these cells have, the main preset's too; or every one."""
    presets, algorithms = {cell.preset for cell in cells} | {study.preset}, {cell.algorithm for cell in cells}
    whole = [
        cell.sequence
        for cell in {replace(cell, preset=study.preset, algorithm="") for cell in cells}
        if all(replace(cell, preset=preset, algorithm=name) in study.cells for preset in presets for name in algorithms)
    ]
    return sorted(set(whole) if whole and not every else {cell.sequence for cell in cells})


def which_half(study: StudySummary) -> list[str]:
    """Which of the paper's two radii loses the limbs, and whose: a sentence per budget with both halves tracked."""
    table = radii_table(study, LOST_LIMB) if LOST_LIMB in study.measures else None
    if table is None:
        return []
    rows = [dict(zip(table.head, row, strict=True)) for row in table.rows if row[0] not in BASELINES.values()]
    sentences = []
    for title in table.head:
        budget, _, preset = title.partition(": ")
        halves = {
            "0.5 rad and 0.02 m": f"{budget}: paper-rotation",
            "0.02 rad and 0.5 m": f"{budget}: paper-translation",
        }
        if preset != study.preset or not all(rows[-1].get(column, _DASH) != _DASH for column in halves.values()):
            continue
        shares = "; ".join(f"{rows[-1][column]} % with {radii}" for radii, column in halves.items())
        shares += f"; {rows[-1].get(f'{budget}: paper', _DASH)} % with 0.5 of both"
        at = [cell for cell in study.cells if cell.preset != study.preset and f"{cell.evaluations:,}" == budget]
        sentence = (
            f"At {budget} evaluations, over {over(_shared(study, at, False))}, a limb is lost in {rows[-1][title]} % "
            f"of the frames with each algorithm’s own radii; {shares}, mean over the algorithms."
        )
        for radii, column in halves.items():
            gained = {row["Algorithm"]: float(row[column]) - float(row[title]) for row in rows[:-1]}
            more = ", ".join(name for name, points in gained.items() if points >= _POINTS) or "none"
            less = ", ".join(name for name, points in gained.items() if points <= -_POINTS) or "none"
            sentence += (
                f" With {radii} limbs are lost in {_POINTS} % more of the frames, or above that: {more}; less: {less}."
            )
        sentences.append(sentence)
    return sentences


def missing(study: StudySummary) -> list[str]:
    """What a study's definition asks for and its results lack: a sentence per preset, model and budget."""
    absent = study.planned - study.cells.keys()
    groups: dict[tuple[str, int, int], list[Cell]] = {}
    for cell in sorted(
        absent, key=lambda cell: (cell.preset != study.preset, cell.preset, -cell.dof, cell.evaluations)
    ):
        groups.setdefault((cell.preset, cell.dof, cell.evaluations), []).append(cell)
    sentences = []
    for (preset, dof, budget), cells in groups.items():
        alike = [cell for cell in study.planned if (cell.preset, cell.dof, cell.evaluations) == (preset, dof, budget)]
        setting = f"{dof} DOF, {budget:,} evaluations, preset {preset}"
        if len(cells) == len(alike):
            sentences.append(f"{setting}: none of {counted(len(alike), 'cell')} was run.")
            continue
        names = in_order(cell.algorithm for cell in cells)
        lacking = {name: {cell.sequence for cell in cells if cell.algorithm == name} for name in names}
        wanted = {name: {cell.sequence for cell in alike if cell.algorithm == name} for name in names}
        which = "; ".join(
            f"{algorithm_label(name)}: {'all' if lacking[name] == wanted[name] else ', '.join(sorted(lacking[name]))}"
            for name in names
        )
        were = "was" if len(cells) == 1 else "were"
        sentences.append(f"{setting}: {len(cells)} of {counted(len(alike), 'cell')} {were} not run ({which}).")
    return sentences


def or_dash(value: float, measure: Measure) -> str:
    """A value of a measure without its unit; a dash where it is unknown."""
    return shown(value, measure) if np.isfinite(value) else _DASH


def over(sequences: Iterable[str]) -> str:
    """How many sequences, named where they are few."""
    names = sorted(sequences)
    return f"{len(names)} sequences" if len(names) > 3 else ", ".join(names)


def _place(order: Sequence[str], name: str) -> int:
    return order.index(name) if name in order else len(order)


def _time(value: float) -> str:
    if not np.isfinite(value):
        return _DASH
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}"
