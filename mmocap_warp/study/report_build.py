"""The report of a study: one HTML page that needs nothing but itself, and its tables as Markdown and CSV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from mmocap_warp.display.chart import MARKS
from mmocap_warp.display.page.viewer import filled, resource
from mmocap_warp.study.report_parts import Html, fill
from mmocap_warp.study.report_sections import (
    Section,
    claims_section,
    curves_section,
    models_section,
    overlays_section,
    presets_section,
    ranks_section,
    spread_section,
    strangers_section,
    trackers_section,
)
from mmocap_warp.study.report_setting import (
    budget_section,
    citing_section,
    grid_sentence,
    headline,
    radii,
    setting_section,
)
from mmocap_warp.study.report_text import csv_table, markdown_tables
from mmocap_warp.study.sequences import CLIP_PLANS
from mmocap_warp.study.source import Clip
from mmocap_warp.study.summary import StudySummary
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import write_whole

_HERE = "mmocap_warp.study"


def render(study: StudySummary, clips: Mapping[str, Clip], notes: Sequence[str] = ()) -> str:
    """The whole page.

    Args:
        study: what it is about; one cell at least.
        clips: the recordings at hand by sequence, for pictures of the tracked body.
        notes: remarks for the section on the setting, such as on files that could not be read.

    Raises:
        ValueError: a study without a measure that every figure could show.
    """
    if not study.measures:
        raise ValueError("a study needs a cell with a known error or overlap")
    main = study.measures[0]
    title, cards = headline(study, main)
    candidates: tuple[Section | None, ...] = (
        trackers_section(study, main),
        claims_section(study, main),
        ranks_section(study),
        spread_section(study),
        curves_section(study),
        overlays_section(study, clips),
        budget_section(study),
        models_section(study),
        presets_section(study, radii(study)),
        strangers_section(study),
        setting_section(study, notes),
        citing_section(),
    )
    sections = [section for section in candidates if section is not None]
    names = sorted({str(cell.meta["study"]) for cell in study.cells.values() if cell.meta.get("study")} - {"study"})
    return filled(
        resource(_HERE, "report.html"),
        title=title,
        script=resource(_HERE, "report.js"),
        style=MARKS + resource(_HERE, "report.css"),
        eyebrow=escape(f"Study {', '.join(names)}" if names else "Study"),
        lead=escape(grid_sentence(study)),
        cards=cards,
        contents="".join(fill("contents", anchor=section.anchor, title=section.title) for section in sections),
        controls=_controls(study),
        sections="\n".join(section.html() for section in sections),
        footer=escape(f"Written by mmocap-warp {__version__}."),
    )


def write_report(
    study: StudySummary,
    clips: Mapping[str, Clip],
    notes: Sequence[str],
    page: Path,
    tables: Path,
    cells: Path,
) -> None:
    """Write the page, its tables as Markdown, and a CSV file with a line per cell; each whole or not at all.

    Args:
        study: what it is about; one cell at least.
        clips: where the recordings of sequences are, see :func:`clips_of`.
        notes: remarks for the page.
        page, tables, cells: the files; those that exist are replaced.

    Raises:
        InputError: a file cannot be written.
        ValueError: see :func:`render`.
    """
    write_whole(page, render(study, clips, notes).encode())
    write_whole(tables, markdown_tables(study).encode())
    write_whole(cells, csv_table(study).encode())


def clips_of(study: StudySummary, own: Mapping[str, Clip]) -> dict[str, Clip]:
    """The recordings of a study's sequences that are at hand: a user's own, and the shipped ones by their names."""
    named = [*study.sequences, *study.strangers]
    return {name: Clip(name) for name in named if name in CLIP_PLANS} | {
        name: own[name] for name in named if name in own
    }


def _controls(study: StudySummary) -> Html:
    """A list for each thing to choose."""
    kinds: dict[tuple[str, str], dict] = {
        ("measure", "Measure"): {measure.key: measure.label for measure in study.measures},
        ("model", "Model"): {dof: f"{dof} DOF" for dof in study.models},
        ("budget", "Evaluations per frame"): {budget: f"{budget:,}" for budget in study.budgets},
        ("sequence", "Sequence"): {name: name for name in study.sequences},
    }
    lists = []
    for (name, title), labels in kinds.items():
        options = [fill("option", value=value, label=label) for value, label in labels.items()]
        lists.append(fill("control", title=title, name=name, options=options))
    return Html("".join(lists))
