"""What the commands that look at a result share: its scene, its truth, and how good it is."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mmocap_warp.cli.console import Console, table
from mmocap_warp.cli.exit_codes import UsageError
from mmocap_warp.cli.flag_settings import as_flag
from mmocap_warp.errors import InputError

if TYPE_CHECKING:
    from mmocap_warp.body.model import Subject
    from mmocap_warp.result.result import Result
    from mmocap_warp.result.truth import Truth
    from mmocap_warp.scene.recording import Scene

_DRAWN_LENGTH = 800
"""The longer side of the images that a result is drawn over, at least, where the recording has it [px]."""


def scene_reference(scene: Path, result: Path) -> str:
    """How a result's configuration names its scene: relative to the result, so that both can move together."""
    return Path(os.path.relpath(scene.resolve(), result.resolve().parent)).as_posix()


def scene_for(path: Path, frames: str | None, identity: int | None = None, *, calibrated: bool = True) -> Scene:
    """A scene, with the frames and the person that ``--frames`` and ``--identity`` ask for; it may do without a
    calibration.

    Raises:
        InputError: the scene is wrong.
        UsageError: it does not have these frames.
    """
    from mmocap_warp.scene.scene_toml import load_scene

    try:
        return load_scene(path, frames, identity, calibrated=calibrated)
    except InputError:
        raise
    except ValueError as error:
        raise UsageError(as_flag(error)) from None


def positions_of(result: Result, frames: str | None) -> list[int]:
    """Positions in a result of the frames that ``--frames`` asks for; all of them without it.

    Raises:
        UsageError: it has none of these frames.
    """
    from mmocap_warp.scene.frame_choice import FrameChoice

    numbers = result.frame_numbers.tolist()
    if frames is None:
        return list(range(len(numbers)))
    try:
        choice = FrameChoice.parse(frames)
        if choice.count is not None:
            return list(choice.of(range(len(numbers)), len(numbers)))
        chosen = choice.of(range(0), max(numbers[-1] + 1, choice.end or 0))
    except ValueError as error:
        raise UsageError(as_flag(error)) from None
    positions = [position for position, number in enumerate(numbers) if number in chosen]
    if not positions:
        raise UsageError(f"--frames = {frames} holds none of the result's frames, {numbers[0]} to {numbers[-1]}")
    return positions


def scene_of(result: Result, path: Path, named: Path | None) -> Scene | None:
    """The scene that was tracked: the one named now, or else the one that the result names; None if neither is.

    Raises:
        InputError: the scene is wrong, or is no longer where the result says.
    """
    return recorded_scene(result.config.get("scene"), path, named, result.config.get("identity"))


def recorded_scene(reference: str | None, path: Path, named: Path | None, identity: int | None = None) -> Scene | None:
    """The scene that a file at ``path`` was made from by its ``reference``, or the one named now; None if neither is.
    Of it, the person of that ``identity``, where one was chosen.

    Raises:
        InputError: the scene is wrong, or is no longer where the reference says.
    """
    from mmocap_warp.scene.scene_toml import load_scene

    if named is not None:
        return load_scene(named, identity=identity)
    if reference is None:
        return None
    recorded = path.parent / reference
    if not recorded.exists():
        raise InputError(path, f"was made from {recorded}, which is not there", "name the scene with --scene")
    return load_scene(recorded, identity=identity)


def truth_of(scene: Scene | None) -> Truth | None:
    """The truth that the scene names."""
    from mmocap_warp.formats.truth_file import load_truth

    if scene is None or scene.truth is None:
        return None
    return load_truth(scene.truth, scene.truth_axes)


def report_of(result: Result, truth: Truth | None, file: Path | None) -> dict[str, Any]:
    """How good a result is, beside the truth that ``file`` holds.

    Raises:
        InputError: the truth is of other frames, or of a body with other joints.
    """
    from mmocap_warp.result.evaluation import evaluate

    try:
        return evaluate(result, truth)
    except InputError as error:
        raise InputError(file or error.source, error.problem, error.remedy) from None


def summary(report: dict[str, Any]) -> str:
    """The headline numbers of :func:`mmocap_warp.result.evaluation.evaluate` for people."""
    rows: list[tuple[str, ...]] = [
        ("frames", f"{report['frames']} ({_statuses(report)})"),
        ("runs", str(report["runs"])),
        ("evaluations", _number(report["evaluations"], ",d")),
        ("evaluations/s", _number(report["evaluations_per_second"], ",.0f")),
        ("mean IoU", _number(report["mean_iou"], ".3f")),
        ("worst IoU", f"{_number(report['worst_iou'], '.3f')} (frame {report['worst_iou_frame']})"),
        ("shake", f"{_number(report['shake_mm'], '.1f')} mm"),
    ]
    errors = (
        ("MPJPE", "mpjpe_mm"),
        ("PA-MPJPE", "pa_mpjpe_mm"),
        ("median joint error", "median_joint_mm"),
        ("  offsets removed", "median_joint_offsets_removed_mm"),
        ("Eq. 20 as printed", "eq20_as_printed_mm"),
        ("Eq. 20 from own answer", "marker_error_mm"),
    )
    rows += [(name, _error(report, key)) for name, key in errors if report.get(key) is not None]
    rows += [(name, f"{_number(error, '.1f')} mm") for name, error in report.get("median_mm_by_attached", {}).items()]
    if report.get("median_angle_deg") is not None and report.get("marker_error_mm") is None:  # of a robot or a hand
        rows.append(("median angle error", f"{report['median_angle_deg']:.2f} degrees"))
    rows += [(name, f"{_number(error, '.1f')} mm") for name, error in report.get("median_mm_by_shift", {}).items()]
    if report.get("growth") is not None:
        rows.append(("growth of MPJPE", f"{report['growth']:.2f} (last third over first)"))
    if report.get("limb_lost_frames"):
        rows.append(("limb lost in", f"{len(report['limb_lost_frames'])} frames"))
    if report.get("wrongly_tracked"):
        rows.append(("wrongly tracked", f"{report['wrongly_tracked']} frames"))
    return table(rows)


