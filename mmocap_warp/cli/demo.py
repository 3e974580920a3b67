"""``mmocap demo``: the built-in scene, tracked and compared with its truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console
from mmocap_warp.cli.exit_codes import CHECK_FAILED, OK

MOST_ERROR_MM = 30.0
"""Mean of Eq. 20 from each run's own first answer that an installation which works stays under."""


def demo(
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("mmocap-out"),
    console: Console | None = None,
) -> int:
    """Track the built-in scene and compare with its truth.

    Parameters
    ----------
    output
        Folder to write, made if it does not exist.
    """
    from mmocap_warp.cli.judging import draw_result, summary, truth_of
    from mmocap_warp.cli.outputs import new_folder
    from mmocap_warp.cli.settings import effective
    from mmocap_warp.cli.track import Start, TrackFlags, track_scene
    from mmocap_warp.drawing.plot import plot_report
    from mmocap_warp.result.evaluation import evaluate
    from mmocap_warp.scene.scene_toml import load_scene
    from mmocap_warp.scenes import ROOT
    from mmocap_warp.tracking.config import TrackConfig

    console = console or Console()
    folder = new_folder(output, force=True)
    scene = load_scene(ROOT / "walk")
    config = effective(TrackConfig, scene.settings("track"), TrackFlags())
    files = {
        "result": folder / "walk.usdc",
        "overlay": folder / "walk.webm",
        "sheet": folder / "walk.png",
        "plot": folder / "walk-error.svg",
    }
    result = track_scene(scene, config, files["result"], Start(force=True), console)
    report = evaluate(result, truth_of(scene))
    draw_result(result, scene, files["overlay"], files["sheet"], console)
    plot_report(files["plot"], report)
    del report["series"]
    good = report["marker_error_mm"] <= MOST_ERROR_MM
    lines = [summary(report), *(f"{name:<8} {path}" for name, path in files.items())]
    if not good:
        lines.append(f"check failed: Eq. 20 from own answer is over {MOST_ERROR_MM:.0f} mm")
    console.result({**report, "error_ok": good, **files}, "\n".join(lines))
    return OK if good else CHECK_FAILED
