"""How commands talk: results on stdout, everything else on stderr."""

from __future__ import annotations

import json as json_format
import math
import sys
from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Parameter

Switch = Annotated[bool, Parameter(negative="", show_default=False)]
"""An option that is given or not: it takes no value and has no opposite."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Console:
    """The options that every command has."""

    json: Switch = False
    """Print exactly one JSON object on stdout."""
    quiet: Switch = False
    """Say nothing on stderr but warnings and errors."""
    debug: Switch = False
    """Show the traceback of an error; MMOCAP_DEBUG=1 does so too."""
    allow_references: Switch = False
    """Let USD files name others outside their folder; MMOCAP_ALLOW_REFERENCES=1 does so too."""

    def note(self, line: str) -> None:
        """Say what happens, on stderr."""
        if not self.quiet:
            print(line, file=sys.stderr, flush=True)

    def warn(self, line: str) -> None:
        """Say what is wrong, on stderr."""
        print(line, file=sys.stderr, flush=True)

    def result(self, values: dict[str, Any], text: str) -> None:
        """Print the command's answer on stdout: ``values`` as JSON where that is asked for, else ``text``."""
        if self.json:
            text = json_format.dumps(_finite(values), indent=2, allow_nan=False)
        print(text)


def _finite(value: Any) -> Any:
    """``value`` in types that JSON knows; what is not a finite number is null."""
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, known without importing NumPy
        return _finite(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, (bool, int, str, type(None))) else str(value)


def table(rows: list[tuple[str, ...]]) -> str:
    """Aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )
