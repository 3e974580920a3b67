"""``mmocap eval``: how good a result is."""

from __future__ import annotations

from pathlib import Path

from mmocap_warp.cli.console import Console


def evaluate(
    result: Path,
    /,
    *,
    truth: Path | None = None,
    truth_axes: str = "xyz",
    scene: Path | None = None,
    frames: str | None = None,
    console: Console | None = None,
) -> None:
    """Print a result's IoU, and its errors in millimetres where the truth is known.

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
    from mmocap_warp.cli.judging import positions_of, scene_of, summary, truth_of
    from mmocap_warp.formats.truth import load_truth
    from mmocap_warp.formats.usd.result import read_result
    from mmocap_warp.result.evaluation import evaluate

    console = console or Console()
    tracked = read_result(result)
    positions = positions_of(tracked, frames)
    known = load_truth(truth, truth_axes) if truth else truth_of(scene_of(tracked, result, scene))
    start_warp()
    report = evaluate(tracked.at(positions), known)
    console.result(report, summary(report))
