"""``mmocap export``: a result's animation for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

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
    up: Annotated[Literal["y", "z"] | None, Parameter(show_choices=False)] = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a result's animation alone: body, skeleton and motion of the best run, and the cameras.

    The world is the result's, which is the calibration's: its up axis, its heading and its origin.

    Parameters
    ----------
    result
        What 'mmocap track' wrote.
    up
        Turn the world so that y or z is up: (x, y, z) becomes (x, z, -y) from z up to y up, and (x, -z, y) back.
        [default: the result's own]
    force
        Replace a file that exists.
    """
    from mmocap_warp.cli.devices import start_warp
    from mmocap_warp.cli.outputs import new_file
    from mmocap_warp.formats.usd.result import read_result
    from mmocap_warp.result.turning import stood_up

    console = console or Console()
    new_file(output, *EXPORT_SUFFIXES, force=force)
    tracked = read_result(result)
    start_warp()
    tracked = tracked if up is None else stood_up(tracked, f"+{up}")
    write_export(tracked, output)
    frames, vertical = len(tracked.frame_numbers), tracked.cameras.up
    values = {"file": output, "frames": frames, "fps": tracked.fps, "up": vertical}
    console.result(values, f"{output}: {frames} frames, {vertical} up")
