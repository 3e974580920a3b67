"""A report as a JSON file, on the terminal, and as a page of Markdown with plots of growth beside it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from mmocap_warp.bench.bench_tables import FORMAT, Report, Table, heading, report_tables
from mmocap_warp.bench.growth import AXES, growth_lines, growth_plots
from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import write_whole

PAGE = "results.md"
"""The file of the page of times."""
_WIDTH = 200  # columns of the terminal: more than any table needs, also where times spread on a busy machine
_COLOURS = {"✓": "green", "✗": "bold red"}


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write a report.

    Raises:
        InputError: it cannot be written.
    """
    write_whole(path, (json.dumps(report, indent=1, allow_nan=False) + "\n").encode())


def read_report(path: Path) -> dict[str, Any]:
    """Read a report.

    Raises:
        InputError: no such file, or not a report of this version.
    """
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(path, f"cannot be read ({error})", "name a file that 'mmocap bench -o' wrote") from error
    if not isinstance(report, dict) or report.get("format") != FORMAT:
        raise InputError(path, "is no report of this version", "write one with 'mmocap bench -o'")
    return report


def rendered(report: Report, old: Report | None = None) -> Group:
    """A report's tables for the terminal, with ratios to an older one's."""
    parts: list[RenderableType] = [Text(heading(report))]
    for table in report_tables(report, old):
        rich = RichTable(title=Text(f"{table.title}\n", style="bold"), title_justify="left", box=None)
        rich.header_style, rich.padding = "dim", (0, 2, 0, 0)
        for name in table.columns:
            rich.add_column(name, justify="left" if name in ("", "of", "answer") else "right", no_wrap=True)
        for row in table.rows:
            rich.add_row(*(Text(word, style=_COLOURS[word]) if word in _COLOURS else Text(word) for word in row))
        parts += [Text(), rich, *(Text(f"  {note}", style="dim") for note in table.notes)]
    return Group(*parts)


def to_text(parts: RenderableType, *, colours: bool) -> str:
    """What a terminal shows of it."""
    console = Console(width=_WIDTH, force_terminal=colours, no_color=not colours, highlight=False)
    with console.capture() as captured:
        console.print(parts)
    return "\n".join(line.rstrip() for line in captured.get().splitlines())


def write_pages(folder: Path, reports: Sequence[Report]) -> list[Path]:
    """Write the page and the plots into a folder, replacing those of earlier reports; returns the files.

    Raises:
        InputError: it cannot be written to.
    """
    plots = growth_plots(reports)
    files = {PAGE: report_page(reports)} | {f"growth-{axis}.svg": plot for axis, plot in plots.items()}
    for name, words in files.items():
        write_whole(folder / name, words.encode())
    return [folder / name for name in files]


def report_page(reports: Sequence[Report]) -> str:
    """The page of reports beside each other, as Markdown; its plots of growth are files beside it."""
    parts = [
        "# Measured",
        "Written by `mmocap bench pages`. What is measured and how: [performance](../performance.md).",
    ]
    parts += ["; ".join(heading(report).splitlines()) + "." for report in reports]
    growing = {axis: lines for axis in AXES if (lines := growth_lines(reports, axis))}
    parts += ["## Growth"] if growing else []
    for axis, lines in growing.items():
        slopes = ", ".join(f"{line.name} {line.slope:.2f}" for line in lines if len(line.points) > 1)
        parts += [f"![{axis}](growth-{axis}.svg)", f"Slope at the end: {slopes}."]
    for report in reports:
        parts.append(f"## {report['device']}")
        for table in report_tables(report, answers=True):
            parts += [f"### {table.title[0].upper()}{table.title[1:]}", _markdown(table)]
            parts += [f"- {note}" for note in table.notes]
    return "\n\n".join(parts) + "\n"


def _markdown(table: Table) -> str:
    lines = [table.columns, ["---"] * len(table.columns)]
    lines += [[word.replace("|", "\\|") for word in row] for row in table.rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
