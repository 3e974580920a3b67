"""``mmocap calib check``: which camera disagrees with the others, and why."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from mmocap_warp.cli.calib_adjusting import AdjustFlags
from mmocap_warp.cli.calib_units import in_units
from mmocap_warp.cli.console import CHECK_FAILED, OK, Console, Identity, Switch, table

if TYPE_CHECKING:
    from mmocap_warp.calibration.camera_check import CameraCheck, Finding

_BEFORE, _AFTER = (60, 60, 230), (80, 200, 60)  # BGR
_SEEN = 110  # gray of a mask


def check(
    scene: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    identity: Identity = None,
    flags: AdjustFlags | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> int:
    """Say which camera of a scene disagrees with the others, by how much, and what is probably wrong with it.

    Parameters
    ----------
    scene
        The scene file, or its folder.
    output
        Folder for a picture of each camera that disagrees: its mask, and the outline of the body of the other views
        as it is calibrated (red) and as it would be put right (green).
    force
        Write into a folder that holds files.
    """
    from mmocap_warp.calibration.adjust.adjustment import AdjustConfig
    from mmocap_warp.calibration.camera_check import check as checked
    from mmocap_warp.commands.inputs import note_others, scene_from
    from mmocap_warp.commands.outputs import new_folder
    from mmocap_warp.commands.settings import start_warp
    from mmocap_warp.errors import UsageError

    console, flags = console or Console(), flags or AdjustFlags()
    loaded = scene_from(scene, flags.frames, identity)
    folder = None if output is None else new_folder(output, force=force)
    note_others(loaded, console)
    try:
        config = AdjustConfig(**flags.settings)
    except ValueError as error:
        raise UsageError.of_setting(error) from None
    start = flags.generic_body(loaded)
    start_warp(config.device)
    with console.stage("check", None) as progress:
        found = checked(loaded, start, config, lambda stage, done: progress(round(100 * done), 100))
    names = loaded.calibrated.names
    pictures = [] if folder is None else _pictures(found, folder)
    overlaps = [None] * len(names) if found.overlap is None else found.overlap.tolist()
    values: dict[str, Any] = {
        "cameras": {
            name: {
                "covered_by_the_others": found.covered[k],
                "iou": None if found.overlap is None else found.overlap[k],
            }
            for k, name in enumerate(names)
        },
        "findings": [_value(finding, found, names.index(finding.camera)) for finding in found.findings],
        "pictures": pictures,
    }
    rows: list[tuple[str, ...]] = [("camera", "covered by the others' hull", "IoU with the body")]
    for name, covered, overlap in zip(names, found.covered, overlaps, strict=True):
        rows.append((name, f"{covered:.3f}", "" if overlap is None else f"{overlap:.3f}"))
    lines = [table(rows)]
    lines += [_line(finding, found, names.index(finding.camera)) for finding in found.findings]
    lines += [str(picture) for picture in pictures]
    if not found.findings:
        lines.append("no camera disagrees with the others")
    console.result(values, "\n".join(lines))
    return CHECK_FAILED if found.findings else OK


def _line(finding: Finding, found: CameraCheck, k: int) -> str:
    """A finding in words."""
    if finding.cause == "mirrored":
        return f"{finding.camera}: its pictures are mirrored"
    if finding.cause == "wrong file":
        return f"{finding.camera} and {finding.other}: one has the other's masks, or its calibration"
    if finding.size is not None:
        return f"{finding.camera}: its pictures are {finding.size:.3g} times as large as those it was calibrated for"
    changes = ", ".join(f"{what} {by:+.2f} {unit}" for what, by, unit in _changes(finding, found, k))
    others = "".join(f", or else its {other}" for other in finding.others)
    said = f"probably its {finding.cause}, to be changed by {changes}{others}"
    return f"{finding.camera}: {said}; explains {100 * finding.explained:.0f} % of what is wrong"


def _changes(finding: Finding, found: CameraCheck, k: int) -> list[tuple[str, float, str]]:
    from mmocap_warp.calibration.adjust.camera_changes import KINDS
    from mmocap_warp.calibration.camera_check import CAUSES

    if finding.change is None:
        return []
    own = range(len(KINDS))[CAUSES[finding.cause]]
    return [
        (KINDS[kind].replace("_", " "), *in_units(KINDS[kind], finding.change[k, kind], found.scale)) for kind in own
    ]


def _value(finding: Finding, found: CameraCheck, k: int) -> dict[str, Any]:
    by = {what: {"by": value, "unit": unit} for what, value, unit in _changes(finding, found, k)}
    return {
        "camera": finding.camera,
        "cause": finding.cause,
        "other": finding.other,
        "by": by,
        "or": finding.others,
        "size": finding.size,
        "explains": finding.explained,
    }


def _pictures(found: CameraCheck, folder: Path) -> list[Path]:
    """A picture of each camera for which the body is known as it is calibrated and as it would be put right."""
    import cv2
    import numpy as np

    from mmocap_warp.formats.png import write_png

    files = []
    for seen in found.views:
        image = np.where(seen.mask[..., None], _SEEN, 0).astype(np.uint8).repeat(3, axis=2)
        for drawn, colour in ((seen.before, _BEFORE), (seen.after, _AFTER)):
            outline, _ = cv2.findContours(drawn.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(image, outline, -1, colour, 1, cv2.LINE_AA)
        files.append(folder / f"{seen.camera}.png")
        write_png(files[-1], image)
    return files
