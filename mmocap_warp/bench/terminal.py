"""A report on the terminal."""

from __future__ import annotations

from rich.console import Console, Group, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from mmocap_warp.bench.bench_tables import Report, Table, heading, report_tables

_WIDTH = 200  # columns; more than any table needs, also where times spread on a busy machine


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
    rich = RichTable(
        title=Text(f"{table.title}\n", style="bold"),
        title_justify="left",
        header_style="dim",
        box=None,
        padding=(0, 2, 0, 0),
    )
    for name in table.columns:
        rich.add_column(name, justify="left" if name in ("", "of", "answer") else "right", no_wrap=True)
    for row in table.rows:
        rich.add_row(*map(_coloured, row))
    return rich


def _coloured(word: str) -> Text:
    if word in ("✓", "✗"):
        return Text(word, style="green" if word == "✓" else "bold red")
    return Text(word)
