"""The paper's Tables 4 to 7 and what belongs to them, as tables that are written as HTML or as Markdown."""

from collections.abc import Callable, Sequence
from html import escape
from itertools import chain, groupby, zip_longest

import numpy as np

from mmocap_warp.study import paper
from mmocap_warp.study.report_parts import Html, Name, Table
from mmocap_warp.study.statistics import ALPHA
from mmocap_warp.study.study_tables import ModelDifference, Ranking, Row
from mmocap_warp.study.summary import BASELINES, CellSummary, Contender, Measure, StudySummary, algorithm_label
from mmocap_warp.study.wording import DASH, counted, extent, interval, p_value, shown, statistic, with_unit

RANK_HEAD = ["Algorithm", "Rank", "p-value"]


def _strong(text: str) -> Html:
    return Html(f"<strong>{escape(text)}</strong>")


def ranking_table(rankings: Sequence[Ranking], caption: str) -> Table:
    """Tables 4 to 7: a column group per ranking with contender, rank and p-value, and Holm's thresholds at the end.

    A p-value is bold where the contender differs significantly from the control.
    """
    foot = ""
    for test in (ranking.test for ranking in rankings):
        words = "one sequence: no test"
        if test is not None:
            sign = ">" if test.statistic > test.critical else "≤"
            words = (
                f"Friedman {test.statistic:.3f} {sign} {test.critical:.3f}, p = {p_value(test.p)}<br>"
                f"Iman–Davenport F = {statistic(test.f)}, p = {p_value(test.f_p)}<br>Kendall’s W = {test.kendall_w:.2f}"
            )
        foot += f'<td colspan="3">{words}</td>'
    head = [*(RANK_HEAD * len(rankings)), "Holm"]
    return Table(caption, head, ranking_rows(rankings, _strong), "ranking", f"{foot}<td></td>")


def ranking_rows(rankings: Sequence[Ranking], strong: Callable[[str], str]) -> list[list[str]]:
    """The rows of rankings side by side; ``strong`` marks what is significant."""

    def cells(row: Row | None) -> list[str]:
        if row is None:
            return ["", "", ""]
        p = p_value(row.comparison.p)
        return [Name(row.contender), f"{row.comparison.rank:.3f}", strong(p) if row.comparison.rejected else p]

    return [
        [*chain.from_iterable(map(cells, rows)), f"{ALPHA / place:.3f}" if place else ""]
        for place, rows in enumerate(zip_longest(*(ranking.rows for ranking in rankings)))
    ]


def effect_table(ranking: Ranking) -> Table:
    """A ranking's intervals, effect sizes and adjusted p-values, and the paper's ranks."""
    first, blocks = ranking.rows[0].contender, len(ranking.sequences)
    caption = f"{first.evaluations:,} evaluations, {ranking.measure.title}, {ranking.seeds} seeds, {blocks} sequences"
    head = ["Algorithm", "Mean", "95 %", "Rank", "95 %", "Holm-adjusted p", "A"]
    rows = [effect_cells(row, ranking.measure) for row in ranking.rows]
    printed = paper.printed_ranks(first.dof, first.evaluations)
    if printed and len({row.contender.algorithm for row in ranking.rows}) > 1:
        head.insert(5, "Rank in the paper")
        for cells, row in zip(rows, ranking.rows, strict=True):
            known = printed.get(row.contender.algorithm)
            cells.insert(5, "" if known is None else f"{known:.3f}")
    return Table(caption, head, rows, "")


def effect_cells(row: Row, measure: Measure) -> list[str]:
    """A contender's mean, rank and their intervals, adjusted p-value and effect size."""
    return [
        str(row.contender),
        shown(row.mean, measure),
        interval(row.mean_interval, measure.decimals),
        f"{row.comparison.rank:.3f}",
        interval(row.rank_interval, 2),
        p_value(row.comparison.adjusted_p),
        "" if np.isnan(row.superiority) else f"{row.superiority:.2f}",
    ]


