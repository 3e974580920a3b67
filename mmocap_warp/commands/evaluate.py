"""How good a result is, and what it measures: ``mmocap eval`` and ``measure``."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from mmocap_warp.biomechanics import measure_all
from mmocap_warp.biomechanics.measure_all import Measures
from mmocap_warp.biomechanics.measure_tables import write_tables
from mmocap_warp.body.joint_sets import RIG, JointSet
from mmocap_warp.body.joint_sets import joint_set as set_named
from mmocap_warp.commands.caller import Reporter, start_warp
from mmocap_warp.commands.inputs import Frames, positions_of, result_from, scene_of, truth_of
from mmocap_warp.commands.outputs import new_folder, releases_locks
from mmocap_warp.display.result_plots import plot_angles, plot_feet
from mmocap_warp.display.result_video import check_same_recording
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.result import evaluation
from mmocap_warp.result.other_world import axes_after
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.result.verdict import verdict
from mmocap_warp.scene.recording import Scene


def evaluate(
    result: Result | str | Path,
    truth: Truth | str | Path | None = None,
    *,
    truth_axes: str | None = None,
    scene: Scene | str | Path | None = None,
    frames: Frames = None,
    joint_set: str | Path = "rig",
    reporter: Reporter | None = None,
) -> dict[str, Any]:
    """How good a result is: overlap with the masks, and errors in millimetres where the truth is known.

    A warning says where the truth is in another world than the result, and how to mend that.

    Args:
        result: what was tracked, or its file.
        truth: true markers or joints: .usdc, .usda or .trc. [default: the scene's own]
        truth_axes: of a .trc: which of its axes are the world's x, y and z. [default: xyz; of the scene's own, its]
        scene: the scene, if it is no longer where the result says.
        frames: which of the result's frames. [default: all]
        joint_set: by which definitions joints are compared: rig, isb, coco17, body25, h36m17, humaneva, rajagopal,
            soma77, or a .toml file.
        reporter: receives warnings.

    Returns:
        What :func:`mmocap_warp.result.evaluation.evaluate` gives and, as ``verdict``, how far it is to be
        trusted, see :func:`mmocap_warp.result.verdict.verdict`.

    Raises:
        InputError: a file that cannot be read, or a truth of other frames or of a body with other joints.
        UsageError: the result has none of these frames.
    """
    tracked, path = result_from(result)
    tracked = tracked.at(positions_of(tracked, frames))
    named_by, file, recorded = "scene" if truth is None and truth_axes is None else "truth", None, None
    axes_are_given = truth_axes is not None
    if truth is None and (recorded := scene_of(tracked, path, scene, reporter)) is not None:
        check_same_recording(tracked, recorded)
        recorded = replace(recorded, truth_axes=truth_axes or recorded.truth_axes)
        truth, file, truth_axes = truth_of(recorded), recorded.truth, recorded.truth_axes
    elif truth_axes is not None and isinstance(truth, Truth):
        raise UsageError("--truth-axes are of a file of the truth: leave them out")
    elif isinstance(truth, str | Path):
        file = Path(truth)
        truth = load_truth(file, truth_axes or "xyz")
    if axes_are_given and truth is None:
        raise UsageError("there is no truth that --truth-axes could be of: give its file with --truth")
    start_warp()
    points = None if joint_set == RIG else set_named(joint_set, tracked.subject.body)
    report, fault = _judged(tracked, truth, file, truth_axes or "xyz", named_by, points)
    report["verdict"] = verdict(tracked, None if recorded is None else recorded.path)
    if fault is not None:
        (reporter or Reporter()).warn(f"check failed: {fault}")
    return report


def evaluate_in_scene(result: Result, scene: Scene) -> tuple[dict[str, Any], str | None]:
    """As :func:`evaluate`, without what it says of each frame, and a line where the scene's truth is in another world.

    Raises:
        InputError: the truth is of other frames, or of a body with other joints.
    """
    report, fault = _judged(result, truth_of(scene), scene.truth, scene.truth_axes, "scene")
    del report["series"]
    return report | {"verdict": verdict(result, scene.path)}, fault


def _judged(
    result: Result, truth: Truth | None, file: Path | None, axes: str, named_by: str, joint_set: JointSet | None = None
) -> tuple[dict[str, Any], str | None]:
    """The report, and a line where the truth, which ``file`` holds, is in another world."""
    try:
        report = evaluation.evaluate(result, truth, joint_set)
    except InputError as error:
        raise InputError(file or error.source, error.problem, error.remedy) from None
    return report, None if report.get("other_world") is None else _other_world(report, file, axes, named_by)


def _other_world(report: dict[str, Any], truth: Path | None, axes: str, named_by: str) -> str:
    """What is wrong with a truth in another world, whose file or scene has ``axes``, and the remedy."""
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


@releases_locks
def measure(
    result: Result | str | Path,
    run: int | None = None,
    raw: bool = False,
    sex: Literal["female", "male"] | None = None,
    *,
    output: str | Path | None = None,
    frames: Frames = None,
    joint_set: str | Path = "rig",
    force: bool = False,
) -> Measures:
    """Joint angles, heel strikes, steps, the centre of mass and the lengths of the bones, of every frame.

    Args:
        result: what was tracked, or its file.
        run: the number of one run. [default: all]
        raw: measure the track before it was smoothed.
        sex: whose shares of mass the body's segments have: female or male. [default: the mean of both]
        output: a folder for every frame's figures as .csv, and plots of angles and feet as .svg.
        frames: which of the result's frames. [default: all]
        joint_set: whose centres the table of joints, the lengths of bones and the angles go by, as eval takes it.
        force: write into a folder that holds something.

    Returns:
        The measures; docs/measures.md defines every figure, :func:`mmocap_warp.biomechanics.measure_tables.report`
        sums them up, and ``files`` are those that were written.

    Raises:
        UsageError: no such run or frames, or no track before it was smoothed.
        InputError: a file that is no result, or a folder that cannot be written.
    """
    tracked, _ = result_from(result)
    tracked = tracked.at(positions_of(tracked, frames))
    if sex not in (None, "female", "male"):
        raise UsageError(f"--sex must be female or male, got {sex}")
    if raw and tracked.raw_pose is None:
        raise UsageError("--raw needs a result that was smoothed; this one was not: leave --raw out")
    points = None if joint_set == RIG else set_named(joint_set, tracked.subject.body)
    start_warp()
    measures = measure_all.measure(tracked, run, raw, sex, points)
    if output is None:
        return measures
    folder = new_folder(output, force=force)
    written, shown = write_tables(folder, measures), measures.shown
    for name, plot, was_measured in (("angles", plot_angles, shown.angles), ("feet", plot_feet, shown.feet)):
        if was_measured:
            written.append(folder / f"{name}.svg")
            plot(written[-1], measures)
    return replace(measures, files=tuple(written))
