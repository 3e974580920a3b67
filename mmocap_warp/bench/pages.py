"""Reports as a page of Markdown, with plots of growth beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mmocap_warp.bench.bench_tables import Report, Table, heading, report_tables
from mmocap_warp.bench.growth import AXES
from mmocap_warp.bench.plots import growth_lines, growth_plots
from mmocap_warp.whole_file import write_whole

PAGE = "results.md"


def plot_name(axis: str) -> str:
    """The file of a plot."""
    return f"growth-{axis}.svg"


def write_pages(folder: Path, reports: Sequence[Report]) -> list[Path]:
    """Write the page and the plots into a folder, replacing those of earlier reports; returns the files.

    Raises:
        InputError: it cannot be written to.
    """
    plots = growth_plots(reports)
    files = {PAGE: report_page(reports)} | {plot_name(axis): plot for axis, plot in plots.items()}
    for name, words in files.items():
        write_whole(folder / name, words.encode())
    return [folder / name for name in files]


def report_page(reports: Sequence[Report]) -> str:
    """The page's Markdown; the plots that it shows are those of ``write_pages``, in the same folder."""
    parts = [
        "# Times",
        "`mmocap bench pages` wrote this page. [Performance](../performance.md) says what is measured, and how.",
    ]
    parts += ["; ".join(heading(report).splitlines()) + "." for report in reports]
    growing = [axis for axis in AXES if growth_lines(reports, axis)]
    if growing:
        parts.append("## Growth")
    for axis in growing:
        parts += [f"![{axis}]({plot_name(axis)})", _slopes(reports, axis)]
    for report in reports:
        parts.append(f"## {report['device']}")
        for table in report_tables(report, answers=True):
            parts += [f"### {table.title[0].upper()}{table.title[1:]}", _markdown(table)]
            parts += [f"- {note}" for note in table.notes]
    return "\n\n".join(parts) + "\n"


def _slopes(reports: Sequence[Report], axis: str) -> str:
    """In words, how steep the lines end: 1 is in proportion."""
    words = [f"{line.name} {line.slope:.2f}" for line in growth_lines(reports, axis) if len(line.points) > 1]
    return f"Slope at the end: {', '.join(words)}."


def _markdown(table: Table) -> str:
    lines = [table.columns, ["---"] * len(table.columns)]
    lines += [[word.replace("|", "\\|") for word in row] for row in table.rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
