"""``mmocap calib refine``: cameras and their times, made better by the person before them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from mmocap_warp.cli.calib_adjusting import AdjustFlags
from mmocap_warp.cli.calib_units import in_units
from mmocap_warp.cli.console import CHECK_FAILED, OK, Console, Identity, Switch, table
from mmocap_warp.errors import UsageError

if TYPE_CHECKING:
    import numpy as np

    from mmocap_warp.calibration.adjust.adjustment import AdjustConfig
    from mmocap_warp.calibration.refine.refinement import Refinement
    from mmocap_warp.scene.recording import Scene


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class DoubtFlags:
    """How far each camera may be from its calibration, as standard deviations; 0 keeps it as it is."""

    rotation: float | None = None
    """How far a camera may be turned about each of its axes [degrees]; 0 holds it. [default: 5]"""
    position: float | None = None
    """How far it may be off along each of its axes [m]; 0 holds it. [default: 0.2]"""
    focal: float | None = None
    """How far its focal length may be off, as a share of it; 0 holds it. [default: 0.02]"""
    centre: float | None = None
    """How far its principal point may be off, as a share of the image's larger side; 0 holds it. [default: 0.01]"""
    offset: float | None = None
    """How far it may lag or lead [s]; 0 holds it. [default: 0.05]"""


