"""Tables that set everything tracked side by side: our trackers, baselines, strangers, radii, and what is missing."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mmocap_warp.study import paper, summary
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.report_parts import Table
from mmocap_warp.study.study_tables import by_algorithm
from mmocap_warp.study.summary import EQ_20, Contender, Measure, StudySummary, algorithm_label, contender, in_order
from mmocap_warp.study.wording import DASH, counted, extent, listed, named, over, shown

LOST_LIMB, FITNESS = summary.MEASURE_OF["limb_lost"], summary.MEASURE_OF["cost"]
_PRESETS = ("common", "paper-rotation", "paper-translation", "paper")  # in the order of their columns
_COMPARED = ("mpjpe", *EQ_20, "pa_mpjpe", "cost", "iou", "limb_lost", "growth", "shake")


def all_trackers(study: StudySummary) -> Table:
    """Every contender that has tracked all sequences, by every measure that tells them apart, the best first."""
    measures = [measure for measure in study.measures if measure.key in _COMPARED]
    main = study.measures[0]
    whole = [who for who in study.contenders if np.isfinite(study.level(who, main))]
    rows, cells = [], []
    for who in sorted(whole, key=lambda who: main.sign * study.level(who, main)):
        tracked = [] if who.algorithm in summary.BASELINES else study.cells_of([who], main)
        cells += tracked
        seeds = listed(sorted({len(cell.seeds) for cell in tracked})) if tracked else DASH
        means = [shown(study.level(who, measure), measure) for measure in measures]
        rows.append([str(who), *means, _time(study.milliseconds(who)), seeds])
    caption = (
        f"All trackers that have tracked {over(study.sequences)}, best first; mean over the sequences. "
        f"{extent(cells) if cells else ''}. Time: of a single run, where it was measured."
    )
    if not whole:
        caption = f"No tracker has tracked all of {over(study.sequences)} yet."
    return Table(caption, ["Tracker", *(each.title for each in measures), "ms a frame, alone", "seeds"], rows)


class Lead(NamedTuple):
    """Our tracker against the best of the grid on a sequence."""

    sequence: str
    ours: Contender
    best: Contender  # of the grid
    error: tuple[float, float]  # of ours and of the best, by the main measure
    seconds: tuple[float, float]  # that a frame of a run takes either of them alone; NaN where unknown
    half: bool  # whether ours has at most half the error
    timed: bool  # whether both times are known
    tenth: bool  # whether ours takes at most a tenth of the time


def leads(study: StudySummary, sequences: Iterable[str]) -> list[Lead]:
    """The best of our trackers against the best of the grid at the largest budget that the sequence was tracked with.

    The best of all models; empty without a tracker of ours.
    """
    main, found = study.measures[0], []
    if not study.others:
        return []
    ours = min(study.others, key=lambda who: np.nan_to_num(main.sign * study.level(who, main), nan=np.inf))
    mine = [cell for cell in study.cells if cell.preset == study.preset and cell.algorithm in study.algorithms]
    for sequence in sequences:
        rivals = [contender(cell) for cell in mine if cell.sequence == sequence]
        most = max((who.evaluations for who in rivals), default=0)
        error = study.level(ours, main, [sequence])
        levels = {who: study.level(who, main, [sequence]) for who in rivals if who.evaluations == most}
        levels = {who: value for who, value in levels.items() if np.isfinite(value)}
        if levels and np.isfinite(error):
            best = min(levels, key=lambda who: (main.sign * levels[who], who))
            seconds = study.milliseconds(ours) / 1000, study.milliseconds(best) / 1000
            timed, tenth = bool(np.isfinite(seconds).all()), seconds[0] <= 0.1 * seconds[1]
            both, half = (error, levels[best]), error <= 0.5 * levels[best]
            found.append(Lead(sequence, ours, best, both, seconds, half, timed, tenth))
    return found


def lead_table(study: StudySummary, sequences: Sequence[str]) -> Table | None:
    """:func:`leads` with both readings of Eq. 20 beside; None without any."""
    found, main = leads(study, sequences), study.measures[0]
    if not found:
        return None
    readings = [measure for measure in study.measures if measure.key in EQ_20]
    rows, cells = [], []
    for lead in found:
        both = (lead.ours, lead.best)
        cells += [cell for who in both for cell in study.known(who, [lead.sequence], main).values()]
        row = [lead.sequence, shown(lead.error[0], main), f"{shown(lead.error[1], main)} {lead.best}"]
        row += [f"{lead.error[0] / lead.error[1]:.2f}", "yes" if lead.half else "no"]
        for measure in readings:
            row.append(" / ".join(shown(study.level(who, measure, [lead.sequence]), measure) for who in both))
        row.append(" / ".join(_time(1000 * seconds) for seconds in lead.seconds))
        rows.append([*row, ("yes" if lead.tenth else "no") if lead.timed else DASH])
    head = ["Sequence", main.title, "best of the others", "ratio", "half"]
    head += [f"{measure.title}, both" for measure in readings] + ["ms a frame, both", "a tenth"]
    caption = (
        f"{algorithm_label(found[0].ours.algorithm)}, against the best of the others at its largest budget, on each "
        f"sequence. {extent(cells)}. Time: of a single run; solving the body takes more, once."
    )
    return Table(caption, head, rows)


def strangers_table(study: StudySummary, measure: Measure) -> Table | None:
    """Everybody on people outside the family of the tracker's bodies; None without any such sequence."""
    rows, cells = [], []
    for who in study.contenders:
        known = study.known(who, study.strangers, measure)
        if known:
            cells += [] if who.algorithm in summary.BASELINES else known.values()
            values = [study.level(who, measure, [name]) for name in study.strangers]
            values.append(study.level(who, measure, study.strangers))
            rows.append([str(who), *(shown(value, measure) for value in values)])
    if not cells:
        return None
    return Table(f"{measure.title}, mean over runs. {extent(cells)}.", ["Tracker", *study.strangers, "mean"], rows)


