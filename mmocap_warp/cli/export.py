"""``mmocap export``: a result's animation for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.formats.table import EXPORT_SUFFIXES
from mmocap_warp.formats.table import export as write_export

_OUTPUT = f"The animation's file: {', '.join(EXPORT_SUFFIXES[:-1])} or {EXPORT_SUFFIXES[-1]}."


def export(
    result: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help=_OUTPUT)],
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a result's animation alone: body, skeleton and motion of the best run.

    Parameters
    ----------
    result
        What 'mmocap track' wrote.
    force
        Replace a file that exists.
    """
    from mmocap_warp.cli.devices import start_warp
    from mmocap_warp.cli.outputs import new_file
    from mmocap_warp.formats.usd.result import read_result

    console = console or Console()
    new_file(output, *EXPORT_SUFFIXES, force=force)
    tracked = read_result(result)
    start_warp()
    write_export(tracked, output)
    frames = len(tracked.frame_numbers)
    console.result({"file": output, "frames": frames, "fps": tracked.fps}, f"{output}: {frames} frames")
