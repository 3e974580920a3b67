"""The report's tables as text: Markdown for people, CSV for programs. Small enough to commit."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence

import numpy as np

from mmocap_warp.study.claims import check_claims
from mmocap_warp.study.overview import (
    LOST_LIMB,
    all_trackers,
    lead_table,
    missing,
    radii_tables,
    rank_pairs,
    strangers_table,
    which_half,
)
from mmocap_warp.study.report_setting import grid_sentence, headline
from mmocap_warp.study.report_tables import Table, effect_cells, floor_note, ranking_rows
from mmocap_warp.study.study_tables import Ranking, by_algorithm, by_model, model_differences
from mmocap_warp.study.summary import EQ_20, MEASURES, CellSummary, Measure, StudySummary, algorithm_label
from mmocap_warp.study.wording import in_unit, interval, named, p_value, shown, statistic

_RANKED_BY = (*EQ_20, "cost")
"""The paper ranks by Eq. 20 and, in its text, by fitness: Markdown has these beside the main measure."""

_UNIT_SUFFIX = {"mm": "_mm", "%": "_percent", "mm/s": "_mm_per_s", "m/s³": "_m_per_s3"}


def csv_table(study: StudySummary) -> str:
    """A line per cell: mean and standard deviation over runs of each measure, and the main measure's quartiles."""
    known = [measure for measure in MEASURES if measure in study.measures]
    main = study.measures[0]
    lines = [_csv_line(cell, known, main) for _, cell in sorted(study.cells.items())]
    out = io.StringIO()
    writer = csv.DictWriter(out, fieldnames=list(lines[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue()


def markdown_tables(study: StudySummary) -> str:
    """The paper's findings checked, and Tables 4 to 7, by the main measure, by Eq. 20 and by fitness."""
    main = study.measures[0]
    ranked = [measure for measure in study.measures if measure == main or measure.key in _RANKED_BY]
    title, _ = headline(study, main)
    parts = [f"# {title}\n\n{grid_sentence(study)}\n", *_overview(study, main), _claims(study, main)]
    for measure in ranked:
        for number, dof in enumerate(study.models, 4):
            found = [by_algorithm(study, measure, dof, budget) for budget in study.budgets]
            parts += _rankings(found, f"{dof} DOF by {named(measure)} (as the paper’s Table {number})")
        note = floor_note(study, measure, study.sequences)
        parts += [f"{note}\n"] if note else []
        for number, kind, names in ((6, "Hierarchical", study.hierarchical), (7, "Holistic", study.holistic)):
            found = [by_model(study, measure, name) for name in names]
            parts += _rankings(found, f"{kind} algorithms by {named(measure)} (as the paper’s Table {number})")
        parts.append(_differences(study, measure))
    return "\n".join(part for part in parts if part)


def _overview(study: StudySummary, main: Measure) -> Iterator[str]:
    """What stands beside the paper's tables."""
    yield _titled("Our tracker against the best of the others", lead_table(study, study.sequences))
    yield _titled("All trackers", all_trackers(study))
    for dof in study.models:
        yield _titled(f"Ranks by error and by fitness, {dof} DOF", rank_pairs(study, dof))
    for measure in (main, LOST_LIMB):
        for table in radii_tables(study, measure):
            yield _titled(f"Search radii: {named(measure)}", table)
    yield "".join(f"{sentence}\n" for sentence in which_half(study))
    yield _titled("People outside the family of bodies", strangers_table(study, main))
    yield _titled("Our tracker there", lead_table(study, study.strangers))
    absent = missing(study)
    if absent:
        yield "## Not run\n\n" + "".join(f"- {sentence}\n" for sentence in absent)


def _titled(title: str, table: Table | None) -> str:
    return table.markdown(title) if table is not None else ""


def _csv_line(cell: CellSummary, measures: Sequence[Measure], main: Measure) -> dict[str, object]:
    of = cell.cell
    line: dict[str, object] = {
        "sequence": of.sequence,
        "algorithm": of.algorithm,
        "dof": of.dof,
        "evaluations": of.evaluations,
        "preset": of.preset,
        "seeds": len(cell.seeds),
        "frames": len(cell.frames),
    }
    for measure in measures:
        runs = cell.runs.get(measure.key)
        name = measure.key + _UNIT_SUFFIX.get(measure.unit, "")
        line[name] = "" if runs is None else _significant(float(runs.mean()))
        line[f"{name}_sd"] = _significant(float(runs.std(ddof=1))) if runs is not None and len(runs) > 1 else ""
        if measure.key in EQ_20:
            line[f"{measure.key}_floor_mm"] = _significant(cell.floors.get(measure.key, np.nan))
    for i, label in enumerate(("min", "q1", "median", "q3", "max")):
        spread = cell.spread.get(main.key)
        line[f"{main.key}_{label}"] = "" if spread is None else _significant(float(spread[i]))
    return line | {
        "frames_lost": _significant(cell.frames_lost),
        "seconds": _significant(cell.seconds),
        "evaluations_spent": cell.evaluations,
        "device": cell.meta.get("versions", {}).get("device", ""),
        "started": cell.meta.get("started", ""),
    }


def _significant(value: float) -> str:
    return f"{value:.5g}" if np.isfinite(value) else ""


def _claims(study: StudySummary, measure: Measure) -> str:
    rows = [[each.claim, each.where, each.by, each.verdict, each.evidence] for each in check_claims(study, measure)]
    return Table("", ["Finding", "where", "here by", "verdict", "evidence"], rows).markdown("The paper’s findings")


def _rankings(found: Sequence[Ranking | None], title: str) -> Iterator[str]:
    """Rankings side by side with their tests below, and then their effects' sizes."""
    rankings = [ranking for ranking in found if ranking is not None]
    if not rankings:
        return
    rows = ranking_rows(rankings, lambda p: f"**{p}**")
    tests = [ranking.test for ranking in rankings]
    tested = {
        "Friedman": [(f"{test.statistic:.3f}", p_value(test.p)) if test else ("", "") for test in tests],
        "Iman–Davenport F": [(statistic(test.f), p_value(test.f_p)) if test else ("", "") for test in tests],
        "Kendall’s W": [(f"{test.kendall_w:.2f}" if test else "", "") for test in tests],
    }
    rows += [[text for pair in pairs for text in (name, *pair)] + [""] for name, pairs in tested.items()]
    head = [*(["Algorithm", "Rank", "p-value"] * len(rankings)), "Holm"]
    size = ", ".join(f"{ranking.seeds} seeds over {len(ranking.sequences)} sequences" for ranking in rankings)
    yield Table(f"{size}.", head, rows).markdown(title)
    head = ["Algorithm", f"mean{in_unit(rankings[0].measure)}", "95 %", "rank", "95 %", "Holm-adjusted p", "A"]
    effects = [effect_cells(row, ranking.measure) for ranking in rankings for row in ranking.rows]
    yield Table("", head, effects).markdown()


def _differences(study: StudySummary, measure: Measure) -> str:
    rows = [
        [
            algorithm_label(found.algorithm),
            f"{found.evaluations}",
            shown(found.difference, measure, sign=True),
            interval(found.interval, measure.decimals),
            f"{found.superiority:.2f}",
            p_value(found.p),
            f"{found.sequences}",
        ]
        for found in model_differences(study, measure)
    ]
    head = ("Algorithm", "evaluations", "difference", "95 %", "A", "Wilcoxon p", "sequences")
    title = f"{study.models[0]} less {study.models[-1]} DOF: {named(measure)}{in_unit(measure)}"
    return Table("", head, rows).markdown(title) if rows else ""