def rank_pairs(study: StudySummary, dof: int) -> Table | None:
    """Ranks by the main measure, by fitness and the paper's, side by side; None without fitness or rankings."""
    main = study.measures[0]
    columns: list[tuple[str, dict[str, float]]] = []
    blocks = set()
    for budget in study.budgets:
        rankings = [found for each in (main, FITNESS) if (found := by_algorithm(study, each, dof, budget))]
        for ranking in rankings:
            of = {row.contender.algorithm: row.comparison.rank for row in ranking.rows}
            columns.append((f"{budget:,}: {named(ranking.measure)}", of))
            blocks.add(len(ranking.sequences))
        if rankings and (printed := paper.printed_ranks(dof, budget)):
            columns.append((f"{budget:,}: the paper", printed))
    if not blocks or FITNESS not in study.measures or main == FITNESS:
        return None
    ranks = {name: [f"{of[name]:.3f}" if name in of else DASH for _, of in columns] for name in study.algorithms}
    over_blocks = " to ".join(map(str, sorted({min(blocks), max(blocks)})))
    caption = (
        f"Average ranks by the error and by the fitness that was searched, {dof} DOF, over {over_blocks} sequences. "
        f"{extent(study.of_grid(dof=dof))}."
    )
    rows = [[algorithm_label(name), *of] for name, of in ranks.items()]
    return Table(caption, ["Algorithm", *(title for title, _ in columns)], rows)


def radii(study: StudySummary) -> list[str]:
    """Each preset's search radii, as the cells used them, the main preset's first."""
    sentences = []
    for preset in study.presets:
        configs = [each.meta.get("config", {}) for cell, each in study.cells.items() if cell.preset == preset]
        used = [(config.get("rotation_radius"), config.get("translation_radius")) for config in configs]
        known = [pair for pair in used if None not in pair]
        ends = (sorted({min(values), max(values)}) for values in zip(*known, strict=True))
        spans = [" to ".join(f"{end:.3g}" for end in each) for each in ends]
        words = "{} rad and {} m.".format(*spans) if known else "as the software’s documentation says."
        sentences.append(f"{preset}: {words}")
    return sentences


def radii_tables(study: StudySummary, measure: Measure) -> list[Table]:
    """Presets beside the main one, over the sequences that all of them have; empty with one preset.

    Where some lack sequences, a second table is over all of them, with dashes for what is not whole.
    """
    found = [radii_table(study, measure), radii_table(study, measure, every=True)]
    return [table for place, table in enumerate(found) if table is not None and table not in found[:place]]


