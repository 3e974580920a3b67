"""``mmocap eval``: how good a result is."""

from __future__ import annotations

from pathlib import Path

from mmocap_warp.cli.console import CHECK_FAILED, OK, Console


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
    from mmocap_warp.cli.result_report import summary
    from mmocap_warp.commands.evaluate import evaluate

    console = console or Console()
    report = evaluate(result, truth, truth_axes=truth_axes, scene=scene, frames=frames, reporter=console)
    console.result(report, summary(report))
    return OK if report.get("other_world") is None else CHECK_FAILED
