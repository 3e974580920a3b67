"""A report on the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console, Group, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from mmocap_warp.bench.tables import Report, Table, heading, report_tables

_WIDTH = 150  # columns; no table needs more


def rendered(report: Report, old: Report | None = None) -> Group:
    """A report's tables, with ratios to an older one's."""
    parts: list[RenderableType] = [Text(heading(report))]
    for table in report_tables(report, old):
        parts += [Text(), _rich(table), *(Text(f"  {note}", style="dim") for note in table.notes)]
    return Group(*parts)


def to_text(parts: RenderableType, *, colours: bool) -> str:
    """What a terminal shows of it."""
    console = Console(width=_WIDTH, force_terminal=colours, no_color=not colours, highlight=False)
    with console.capture() as captured:
        console.print(parts)
    return "\n".join(line.rstrip() for line in captured.get().splitlines())


def _rich(table: Table) -> RichTable:
    shown = _columns_with_words(table)
    rich = RichTable(
        title=Text(f"{table.title}\n", style="bold"),
        title_justify="left",
        header_style="dim",
        box=None,
        padding=(0, 2, 0, 0),
    )
    for i in shown:
        number = i > 1 and table.columns[i] != "answer"
        rich.add_column(table.columns[i], justify="right" if number else "left", no_wrap=True)
    for row in table.rows:
        rich.add_row(*(_coloured(row[i]) for i in shown))
    return rich


def _columns_with_words(table: Table) -> Sequence[int]:
    return [i for i in range(len(table.columns)) if any(row[i] for row in table.rows)]


def _coloured(word: str) -> Text:
    if word in ("✓", "✗"):
        return Text(word, style="green" if word == "✓" else "bold red")
    return Text(word)
