"""What the commands that look at a result share: its scene, its truth, and how good it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mmocap_warp.cli.console import table

if TYPE_CHECKING:
    pass

_DRAWN_LENGTH = 800
"""The longer side of the images that a result is drawn over, at least, where the recording has it [px]."""


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
