"""``mmocap calib check`` and ``refine``: cameras judged and made better by the person before them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mmocap_warp.calibration.adjust.camera_changes import KINDS, OFFSET, AdjustConfig, Deviations
from mmocap_warp.cli.command import Answer, Given, attributes, command
from mmocap_warp.cli.console import Pictures, checked, flags_of, given, next_step, table
from mmocap_warp.formats.toml_table import quoted_path
from mmocap_warp.tracking.track_config import REFINE

if TYPE_CHECKING:
    from mmocap_warp.calibration.camera_check import CameraCheck, Finding
    from mmocap_warp.calibration.refine.refinement import Overlaps, Refinement
    from mmocap_warp.scene.recording import Scene

AdjustFlags, DeviationFlags = flags_of(AdjustConfig), flags_of(Deviations)

# The unit in which each of ``camera_changes.KINDS`` is shown, and what its own value is multiplied by.
_UNITS: dict[str, tuple[str, float]] = {
    **dict.fromkeys(("tilt", "pan", "roll"), ("deg", 57.29577951308232)),
    **dict.fromkeys(("right", "down", "ahead"), ("mm", 1000.0)),
    "focal": ("%", 100.0),
    **dict.fromkeys(("centre_x", "centre_y"), ("px", 1.0)),
    "radial": ("", 1.0),
    "offset": ("ms", 1000.0),
}


@command(
    "calibrate:check_cameras",
    order="pictures identity person body frames",
    pictures=Pictures,
    settings=AdjustFlags | None,
)
def check(call: Any, loaded: Scene) -> Answer:
    result = call()
    overlaps = [None] * len(result.names) if result.overlap is None else result.overlap.tolist()
    covered = [None if math.isnan(share) else share for share in result.covered]
    judged = list(zip(result.names, covered, overlaps, strict=True))
    rows = [(name, *("-" if share is None else f"{share:.3f}" for share in shares)) for name, *shares in judged]
    lines = [table([("camera", "covered by the others' hull", "IoU with the body"), *rows])]
    lines += [_finding_line(finding, result) for finding in result.findings]
    lines += [str(picture) for picture in result.pictures]
    if not result.findings:
        lines.append("no camera disagrees with the others; if frames are not trusted, look at the masks (mmocap show)")
    step = next_step("calib", "refine", loaded.path, "-o", loaded.path.parent / "calibration-refined.toml")
    if can_be_refined := bool(result.findings) and all(finding.change is not None for finding in result.findings):
        lines.append(f"next: {step}")
    values = {
        "next": step if can_be_refined else None,
        "cameras": {name: {"covered_by_the_others": covered, "iou": iou} for name, covered, iou in judged},
        "findings": [_finding_values(finding, result) for finding in result.findings],
        "pictures": result.pictures,
    }
    return Answer(values, lines, checked(not result.findings))


def _finding_line(finding: Finding, result: CameraCheck) -> str:
    """A finding in words."""
    if finding.words:
        return finding.words
    changes = ", ".join(f"{what} {by:+.2f} {unit}" for what, by, unit in _changes(finding, result))
    others = "".join(f", or else its {other}" for other in finding.others)
    cause = f"probably its {finding.cause}, to be changed by {changes}{others}"
    return f"{finding.camera}: {cause}; explains {100 * finding.explained:.0f} % of what is wrong"


def _finding_values(finding: Finding, result: CameraCheck) -> dict[str, Any]:
    """A finding for programs."""
    changes = {what: {"by": value, "unit": unit} for what, value, unit in _changes(finding, result)}
    mistake = finding.mistake
    other = mistake.cameras[1] if mistake and mistake.cameras and len(mistake.cameras) > 1 else None
    values = attributes(finding, "camera", "cause") | {"other": other, "by": changes, "or": finding.others}
    return values | {"size": mistake and mistake.size, "explains": finding.explained}


def _changes(finding: Finding, result: CameraCheck) -> list[tuple[str, float, str]]:
    """The parameters that put a camera right: name, value and unit."""
    from mmocap_warp.calibration.camera_check import CAUSES

    if finding.change is None:
        return []
    own = finding.change[result.names.index(finding.camera)]
    kinds = range(len(KINDS))[CAUSES[finding.cause]]
    return [(KINDS[kind].replace("_", " "), *_in_units(KINDS[kind], own[kind], result.scale)) for kind in kinds]


def _in_units(kind: str, value: float, scale: float = 1.0) -> tuple[float, str]:
    """A parameter's value and its unit; pixels of images at ``scale`` become those of the calibrated ones."""
    unit, size = _UNITS[kind]
    return float(value) * size / (scale if unit == "px" else 1.0), unit