def beside(reports: dict[str, dict[str, Any]]) -> str:
    """Trackers by name, a row each, with the numbers that tell them apart."""
    head = ("", "Eq. 20", "MPJPE", "shake", "mean IoU", "worst IoU", "time")
    rows = [
        (
            name,
            *(f"{_number(report.get(key), '.1f')} mm" for key in ("marker_error_mm", "mpjpe_mm", "shake_mm")),
            *(_number(report[key], ".3f") for key in ("mean_iou", "worst_iou")),
            f"{report['seconds']:.1f} s",
        )
        for name, report in reports.items()
    ]
    return table([head, *rows])


def other_world_line(report: dict[str, Any], truth: Path | None, axes: str, named_by: str) -> str:
    """What is wrong where ``report`` says that the truth is in another world, and the remedy.

    Args:
        report: of :func:`mmocap_warp.result.evaluation.evaluate`.
        truth: the truth's file.
        axes: that were taken of it.
        named_by: ``"truth"`` for the flag, ``"scene"`` for the scene file.
    """
    from mmocap_warp.result.other_world import axes_after

    found = report["other_world"]
    errors = f"joints are off by {found['mpjpe_mm']:,.0f} mm that way instead of {report['mpjpe_mm']:,.0f}"
    if found["axes"] is None:
        larger = float(f"{1 / found['scale']:.2g}")
        changes = {
            f"turned by {found['turn_deg']:.0f} degrees": found["turn_deg"] > 5,
            f"{found['shift_m']:.1f} m away": found["shift_m"] > 0.1,
            f"about {larger:g} times as large": not 0.8 < found["scale"] < 1.25,
        }
        where = ", ".join(change for change, is_seen in changes.items() if is_seen)
        return f"{truth} is in another world than the result: {where}; give it in metres in the calibration's world"
    wanted = axes_after(found["axes"], axes)
    if truth is not None and truth.suffix != ".trc":
        remedy = f"write it in the calibration's world, whose x, y and z are its {wanted}"
    elif named_by == "truth":
        remedy = f"give --truth-axes={wanted}"
    else:
        remedy = f'set axes = "{wanted}" under [truth]'
    return f"{truth} has other axes than the result: {remedy} ({errors})"


def _statuses(report: dict[str, Any]) -> str:
    """How many frames were not tracked in the ordinary way."""
    parts = [f"{report['lost']} lost", f"{report['partial']} with a view lost"]
    return ", ".join(parts + [f"{report[name]} {name}" for name in ("rescued", "interpolated") if report[name]])


def _error(report: dict[str, Any], key: str) -> str:
    """An error, its floor where it has one, and the markers that it leaves out."""
    floor, left_out = (report.get(key.replace("_mm", ending)) for ending in ("_floor_mm", "_left_out"))
    notes = [f"floor {floor:.1f}"] if floor is not None else []
    notes += [f"markers left out: {left_out}"] if left_out else []
    return f"{report[key]:.1f} mm" + (f" ({', '.join(notes)})" if notes else "")


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def draw_result(
    result: Result, scene: Scene | None, video: Path, sheet: Path, console: Console, positions: list[int] | None = None
) -> None:
    """Write the overlay video and the contact sheet, over the scene's images and masks where there is a scene.

    Of all frames, or of those at ``positions`` in the result.

    Masks are those that were tracked; images may be larger, so that a result of small masks can still be judged.
    """
    from mmocap_warp.cli.progress import Progress
    from mmocap_warp.display.result_video import check_same_recording, show
    from mmocap_warp.scene.frame_choice import as_range
    from mmocap_warp.tracking.body_masks import tracked_masks

    positions = list(range(len(result.frame_numbers))) if positions is None else positions
    drawn_frames = result.at(positions)
    frames = len(positions)
    images = masks = None
    if scene is not None:
        tracked = float(result.config.get("scale", 1.0))
        drawn = min(1.0, max(tracked, _DRAWN_LENGTH / int(scene.calibrated.size.max())))
        check_same_recording(result, scene)
        seen = scene.of_frames(as_range(drawn_frames.frame_numbers.tolist()))
        images, masks = seen.images(drawn), tracked_masks(scene, result, positions)
    with Progress("show", quiet=console.quiet) as progress:
        show(drawn_frames, images, masks, video=video, sheet=sheet, progress=lambda done: progress(done, frames))


def draw_subject(subject: Subject, scene: Scene | None, sheet: Path) -> None:
    """Draw a subject over the frame of its scene that it was fitted to, or alone where there is no scene."""
    from mmocap_warp.display.result_video import show_subject

    if scene is None:
        show_subject(subject, sheet)
        return
    drawn = min(1.0, _DRAWN_LENGTH / int(scene.calibrated.size.max()))
    number = int(subject.provenance.get("fit.first_frame", 0))
    fitted = scene.of_frames(range(number, number + 1))
    images, masks = next(fitted.images(drawn)), next(fitted.masks(drawn))
    show_subject(subject, sheet, scene.rig(drawn), images, masks)