def refine(
    scene: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("calibration.toml"),
    fixed: str | None = None,
    height: float | None = None,
    distance: tuple[str, str, float] | None = None,
    identity: Identity = None,
    doubt: DoubtFlags | None = None,
    flags: AdjustFlags | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> int:
    """Refine a scene's cameras and their times together with the body and the poses of the person before them.

    Parameters
    ----------
    scene
        The scene file, or its folder.
    output
        The refined calibration: a .toml file.
    fixed
        The camera that stands still and tells the time. [default: the one beside which the others move least]
    height
        Of the person [m]: gives the scale.
    distance
        Two cameras and the metres between their centres, such as cam01 cam02 3.20: gives the scale.
    force
        Replace a file that exists.
    """
    from dataclasses import asdict

    from mmocap_warp.calibration.adjust.adjustment import AdjustConfig
    from mmocap_warp.calibration.adjust.camera_changes import Deviations
    from mmocap_warp.calibration.refine.refinement import refine as refined
    from mmocap_warp.commands.inputs import note_others, scene_from
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.commands.settings import start_warp
    from mmocap_warp.formats.calibration.toml_rig import write_toml_rig

    console, flags = console or Console(), flags or AdjustFlags()
    new_file(output, ".toml", force=force)
    loaded = scene_from(scene, flags.frames, identity)
    note_others(loaded, console)
    doubts = {name: value for name, value in asdict(doubt or DoubtFlags()).items() if value is not None}
    try:
        config = AdjustConfig(
            deviations=Deviations(**doubts), fixed=fixed, height=height, distance=distance, **flags.settings
        )
        _check_cameras(config, loaded)
    except ValueError as error:
        raise UsageError.of_setting(error) from None
    start = flags.generic_body(loaded)
    start_warp(config.device)
    with console.stage("refine", None) as progress:
        found = refined(loaded, start, config, lambda stage, done: progress(round(100 * done), 100))
    values = _values(found, loaded) | {"file": output if found.better else None}
    lines = [*_lines(found, loaded)]
    if found.better:
        write_toml_rig(output, found.rig, offsets=_offsets(found, loaded))
        lines.append(f"{output}: {int(found.moved.any(axis=1).sum())} of {len(found.rig)} cameras changed")
        lines += _scene_lines(found, loaded)
    else:
        why = "frames that had no part are explained no better than before" if found.moved.any() else "nothing moved"
        lines.append(f"not written, and the scene's calibration stays as it is: {why}")
    console.result(values, "\n".join(lines))
    return OK if found.better else CHECK_FAILED


def _check_cameras(config: AdjustConfig, scene: Scene) -> None:
    for flag, name in (("fixed", config.fixed), *(("distance", name) for name in (config.distance or ())[:2])):
        if name is not None and name not in scene.calibrated.names:
            raise ValueError(f"{flag} must name one of {', '.join(scene.calibrated.names)}, got {name}")


def _offsets(found: Refinement, scene: Scene) -> dict[str, float]:
    """By how much each camera's frames are late now [s], as the scene takes it."""
    from mmocap_warp.calibration.adjust.camera_changes import OFFSET

    return {
        source.name: round((source.frame_offset + source.fraction) / (scene.fps * source.rate) + float(change), 6)
        for source, change in zip(scene.cameras, found.change[:, OFFSET], strict=True)
    }


def _values(found: Refinement, scene: Scene) -> dict[str, Any]:
    from mmocap_warp.calibration.adjust.camera_changes import KINDS

    names = found.rig.names
    cameras = {
        name: {
            kind: {
                "by": in_units(kind, value)[0],
                "sigma": in_units(kind, sigma)[0],
                "unit": in_units(kind, value)[1],
                "moved": moved,
                "determined": not undetermined,
            }
            for kind, value, sigma, moved, undetermined in zip(
                KINDS, found.change[k], found.sigma[k], found.moved[k], found.undetermined[k], strict=True
            )
        }
        for k, name in enumerate(names)
    }
    judged = {
        when: {
            "iou": dict(zip(names, each.together, strict=True)),
            "iou_by_the_others": dict(zip(names, each.apart, strict=True)),
        }
        for when, each in (("before", found.before), ("after", found.after))
    }
    return {
        "better": found.better,
        "fixed": names[found.fixed],
        "cameras": cameras,
        "offset_s": _offsets(found, scene),
        **judged,
    }


def _lines(found: Refinement, scene: Scene) -> list[str]:
    """What moved, what did not, and what that is worth, for people."""
    import numpy as np

    from mmocap_warp.calibration.adjust.camera_changes import KINDS

    names = found.rig.names
    rows: list[tuple[str, ...]] = [("camera", "moved", "by", "+-", "")]
    for k, kind in np.argwhere(found.moved):
        by, unit = in_units(KINDS[kind], found.change[k, kind])
        sigma, _ = in_units(KINDS[kind], found.sigma[k, kind])
        rows.append((names[k], KINDS[kind].replace("_", " "), f"{by:+.2f}", f"{sigma:.2f}", unit))
    lines = [table(rows)] if len(rows) > 1 else ["no camera has to change"]
    lines.append(f"fixed: {names[found.fixed]}; what is not named stayed exactly as it was")
    unknown = [f"{names[k]} {KINDS[kind].replace('_', ' ')}" for k, kind in np.argwhere(found.undetermined)]
    if unknown:
        lines.append(f"not determined by these masks: {', '.join(unknown)}")
    judged: list[tuple[str, ...]] = [("held-out frames", "IoU before", "after", "by the others before", "after")]
    columns = (found.before.together, found.after.together, found.before.apart, found.after.apart)
    for k, name in enumerate(names):
        judged.append((name, *(f"{column[k]:.3f}" for column in columns)))
    judged.append(("mean", *(f"{_mean(column):.3f}" for column in columns)))
    return [*lines, table(judged)]


def _mean(values: np.ndarray) -> float:
    import numpy as np

    return float(np.nanmean(values))


def _scene_lines(found: Refinement, scene: Scene) -> list[str]:
    """What is to be changed in the scene file."""
    from mmocap_warp.calibration.adjust.camera_changes import OFFSET

    lines = []
    if any(source.centre_shift != (0.0, 0.0) for source in scene.cameras):
        lines.append("its principal points hold the scene's centre_shift: leave that out with this calibration")
    late = _offsets(found, scene)
    for k, source in enumerate(scene.cameras):
        if found.moved[k, OFFSET]:
            lines.append(f"in the scene, [cameras.{source.name}] offset = {late[source.name]:g}")
    return lines
