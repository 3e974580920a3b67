"""Reports as JSON files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mmocap_warp.bench.suite import FORMAT
from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import write_whole


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
