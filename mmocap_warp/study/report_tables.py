"""The report's tables: the layout of the paper's Tables 4 to 7, and what the paper does not print beside them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from itertools import groupby

import numpy as np

from mmocap_warp.study import paper
from mmocap_warp.study.overview import baseline_contenders, level, or_dash
from mmocap_warp.study.statistics import ALPHA, Omnibus
from mmocap_warp.study.study_tables import ModelDifference, Ranking, Row
from mmocap_warp.study.summary import CellSummary, Contender, Measure, StudySummary
from mmocap_warp.study.tracker_labels import BASELINES, algorithm_label
from mmocap_warp.study.wording import extent, in_unit, interval, p_value, shown, spelled, statistic, with_unit


def ranking_table(rankings: Sequence[Ranking], caption: str) -> str:
    """Tables 4 to 7: a column group per ranking with contender, rank and p-value, and Holm's thresholds at the end.

    A p-value is bold where the contender differs significantly from the control.
    """
    depth = max(len(ranking.rows) for ranking in rankings)
    head = "".join("<th>Algorithm</th><th>Rank</th><th>p-value</th>" for _ in rankings) + "<th>Holm</th>"
    body = []
    for i in range(depth):
        cells = "".join(_ranking_cells(ranking.rows[i] if i < len(ranking.rows) else None) for ranking in rankings)
        holm = f"{ALPHA / i:.3f}" if i else ""
        body.append(f"<tr>{cells}<td>{holm}</td></tr>")
    statistics = "".join(f'<td colspan="3">{_statistics(ranking.test)}</td>' for ranking in rankings)
    foot = f"<tr>{statistics}<td></td></tr>"
    return _table(caption, head, "".join(body), foot, "ranking")


def effect_table(ranking: Ranking) -> str:
    """A ranking's intervals, effect sizes and adjusted p-values, and the paper's ranks."""
    first = ranking.rows[0].contender
    caption = (
        f"{first.evaluations:,} evaluations, {ranking.measure.label}{in_unit(ranking.measure)}, "
        f"{ranking.seeds} seeds, {len(ranking.sequences)} sequences"
    )
    head = ["Algorithm", "Mean", "95 %", "Rank", "95 %", "Holm-adjusted p", "A"]
    rows = [effect_cells(row, ranking.measure) for row in ranking.rows]
    printed = paper.printed_ranks(first.dof, first.evaluations)
    if printed and len({row.contender.algorithm for row in ranking.rows}) > 1:
        head.insert(5, "Rank in the paper")
        for cells, row in zip(rows, ranking.rows, strict=True):
            known = printed.get(row.contender.algorithm)
            cells.insert(5, "" if known is None else f"{known:.3f}")
    return grid_table(caption, head, rows)


def beside_table(study: StudySummary, measure: Measure) -> str:
    """The means of what has no part in a ranking: our trackers and the baselines; empty without any."""
    who = [*study.others, *baseline_contenders(study)]
    rows = [[str(each), or_dash(level(study, each, measure, study.sequences), measure)] for each in who]
    if not rows:
        return ""
    cells = _beside(study, measure)
    size = f" {extent(cells)}." if cells else ""
    caption = f"Not ranked, {measure.label}{in_unit(measure)}, mean over {len(study.sequences)} sequences.{size}"
    return grid_table(caption, ["Tracker", "Mean"], rows)


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


def floor_note(study: StudySummary, measure: Measure, sequences: Sequence[str]) -> str:
    """A sentence on what the tracked bodies score at the true angles; empty where that is unknown."""
    floor = study.floor(measure, sequences)
    if np.isnan(floor):
        return ""
    over = spelled(len(sequences), "sequence")
    return f"Floor: at the true angles the tracked bodies score {with_unit(floor, measure)}, mean over {over}."


def sequence_table(study: StudySummary, measure: Measure, budget: int) -> str:
    """Mean and standard deviation over runs for every sequence, algorithm and model."""
    head = "<th>Algorithm</th><th>DOF</th>" + "".join(f"<th>{escape(name)}</th>" for name in study.sequences)
    rows = []
    for algorithm in study.algorithms:
        for dof in study.models:
            cells = "".join(
                f"<td>{_mean_and_deviation(study, measure, sequence, algorithm, dof, budget)}</td>"
                for sequence in study.sequences
            )
            rows.append(f"<tr><th>{escape(algorithm_label(algorithm))}</th><td>{dof}</td>{cells}</tr>")
    for who in [*study.others, *baseline_contenders(study)]:
        cells = "".join(
            f"<td>{_mean_and_deviation(study, measure, sequence, who.algorithm, who.dof, who.evaluations)}</td>"
            for sequence in study.sequences
        )
        model = "" if who.algorithm in BASELINES else who.dof
        rows.append(f"<tr><th>{escape(_row_label(study, who))}</th><td>{model}</td>{cells}</tr>")
    floors = [study.floor(measure, [sequence]) for sequence in study.sequences]
    if np.isfinite(floors).any():
        cells = "".join(f"<td>{shown(floor, measure) if np.isfinite(floor) else '–'}</td>" for floor in floors)
        rows.append(f"<tr><th>Floor: at the true angles</th><td></td>{cells}</tr>")
    shown_cells = [study.cells[cell] for cell in study.grid if cell.evaluations == budget]
    own = "; our trackers at their own budgets" if study.others else ""
    caption = (
        f"{measure.label}{in_unit(measure)}, mean ± standard deviation over runs, {budget:,} evaluations per frame"
        f"{own}. {extent([*shown_cells, *_beside(study, measure)])}."
    )
    return _table(caption, head, "".join(rows), kind="sequences")


def _beside(study: StudySummary, measure: Measure) -> list[CellSummary]:
    return [cell for who in study.others for cell in study.known(who, study.sequences, measure).values()]


def _row_label(study: StudySummary, who: Contender) -> str:
    """An algorithm's label, with its budget where the study has several of it."""
    alike = [other for other in study.others if other.algorithm == who.algorithm]
    label = algorithm_label(who.algorithm)
    return f"{label}, {who.evaluations:,}" if len(alike) > 1 else label


