"""``mmocap view``: a result as a page for a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch


def view(
    result: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    images: Switch = False,
    rerun: Path | None = None,
    scene: Path | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write one page that shows a result in any browser, without a network: body, cameras, masks, curves, all runs.

    Parameters
    ----------
    result
        What 'mmocap track' wrote.
    output
        The page's file, .html; beside the result and named after it by default.
    images
        Show the recording's images too, not its masks alone.
    rerun
        Also write the best run as a recording of Rerun's, .rrd; needs the package rerun-sdk.
    scene
        The scene, if it is no longer where the result says.
    force
        Replace a file that exists.
    """
    from mmocap_warp.commands.inputs import scene_of, truth_of
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.commands.settings import start_warp
    from mmocap_warp.display.page.rerun_file import write_rerun
    from mmocap_warp.display.page.viewer import view
    from mmocap_warp.formats.usd.usd_result import read_result

    console = console or Console()
    page = new_file(output or result.with_suffix(".html"), ".html", force=force)
    if rerun is not None:
        new_file(rerun, ".rrd", force=force)
    tracked = read_result(result)
    recorded = scene_of(tracked, result, scene)
    truth = truth_of(recorded)
    start_warp()
    if rerun is not None:
        write_rerun(rerun, tracked, recorded, truth)
    frames = len(tracked.frame_numbers)
    with console.stage("view") as progress:
        name = recorded.name if recorded is not None else result.stem
        shown = view(tracked, recorded, truth=truth, images=images, name=name, progress=progress)
    shown.write(page)
    size = page.stat().st_size
    text = f"{page}: {frames} frames, {size / 1e6:.1f} MB" + (f"\n{rerun}" if rerun is not None else "")
    console.result({"file": page, "rerun": rerun, "frames": frames, "bytes": size}, text)