def unranked_table(study: StudySummary, measure: Measure) -> Table | None:
    """The means of what has no part in a ranking: our trackers and the baselines; None without any."""
    cells = study.cells_of(study.others, measure)
    size = f" {extent(cells)}." if cells else ""
    caption = f"Not ranked, {measure.title}, mean over {len(study.sequences)} sequences.{size}"
    who = [*study.others, *study.baseline_contenders]
    rows = [[str(each), shown(study.level(each, measure), measure)] for each in who]
    return Table(caption, ["Tracker", "Mean"], rows, "") if rows else None


def floor_note(study: StudySummary, measure: Measure, sequences: Sequence[str]) -> str:
    """A sentence on what the tracked bodies score at the true angles; empty where that is unknown."""
    floor = study.floor(measure, sequences)
    if np.isnan(floor):
        return ""
    over = counted(len(sequences), "sequence", in_words=True)
    return f"Floor: at the true angles the tracked bodies score {with_unit(floor, measure)}, mean over {over}."


def sequence_table(study: StudySummary, measure: Measure, budget: int) -> Table:
    """Mean and standard deviation over runs for every sequence, algorithm and model."""
    grid = [Contender(name, dof, budget) for name in study.algorithms for dof in study.models]
    rows = []
    for who in [*grid, *study.others, *study.baseline_contenders]:
        known = study.known(who, study.sequences, measure)
        cells = [_mean_and_deviation(known.get(name), measure) for name in study.sequences]
        # An algorithm's budget is named where the study has several of it beside the grid.
        alike = [other for other in study.others if other.algorithm == who.algorithm]
        label = algorithm_label(who.algorithm) + (f", {who.evaluations:,}" if len(alike) > 1 else "")
        rows.append([label, "" if who.algorithm in BASELINES else str(who.dof), *cells])
    floors = [study.floor(measure, [sequence]) for sequence in study.sequences]
    if np.isfinite(floors).any():
        rows.append(["Floor: at the true angles", "", *(shown(floor, measure) for floor in floors)])
    own = "; our trackers at their own budgets" if study.others else ""
    caption = (
        f"{measure.title}, mean ± standard deviation over runs, {budget:,} evaluations per frame"
        f"{own}. {extent([*study.of_grid(evaluations=budget), *study.cells_of(study.others, measure)])}."
    )
    return Table(caption, ["Algorithm", "DOF", *study.sequences], rows, "sequences")


def _mean_and_deviation(cell: CellSummary | None, measure: Measure) -> str:
    if cell is None:
        return DASH
    runs = cell.runs[measure.key]
    mean = shown(float(runs.mean()), measure)
    return Html(f"{mean} <small>±{shown(float(runs.std(ddof=1)), measure)}</small>") if len(runs) > 1 else mean


def difference_table(differences: Sequence[ModelDifference], measure: Measure, models: Sequence[int]) -> Table:
    """The larger model less the smaller, by algorithm and budget."""
    budgets = sorted({difference.evaluations for difference in differences})
    rows = []
    for algorithm, found in groupby(differences, key=lambda difference: difference.algorithm):
        of = {difference.evaluations: difference for difference in found}
        cells = [cell for budget in budgets for cell in _difference_cells(of.get(budget), measure)]
        rows.append([algorithm_label(algorithm), *cells])
    numbers = sorted({difference.sequences for difference in differences})
    blocks = " to ".join(map(str, dict.fromkeys((numbers[0], numbers[-1]))))
    caption = (
        f"{measure.title} with {models[0]} DOF less that with {models[-1]}, mean over sequences; "
        f"A is the chance that a run with {models[0]} is better; Wilcoxon’s signed-rank test is over the sequences "
        f"({blocks}), two-sided, bold below {ALPHA:g}"
    )
    head = [title for budget in budgets for title in (f"{budget:,}: difference, 95 %", "A", "Wilcoxon p")]
    return Table(caption, ["Algorithm", *head], rows, "differences")


def _difference_cells(difference: ModelDifference | None, measure: Measure) -> list[str]:
    if difference is None:
        return [""] * 3
    text, p = shown(difference.difference, measure, sign=True), p_value(difference.p)
    bounds = interval(difference.interval, measure.decimals)
    amount = _strong(text) if difference.interval[0] * difference.interval[1] > 0 else text
    chance = _strong(p) if difference.p < ALPHA else p
    return [Html(f"{amount} <small>{bounds}</small>"), f"{difference.superiority:.2f}", chance]
