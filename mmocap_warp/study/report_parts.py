"""What the report is made of: the pieces of HTML that ``report_parts.html`` holds, choices, sections and tables."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from string import Template
from typing import NamedTuple

from mmocap_warp.display.page.viewer import resource
from mmocap_warp.study.summary import Measure, StudySummary


class Html(str):
    """Text that is markup already."""


def fill(piece: str, **values: object) -> Html:
    """A piece of ``report_parts.html`` with its placeholders filled.

    Text and numbers are escaped, ``Html`` is not; a list is of markup, and is joined.
    """
    joined = {name: Html("".join(value)) if isinstance(value, list) else value for name, value in values.items()}
    markup = {name: value if isinstance(value, Html) else escape(str(value)) for name, value in joined.items()}
    return Html(_pieces()[piece].substitute(markup))


@cache
def _pieces() -> dict[str, Template]:
    """Each piece by the name in the comment above it; line breaks in it mean nothing."""
    _, *parts = re.split(r"<!-- ([\w-]+) -->\n", resource("mmocap_warp.study", "report_parts.html"))
    texts = (re.sub(r"\n\s*(?=<)", "", part).replace("\n", " ").strip() for part in parts[1::2])
    return {name: Template(text) for name, text in zip(parts[::2], texts, strict=True)}


class Section(NamedTuple):
    """A part of the page."""

    anchor: str  # its place in the page's address
    title: str
    content: Sequence[str]  # markup


def choice(study: StudySummary, content: str, **keys: object) -> Html:
    """A part that shows while the controls stand at ``keys``; at first, and without the script, they stand so."""
    main = study.measures[0].key
    first = {"measure": main, "curve": main, "model": study.models[0], "budget": study.budgets[0]}
    is_first = keys.items() <= (first | {"sequence": study.sequences[0]}).items()
    data = [f" {fill('key', name=name, value=value)}" for name, value in keys.items()]
    return fill("choice", keys=[*data, "" if is_first else " hidden"], content=[content])


def by_measure(study: StudySummary, content_of: Callable[[Measure], str]) -> list[str]:
    """A choice for each measure that there is something to show of."""
    contents = {measure.key: content_of(measure) for measure in study.measures}
    return [choice(study, content, measure=key) for key, content in contents.items() if content]


def drawn(drawing: str, caption: str) -> Html:
    """A drawing with its caption."""
    return fill("drawing", drawing=[drawing], caption=caption)


class Name(str):
    """A cell that names what stands beside it."""


@dataclass(frozen=True)
class Table:
    """A table of texts: the report's page and its Markdown say the same."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]  # as many texts as the head has; the first names the row
    kind: str = "compared"  # its class in the page
    foot: str = ""  # HTML of the cells of a last row, if there is one

    def html(self) -> Html:
        """As a figure of the page."""
        kind = Html(f' class="{self.kind}"' if self.kind else "")
        head = [f"<th>{escape(title)}</th>" for title in self.head]
        rows = [f"<tr>{''.join(_html_cells(row))}</tr>" for row in self.rows]
        foot = Html(f"<tfoot><tr>{self.foot}</tr></tfoot>" if self.foot else "")
        return fill("table", caption=self.caption, kind=kind, head=head, rows=rows, foot=foot)

    def markdown(self, title: str = "") -> str:
        """As Markdown; with a title, as a section."""
        lines = [self.head, ["---"] * len(self.head), *self.rows]
        grid = "".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |\n" for line in lines)
        caption = f"{self.caption}\n\n" if self.caption else ""
        return f"## {title}\n\n{caption}{grid}" if title else grid


def _html_cells(row: Sequence[str]) -> Iterator[str]:
    for place, cell in enumerate(row):
        tag = "th" if isinstance(cell, Name) or (cell and not place) else "td"
        yield f"<{tag}>{cell if isinstance(cell, Html) else escape(cell)}</{tag}>"


def html_of(table: Table | None) -> list[str]:
    """The markup of a table that there may be."""
    return [] if table is None else [table.html()]
