"""A page of one file: its head, which allows its own script and style by their hashes and nothing else."""

from __future__ import annotations

import base64
import hashlib
import json
from html import escape
from importlib.resources import files
from string import Template
from typing import Any


def resource(package: str, name: str) -> str:
    """A text file of a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8").strip()


def filled(template: str, *, title: str, script: str, style: str, **parts: str) -> str:
    """A page of a template that begins with ``$head`` and has its one script in ``$script``.

    Args:
        template: in which ``$title``, too, is known.
        title: as plain text.
        script, style: all that the page runs and looks like.
        parts: what else the template names, as markup.
    """
    head = Template(resource("mmocap_warp.display.page", "head.html")).substitute(
        title=escape(title), style=style, style_hash=_hash(style), script_hash=_hash(script)
    )
    return Template(template).substitute(parts, head=head, title=escape(title), script=script)


def embedded(data: dict[str, Any]) -> str:
    """JSON that no browser takes for markup, whatever names it holds."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _hash(text: str) -> str:
    """The hash by which a content security policy names a text that it allows."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
