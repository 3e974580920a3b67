"""``mmocap check``: is a USD file sound?"""

from __future__ import annotations

from pathlib import Path

from mmocap_warp.cli.console import CHECK_FAILED, OK, Console


def check(file: Path, /, *, console: Console | None = None) -> int:
    """Say what is wrong with a USD file: by OpenUSD's validators, and what they miss in bodies that move.

    Parameters
    ----------
    file
        A .usda, .usdc or .usdz file: a result, a subject, a body, an export, or another program's.
    """
    from mmocap_warp.formats.usd.usd_check import faults

    console = console or Console()
    found = faults(file)
    lines = [f"{file}: {fault}" for fault in found] or [f"{file}: nothing wrong"]
    console.result({"file": file, "faults": found}, "\n".join(lines))
    return CHECK_FAILED if found else OK
