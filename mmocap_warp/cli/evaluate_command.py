"""``mmocap eval``: how good a result is."""

from __future__ import annotations

from pathlib import Path

from mmocap_warp.cli.console import Console
from mmocap_warp.cli.exit_codes import CHECK_FAILED, OK


def evaluate(
    result: Path,
    /,
    *,
    truth: Path | None = None,
    truth_axes: str = "xyz",
    scene: Path | None = None,
    frames: str | None = None,
    console: Console | None = None,
) -> int:
    """Print a result's IoU, and its errors in millimetres where the truth is known.

    Exits with 4 where the truth is in another world than the result, and says how to mend that.

    Parameters
    ----------
    result
        What 'mmocap track' wrote.
    truth
        True markers or joints: .usdc, .usda or .trc. The scene's own by default.
    truth_axes
        Of a .trc: which of its axes are the world's x, y and z, such as zxy.
    scene
        The scene, if it is no longer where the result says.
    frames
        Which of the result's frames: first:end or first:end:stride by the recording's numbers, or a count. All by
        default.
    """
    from mmocap_warp.cli.devices import start_warp
    from mmocap_warp.cli.result_report import other_world_line, positions_of, report_of, scene_of, summary, truth_of
    from mmocap_warp.formats.truth_file import load_truth
    from mmocap_warp.formats.usd.usd_result import read_result

    console = console or Console()
    tracked = read_result(result)
    positions = positions_of(tracked, frames)
    of_scene = scene_of(tracked, result, scene) if truth is None else None
    known = load_truth(truth, truth_axes) if truth else truth_of(of_scene)
    start_warp()
    file, axes = (truth, truth_axes) if of_scene is None else (of_scene.truth, of_scene.truth_axes)
    report = report_of(tracked.at(positions), known, file)
    console.result(report, summary(report))
    if report.get("other_world") is None:
        return OK
    console.warn(f"check failed: {other_world_line(report, file, axes, 'truth' if truth else 'scene')}")
    return CHECK_FAILED
