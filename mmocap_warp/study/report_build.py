"""The report of a study: one HTML page that needs nothing but itself, and its tables as Markdown and CSV."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from html import escape
from itertools import chain
from pathlib import Path

import numpy as np

from mmocap_warp.display.chart import MARKS
from mmocap_warp.display.page.viewer import filled, resource
from mmocap_warp.study import overview, report_sections
from mmocap_warp.study.report_parts import Html, Section, Table, fill
from mmocap_warp.study.report_setting import budget_section, grid_sentence, headline, setting_section
from mmocap_warp.study.report_tables import RANK_HEAD, effect_cells, floor_note, ranking_rows
from mmocap_warp.study.sequences import CLIP_PLANS
from mmocap_warp.study.source import Clip
from mmocap_warp.study.study_tables import Ranking, algorithm_rankings, model_differences, model_rankings
from mmocap_warp.study.summary import EQ_20, CellSummary, Measure, StudySummary, algorithm_label
from mmocap_warp.study.wording import interval, named, p_value, shown, statistic
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import csv_text, write_whole

_HERE = "mmocap_warp.study"
# The paper ranks by Eq. 20 and, in its text, by fitness: Markdown has these beside the main measure.
_RANKED_BY = (*EQ_20, "cost")
_UNIT_SUFFIX = {"mm": "_mm", "%": "_percent", "mm/s": "_mm_per_s", "m/s³": "_m_per_s3"}


def render(study: StudySummary, clips: Mapping[str, Clip], notes: Sequence[str] = ()) -> str:
    """The whole page. ``clips`` are the recordings at hand by sequence, for pictures; ``notes`` go to the setting."""
    title, cards = headline(study)
    candidates: tuple[Section | None, ...] = (
        report_sections.trackers_section(study),
        report_sections.ranks_section(study),
        report_sections.spread_section(study),
        report_sections.curves_section(study),
        report_sections.overlays_section(study, clips),
        budget_section(study),
        report_sections.models_section(study),
        report_sections.presets_section(study),
        report_sections.strangers_section(study),
        setting_section(study, notes),
        Section("cite", "How to cite", [fill("cite", bibtex=resource(_HERE, "paper.bib"))]),
    )
    sections = [section._asdict() for section in candidates if section is not None]
    names = sorted({str(cell.meta["study"]) for cell in study.cells.values() if cell.meta.get("study")} - {"study"})
    return filled(
        resource(_HERE, "report.html"),
        title=title,
        script=resource(_HERE, "report.js"),
        style=MARKS + resource(_HERE, "report.css"),
        eyebrow=escape(f"Study {', '.join(names)}" if names else "Study"),
        lead=escape(grid_sentence(study)),
        cards=cards,
        contents="".join(fill("contents", **section) for section in sections),
        controls=_controls(study),
        sections="\n".join(fill("section", **section) for section in sections),
        footer=escape(f"Written by mmocap-warp {__version__}."),
    )


def write_report(
    study: StudySummary, clips: Mapping[str, Clip], notes: Sequence[str], page: Path, tables: Path, cells: Path
) -> None:
    """Write the page, its tables as Markdown, and a CSV file with a line per cell; each whole or not at all.

    Files that exist are replaced. For ``study``, ``clips`` and ``notes`` see :func:`render`. Raises an InputError for a
    file that cannot be written.
    """
    write_whole(page, render(study, clips, notes).encode())
    write_whole(tables, markdown_tables(study).encode())
    write_whole(cells, csv_table(study).encode())


def clips_of(study: StudySummary, own: Mapping[str, Clip]) -> dict[str, Clip]:
    """The recordings of a study's sequences that are at hand: a user's own, and the shipped ones by their names."""
    named = [*study.sequences, *study.strangers]
    return {name: own.get(name) or Clip(name) for name in named if name in own or name in CLIP_PLANS}


def _controls(study: StudySummary) -> Html:
    """A list for each thing to choose."""
    kinds: dict[tuple[str, str], dict] = {
        ("measure", "Measure"): {measure.key: measure.label for measure in study.measures},
        ("model", "Model"): {dof: f"{dof} DOF" for dof in study.models},
        ("budget", "Evaluations per frame"): {budget: f"{budget:,}" for budget in study.budgets},
        ("sequence", "Sequence"): {name: name for name in study.sequences},
    }
    options = {of: [fill("option", value=each, label=labels[each]) for each in labels] for of, labels in kinds.items()}
    lists = (fill("control", title=title, name=name, options=each) for (name, title), each in options.items())
    return Html("".join(lists))


def csv_table(study: StudySummary) -> str:
    """A line per cell: mean and standard deviation over runs of each measure, and the main measure's quartiles."""
    lines = [_csv_line(cell, study.measures) for _, cell in sorted(study.cells.items())]
    return csv_text([lines[0], *(line.values() for line in lines)])


