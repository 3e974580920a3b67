"""What the commands that look at a result share: its scene, its truth, and how good it is."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mmocap_warp.cli.console import Console, table
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
        return load_scene(named, identity)
    if reference is None:
        return None
    recorded = path.parent / reference
    if not recorded.exists():
        raise InputError(path, f"was made from {recorded}, which is not there", "name the scene with --scene")
    return load_scene(recorded, identity)


def truth_of(scene: Scene | None) -> Truth | None:
    """The truth that the scene names."""
    from mmocap_warp.formats.truth import load_truth

    if scene is None or scene.truth is None:
        return None
    return load_truth(scene.truth, scene.truth_axes)


def summary(report: dict[str, Any]) -> str:
    """The headline numbers of :func:`mmocap_warp.result.evaluation.evaluate` for people."""
    rows = [
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
    if report.get("growth") is not None:
        rows.append(("growth of MPJPE", f"{report['growth']:.2f} (last third over first)"))
    if report.get("limb_lost_frames"):
        rows.append(("limb lost in", f"{len(report['limb_lost_frames'])} frames"))
    if report.get("wrongly_tracked"):
        rows.append(("wrongly tracked", f"{report['wrongly_tracked']} frames"))
    return table(rows)


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


def draw_result(result: Result, scene: Scene | None, video: Path, sheet: Path, console: Console) -> None:
    """Write the overlay video and the contact sheet, over the scene's images and masks where there is a scene.

    Masks are those that were tracked; images may be larger, so that a result of small masks can still be judged.
    """
    from mmocap_warp.cli.progress import Progress
    from mmocap_warp.drawing.show import check_same_recording, show
    from mmocap_warp.tracking.body_masks import tracked_masks

    frames = len(result.frame_numbers)
    images = masks = None
    if scene is not None:
        tracked = float(result.config.get("scale", 1.0))
        drawn = min(1.0, max(tracked, _DRAWN_LENGTH / int(scene.calibrated.size.max())))
        first = int(result.frame_numbers[0])
        check_same_recording(result, scene)
        images, masks = scene.images(drawn, first, frames), tracked_masks(scene, result)
    with Progress("show", quiet=console.quiet) as progress:
        show(result, images, masks, video=video, sheet=sheet, progress=lambda done: progress(done, frames))


def draw_subject(subject: Subject, scene: Scene | None, sheet: Path) -> None:
    """Draw a subject over its scene's first frame, or alone where there is no scene."""
    from mmocap_warp.drawing.show import show_subject

    if scene is None:
        show_subject(subject, sheet)
        return
    drawn = min(1.0, _DRAWN_LENGTH / int(scene.calibrated.size.max()))
    images, masks = next(scene.images(drawn, 0, 1)), next(scene.masks(drawn, 0, 1))
    show_subject(subject, sheet, scene.rig(drawn), images, masks)
