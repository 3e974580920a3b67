"""``mmocap export``: a result's animation for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch


def export(
    result: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a result's animation alone: body, skeleton and motion of the best run.

    Parameters
    ----------
    result
        What 'mmocap track' wrote.
    output
        The animation's file: .usda, .usdc or .usdz.
    force
        Replace a file that exists.
    """
    from mmocap_warp.cli.devices import start_warp
    from mmocap_warp.cli.outputs import new_file
    from mmocap_warp.formats.usd.animation import export_animation
    from mmocap_warp.formats.usd.result import read_result

    console = console or Console()
    new_file(output, ".usda", ".usdc", ".usdz", force=force)
    tracked = read_result(result)
    start_warp()
    export_animation(tracked, output)
    frames = len(tracked.frame_numbers)
    console.result({"file": output, "frames": frames, "fps": tracked.fps}, f"{output}: {frames} frames")
