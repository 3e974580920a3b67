"""A command as a program calls it."""

from __future__ import annotations

import json

from mmocap_warp import cli
from mmocap_warp.cli import console


def answer(capsys, *arguments: object, code: int = console.OK) -> dict:
    """The JSON of a command that must succeed, or end with a code."""
    capsys.readouterr()
    assert cli.main([*map(str, arguments), "--json", "--quiet"]) == code
    shown = capsys.readouterr()
    assert shown.err == ""
    return json.loads(shown.out)