@command(
    "calibrate:refine_cameras",
    order="output fixed height distance identity person deviations body frames",
    output=Given(Path, Path("calibration.toml")),
    deviations=DeviationFlags | None,
    settings=AdjustFlags | None,
)
def refine(call: Any, loaded: Scene, output: Path, deviations: Any) -> Answer:
    result = call(**given(deviations))
    lines = _refinement_lines(result)
    if result.better:
        lines.append(f"{output}: {int(result.moved.any(axis=1).sum())} of {len(result.rig)} cameras changed")
        lines += _scene_lines(result, loaded)
        named = quoted_path(output, loaded.path.resolve().parent)
        made = any(source.mask_mark for source in loaded.cameras)
        options = ("--cameras", REFINE) if made else ()
        step = next_step("track", loaded.path, "-o", loaded.path.parent / "result.usdc", *options)
        lines += ["the masks belong to the calibration that they were made with"] if made else []
        lines.append(f"next: {step}" if made else f"next: set calibration = {named} under [cameras], then {step}")
    else:
        why = "held-out frames are not explained better" if result.moved.any() else "no camera has to change"
        lines.append(f"nothing is written: {why}")
    values = _refinement_values(result, loaded) | {"file": output if result.better else None}
    return Answer(values, lines, checked(result.better))


def _refinement_values(result: Refinement, scene: Scene) -> dict[str, Any]:
    names = result.rig.names

    def parameter(k: int, kind: int) -> dict[str, Any]:
        (by, unit), (sigma, _) = (_in_units(KINDS[kind], values[k, kind]) for values in (result.change, result.sigma))
        moved, determined = result.moved[k, kind], not result.undetermined[k, kind]
        return {"by": by, "sigma": sigma, "unit": unit, "moved": moved, "determined": determined}

    def overlaps(each: Overlaps) -> dict[str, Any]:
        by_camera = (dict(zip(names, values, strict=True)) for values in (each.together, each.apart))
        return dict(zip(("iou", "iou_by_the_others"), by_camera, strict=True))

    return {
        "better": result.better,
        "fixed": None if result.fixed is None else names[result.fixed],
        "cameras": {of: {what: parameter(k, kind) for kind, what in enumerate(KINDS)} for k, of in enumerate(names)},
        "offset_s": result.offsets(scene),
        "before": overlaps(result.before),
        "after": overlaps(result.after),
    }


def _refinement_lines(result: Refinement) -> list[str]:
    """What moved, what did not, and what that is worth, for people."""
    import numpy as np

    names = result.rig.names
    rows: list[tuple[str, ...]] = [("camera", "moved", "by", "+-", "")]
    for k, kind in np.argwhere(result.moved):
        by, unit = _in_units(KINDS[kind], result.change[k, kind])
        sigma, _ = _in_units(KINDS[kind], result.sigma[k, kind])
        rows.append((names[k], KINDS[kind].replace("_", " "), f"{by:+.2f}", f"{sigma:.2f}", unit))
    lines = [table(rows)] if len(rows) > 1 else ["no camera has to change"]
    fixed = "all cameras in their places" if result.fixed is None else names[result.fixed]
    lines.append(f"fixed: {fixed}; parameters that are not listed have not changed")
    if unknown := [f"{names[k]} {KINDS[kind].replace('_', ' ')}" for k, kind in np.argwhere(result.undetermined)]:
        lines.append(f"not determined by these masks: {', '.join(unknown)}")
    held_out: list[tuple[str, ...]] = [("held-out frames", "IoU before", "after", "by the others before", "after")]
    columns = (result.before.together, result.after.together, result.before.apart, result.after.apart)
    held_out += [(name, *(f"{column[k]:.3f}" for column in columns)) for k, name in enumerate(names)]
    held_out.append(("mean", *(f"{np.nanmean(column):.3f}" for column in columns)))
    return [*lines, table(held_out)]


def _scene_lines(result: Refinement, scene: Scene) -> list[str]:
    """What is to be changed in the scene file."""
    lines = []
    if any(source.centre_shift != (0.0, 0.0) for source in scene.cameras):
        lines.append("remove centre_shift from the scene: the new principal points contain it")
    offsets = result.offsets(scene)
    for k, source in enumerate(scene.cameras):
        if result.moved[k, OFFSET]:
            lines.append(f"in the scene, [cameras.{source.name}] offset = {offsets[source.name]:g}")
    return lines
