"""How good a result is: ``mmocap eval``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mmocap_warp.commands.inputs import Frames, positions_of, result_from, scene_of, truth_of
from mmocap_warp.commands.reporter import Reporter
from mmocap_warp.commands.settings import start_warp
from mmocap_warp.errors import InputError
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.result import evaluation
from mmocap_warp.result.other_world import axes_after
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.scene.recording import Scene


def evaluate(
    result: Result | str | Path,
    truth: Truth | str | Path | None = None,
    *,
    truth_axes: str = "xyz",
    scene: Scene | str | Path | None = None,
    frames: Frames = None,
    reporter: Reporter | None = None,
) -> dict[str, Any]:
    """How good a result is: overlap with the masks, and errors in millimetres where the truth is known.

    A warning says where the truth is in another world than the result, and how to mend that.

    Args:
        result: what was tracked, or its file.
        truth: true markers or joints: .usdc, .usda or .trc. [default: the scene's own]
        truth_axes: of a .trc: which of its axes are the world's x, y and z, such as zxy.
        scene: the scene, if it is no longer where the result says.
        frames: which of the result's frames. [default: all]
        reporter: who is told of warnings.

    Returns:
        What :func:`mmocap_warp.result.evaluation.evaluate` gives.

    Raises:
        InputError: a file that cannot be read, or a truth of other frames or of a body with other joints.
        UsageError: the result has none of these frames.
    """
    tracked, path = result_from(result)
    positions = positions_of(tracked, frames)
    recorded = scene_of(tracked, path, scene, reporter) if truth is None else None
    known, file, axes = _truth_in(truth, truth_axes, recorded)
    start_warp()
    report = report_of(tracked.at(positions), known, file)
    if report.get("other_world") is not None:
        line = other_world_line(report, file, axes, "scene" if truth is None else "truth")
        (reporter or Reporter()).warn(f"check failed: {line}")
    return report


def _truth_in(
    truth: Truth | str | Path | None, axes: str, scene: Scene | None
) -> tuple[Truth | None, Path | None, str]:
    """The truth, its file and the axes that are taken of it."""
    if isinstance(truth, Truth):
        return truth, None, axes
    if truth is not None:
        return load_truth(truth, axes), Path(truth), axes
    return truth_of(scene), *((None, axes) if scene is None else (scene.truth, scene.truth_axes))


def evaluate_in_scene(result: Result, scene: Scene) -> tuple[dict[str, Any], str | None]:
    """How good a result is, beside the truth that its scene names, and what is wrong with that truth.

    Returns:
        As :func:`evaluate`, without what it says of each frame; a line, or None where nothing is wrong.

    Raises:
        InputError: the truth is of other frames, or of a body with other joints.
    """
    report = report_of(result, truth_of(scene), scene.truth)
    del report["series"]
    if report.get("other_world") is None:
        return report, None
    return report, other_world_line(report, scene.truth, scene.truth_axes, "scene")


def report_of(result: Result, truth: Truth | None, file: Path | None) -> dict[str, Any]:
    """How good a result is, beside the truth that ``file`` holds.

    Raises:
        InputError: the truth is of other frames, or of a body with other joints.
    """
    try:
        return evaluation.evaluate(result, truth)
    except InputError as error:
        raise InputError(file or error.source, error.problem, error.remedy) from None


def other_world_line(report: dict[str, Any], truth: Path | None, axes: str, named_by: str) -> str:
    """What is wrong where ``report`` says that the truth is in another world, and the remedy.

    Args:
        report: of :func:`mmocap_warp.result.evaluation.evaluate`.
        truth: the truth's file; None where it has none.
        axes: that were taken of it.
        named_by: ``"truth"`` for the argument, ``"scene"`` for the scene file.
    """
    other = report["other_world"]
    errors = f"joints are off by {other['mpjpe_mm']:,.0f} mm that way instead of {report['mpjpe_mm']:,.0f}"
    source = "the truth" if truth is None else truth
    if other["axes"] is None:
        larger = float(f"{1 / other['scale']:.2g}")
        changes = {
            f"turned by {other['turn_deg']:.0f} degrees": other["turn_deg"] > 5,
            f"{other['shift_m']:.1f} m away": other["shift_m"] > 0.1,
            f"about {larger:g} times as large": not 0.8 < other["scale"] < 1.25,
        }
        where = ", ".join(change for change, is_seen in changes.items() if is_seen)
        return f"{source} is in another world than the result: {where}; give it in metres in the calibration's world"
    wanted = axes_after(other["axes"], axes)
    if truth is None or truth.suffix != ".trc":
        remedy = f"write it in the calibration's world, whose x, y and z are its {wanted}"
    elif named_by == "truth":
        remedy = f"give --truth-axes={wanted}"
    else:
        remedy = f'set axes = "{wanted}" under [truth]'
    return f"{source} has other axes than the result: {remedy} ({errors})"