def difference_table(differences: Sequence[ModelDifference], measure: Measure, models: Sequence[int]) -> str:
    """The larger model less the smaller, by algorithm and budget."""
    budgets = sorted({difference.evaluations for difference in differences})
    head = "<th>Algorithm</th>" + "".join(
        f"<th>{budget:,}: difference, 95 %</th><th>A</th><th>Wilcoxon p</th>" for budget in budgets
    )
    rows = []
    for algorithm, found in groupby(differences, key=lambda difference: difference.algorithm):
        of = {difference.evaluations: difference for difference in found}
        cells = "".join(_difference_cells(of.get(budget), measure) for budget in budgets)
        rows.append(f"<tr><th>{escape(algorithm_label(algorithm))}</th>{cells}</tr>")
    caption = (
        f"{measure.label}{in_unit(measure)} with {models[0]} DOF less that with {models[-1]}, mean over sequences; "
        f"A is the chance that a run with {models[0]} is better; Wilcoxon’s signed-rank test is over the sequences "
        f"({_blocks(differences)}), two-sided, bold below {ALPHA:g}"
    )
    return _table(caption, head, "".join(rows), kind="differences")


def _blocks(differences: Sequence[ModelDifference]) -> str:
    """Over how many sequences the differences are."""
    numbers = sorted({difference.sequences for difference in differences})
    return f"{numbers[0]}" if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"


def grid_table(caption: str, head: Sequence[str], rows: Iterable[Sequence[str]], kind: str = "") -> str:
    """A plain table, of a class if need be; the first column names the rows."""
    titles = "".join(f"<th>{escape(title)}</th>" for title in head)
    body = "".join(
        f"<tr><th>{escape(row[0])}</th>{''.join(f'<td>{escape(cell)}</td>' for cell in row[1:])}</tr>" for row in rows
    )
    return _table(caption, titles, body, kind=kind)


def _ranking_cells(row: Row | None) -> str:
    if row is None:
        return "<td></td><td></td><td></td>"
    p = p_value(row.comparison.p)
    verdict = f"<strong>{p}</strong>" if row.comparison.rejected else p
    return f"<th>{escape(str(row.contender))}</th><td>{row.comparison.rank:.3f}</td><td>{verdict}</td>"


def _statistics(test: Omnibus | None) -> str:
    if test is None:
        return "one sequence: no test"
    sign = ">" if test.statistic > test.critical else "≤"
    return (
        f"Friedman {test.statistic:.3f} {sign} {test.critical:.3f}, p = {p_value(test.p)}<br>"
        f"Iman–Davenport F = {statistic(test.f)}, p = {p_value(test.f_p)}<br>Kendall’s W = {test.kendall_w:.2f}"
    )


def _mean_and_deviation(
    study: StudySummary, measure: Measure, sequence: str, algorithm: str, dof: int, budget: int
) -> str:
    cell = study.find(sequence, algorithm, dof, budget)
    if cell is None or measure.key not in cell.runs:
        return "–"
    runs = cell.runs[measure.key]
    mean = shown(float(runs.mean()), measure)
    return f"{mean} <small>±{shown(float(runs.std(ddof=1)), measure)}</small>" if len(runs) > 1 else mean


def _difference_cells(difference: ModelDifference | None, measure: Measure) -> str:
    if difference is None:
        return "<td></td>" * 3
    text = shown(difference.difference, measure, sign=True)
    decided = difference.interval[0] * difference.interval[1] > 0
    p = p_value(difference.p)
    return (
        f"<td>{f'<strong>{text}</strong>' if decided else text} "
        f"<small>{interval(difference.interval, measure.decimals)}</small></td><td>{difference.superiority:.2f}</td>"
        f"<td>{f'<strong>{p}</strong>' if difference.p < ALPHA else p}</td>"
    )


def _table(caption: str, head: str, body: str, foot: str = "", kind: str = "") -> str:
    ending = f"<tfoot>{foot}</tfoot>" if foot else ""
    named = f' class="{kind}"' if kind else ""
    return (
        f'<figure class="table"><figcaption>{escape(caption)}</figcaption><div class="wide"><table{named}>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody>{ending}</table></div></figure>"
    )
