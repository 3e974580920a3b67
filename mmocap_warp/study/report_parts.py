"""Filling the pieces of HTML that ``report_parts.html`` holds."""

from __future__ import annotations

import re
from functools import cache
from html import escape
from string import Template

from mmocap_warp.display.page.viewer import resource


class Html(str):
    """Text that is markup already."""


def fill(piece: str, **values: object) -> Html:
    """A piece of ``report_parts.html`` with its placeholders filled.

    Args:
        piece: the name in the comment above it.
        values: by placeholder. Text and numbers are escaped, ``Html`` is not; a list is of markup, and is joined.
    """
    return Html(_pieces()[piece].substitute({name: _markup(value) for name, value in values.items()}))


def _markup(value: object) -> str:
    if isinstance(value, list):
        return "".join(value)
    return value if isinstance(value, Html) else escape(str(value))


@cache
def _pieces() -> dict[str, Template]:
    """Each piece by the name in the comment above it; line breaks in it mean nothing."""
    _, *parts = re.split(r"<!-- ([\w-]+) -->\n", resource("mmocap_warp.study", "report_parts.html"))
    texts = (re.sub(r"\n\s*(?=<)", "", part).replace("\n", " ").strip() for part in parts[1::2])
    return {name: Template(text) for name, text in zip(parts[::2], texts, strict=True)}