def radii_table(study: StudySummary, measure: Measure, *, every: bool = False) -> Table | None:
    """One of :func:`radii_tables`: at each budget over the sequences that all presets have, or over every one."""
    others = [cell for cell in study.cells if cell.preset != study.preset and measure.key in study.cells[cell].runs]
    if not others:
        return None
    presets = in_order({study.preset, *(cell.preset for cell in others)}, [study.preset, *_PRESETS])
    budgets = sorted({cell.evaluations for cell in others})
    at_budget = {budget: [cell for cell in others if cell.evaluations == budget] for budget in budgets}
    shared = {budget: shared_sequences(study, cells, every) for budget, cells in at_budget.items()}
    columns, drawn = [(budget, preset) for budget in budgets for preset in presets], []

    def mean(budget: int, preset: str, algorithms: Sequence[str]) -> str:
        """Over the cells that any preset has of the shared sequences; a dash where this preset lacks one."""
        cells = (cell for cell in at_budget[budget] if cell.sequence in shared[budget] and cell.algorithm in algorithms)
        wanted = {replace(cell, preset=preset) for cell in cells}
        found = [known for cell in wanted if (known := study.cells.get(cell)) and measure.key in known.runs]
        drawn.extend(found)
        is_whole = found and len(found) == len(wanted)
        return shown(float(np.mean([cell.runs[measure.key].mean() for cell in found])), measure) if is_whole else DASH

    names = in_order(cell.algorithm for cell in others)
    rows = [[algorithm_label(name), *(mean(*at, [name]) for at in columns)] for name in names]
    rows.append(["All", *(mean(*at, names) for at in columns)])
    for who in study.baseline_contenders:
        rows.append([str(who), *(shown(study.level(who, measure, shared[budget]), measure) for budget, _ in columns)])
    where = "; ".join(f"{budget:,} evaluations over {over(shared[budget])}" for budget in budgets)
    caption = f"{measure.title} by evaluations per frame and preset, {where}. {extent(drawn)}."
    return Table(caption, ["Algorithm", *(f"{budget:,}: {preset}" for budget, preset in columns)], rows)


def shared_sequences(study: StudySummary, cells: Sequence[Cell], every: bool) -> list[str]:
    """The sequences that all presets and algorithms of these cells have, the main preset's too; or every one."""
    presets, algorithms = {cell.preset for cell in cells} | {study.preset}, {cell.algorithm for cell in cells}
    whole = {
        cell.sequence
        for cell in cells
        if all(replace(cell, preset=preset, algorithm=name) in study.cells for preset in presets for name in algorithms)
    }
    return sorted(whole if whole and not every else {cell.sequence for cell in cells})


def missing(study: StudySummary) -> list[str]:
    """What a study's definition asks for and its results lack: a sentence per preset, model and budget."""
    groups: dict[tuple[str, int, int], list[Cell]] = {}
    for cell in study.planned:
        groups.setdefault((cell.preset, cell.dof, cell.evaluations), []).append(cell)
    sentences = []
    order = sorted(groups, key=lambda group: (group[0] != study.preset, group[0], -group[1], group[2]))
    for preset, dof, budget in order:
        planned = groups[preset, dof, budget]
        absent = [cell for cell in planned if cell not in study.cells]
        setting, cells = f"{dof} DOF, {budget:,} evaluations, preset {preset}", counted(len(planned), "cell")
        if absent and len(absent) == len(planned):
            sentences.append(f"{setting}: none of {cells} was run.")
        elif absent:
            which = []
            for name in in_order(cell.algorithm for cell in absent):
                lacking, wanted = ({cell.sequence for cell in of if cell.algorithm == name} for of in (absent, planned))
                which.append(f"{algorithm_label(name)}: {'all' if lacking == wanted else ', '.join(sorted(lacking))}")
            were = "was" if len(absent) == 1 else "were"
            sentences.append(f"{setting}: {len(absent)} of {cells} {were} not run ({'; '.join(which)}).")
    return sentences


def _time(value: float) -> str:
    if not np.isfinite(value):
        return DASH
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}"