def markdown_tables(study: StudySummary) -> str:
    """Tables 4 to 7, by the main measure, by Eq. 20 and by fitness."""
    main = study.measures[0]
    ranked = [measure for measure in study.measures if measure == main or measure.key in _RANKED_BY]
    title, _ = headline(study)
    parts = [f"# {title}\n\n{grid_sentence(study)}\n", *_overview(study, main)]
    for measure in ranked:
        for number, dof in enumerate(study.models, 4):
            title = f"{dof} DOF by {named(measure)} (as the paper’s Table {number})"
            parts += _rankings(algorithm_rankings(study, measure, dof), title)
        note = floor_note(study, measure, study.sequences)
        parts += [f"{note}\n"] if note else []
        for number, kind, names in ((6, "Hierarchical", study.hierarchical), (7, "Holistic", study.holistic)):
            title = f"{kind} algorithms by {named(measure)} (as the paper’s Table {number})"
            parts += _rankings(model_rankings(study, measure, names), title)
        parts.append(_differences(study, measure))
    return "\n".join(part for part in parts if part)


def _overview(study: StudySummary, main: Measure) -> Iterator[str]:
    """What stands beside the paper's tables."""
    yield _titled("Our tracker against the best of the others", overview.lead_table(study, study.sequences))
    yield _titled("All trackers", overview.all_trackers(study))
    for dof in study.models:
        yield _titled(f"Ranks by error and by fitness, {dof} DOF", overview.rank_pairs(study, dof))
    for measure in (main, overview.LOST_LIMB):
        for table in overview.radii_tables(study, measure):
            yield _titled(f"Search radii: {named(measure)}", table)
    yield _titled("People outside the family of bodies", overview.strangers_table(study, main))
    yield _titled("Our tracker there", overview.lead_table(study, study.strangers))
    absent = overview.missing(study)
    if absent:
        yield "## Not run\n\n" + "".join(f"- {sentence}\n" for sentence in absent)


def _titled(title: str, table: Table | None) -> str:
    return table.markdown(title) if table is not None else ""


def _csv_line(cell: CellSummary, measures: Sequence[Measure]) -> dict[str, object]:
    line: dict[str, object] = asdict(cell.cell) | {"seeds": len(cell.seeds), "frames": len(cell.frames)}
    for measure in measures:
        runs = cell.runs.get(measure.key, np.zeros(0))
        name = measure.key + _UNIT_SUFFIX.get(measure.unit, "")
        line[name] = _significant(float(runs.mean())) if len(runs) else ""
        line[f"{name}_sd"] = _significant(float(runs.std(ddof=1))) if len(runs) > 1 else ""
        if measure.key in EQ_20:
            line[f"{measure.key}_floor_mm"] = _significant(cell.floors.get(measure.key, np.nan))
    main = measures[0].key
    for label, value in zip(("min", "q1", "median", "q3", "max"), cell.spread.get(main, [np.nan] * 5), strict=True):
        line[f"{main}_{label}"] = _significant(float(value))
    line |= {"frames_lost": _significant(cell.frames_lost), "seconds": _significant(cell.seconds)}
    line |= {"evaluations_spent": cell.evaluations, "device": cell.meta.get("versions", {}).get("device", "")}
    return line | {"started": cell.meta.get("started", "")}


def _significant(value: float) -> str:
    return f"{value:.5g}" if np.isfinite(value) else ""


def _rankings(rankings: Sequence[Ranking], title: str) -> Iterator[str]:
    """Rankings side by side with their tests below, and then their effects' sizes."""
    if not rankings:
        return
    rows, tests = ranking_rows(rankings, lambda p: f"**{p}**"), [ranking.test for ranking in rankings]
    tested = [
        [("Friedman", f"{test.statistic:.3f}", p_value(test.p)) if test else ("Friedman", "", "") for test in tests],
        [("Iman–Davenport F", *((statistic(test.f), p_value(test.f_p)) if test else ("", ""))) for test in tests],
        [("Kendall’s W", f"{test.kendall_w:.2f}" if test else "", "") for test in tests],
    ]
    rows += [[*chain.from_iterable(line), ""] for line in tested]
    head = [*(RANK_HEAD * len(rankings)), "Holm"]
    size = ", ".join(f"{ranking.seeds} seeds over {len(ranking.sequences)} sequences" for ranking in rankings)
    yield Table(f"{size}.", head, rows).markdown(title)
    head = ["Algorithm", f"mean{rankings[0].measure.bracket}", "95 %", "rank", "95 %", "Holm-adjusted p", "A"]
    effects = [effect_cells(row, ranking.measure) for ranking in rankings for row in ranking.rows]
    yield Table("", head, effects).markdown()


def _differences(study: StudySummary, measure: Measure) -> str:
    rows = []
    for found in model_differences(study, measure):
        difference = shown(found.difference, measure, sign=True), interval(found.interval, measure.decimals)
        tests = f"{found.superiority:.2f}", p_value(found.p), f"{found.sequences}"
        rows.append([algorithm_label(found.algorithm), f"{found.evaluations}", *difference, *tests])
    head = ("Algorithm", "evaluations", "difference", "95 %", "A", "Wilcoxon p", "sequences")
    title = f"{study.models[0]} less {study.models[-1]} DOF: {named(measure)}{measure.bracket}"
    return Table("", head, rows).markdown(title) if rows else ""
