"""Commands that write or look at a scene: ``init``, ``mask``, ``cameras``, ``sync``, ``synth``, ``dataset``.

And ``validate`` of USD files.
"""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from mmocap_warp.cli.command import ANY_NUMBER, BY_PLACE, Answer, Given, attributes, command
from mmocap_warp.cli.console import Console, Pictures, SceneFrames, checked, next_step, table
from mmocap_warp.formats.table import DATASETS

if TYPE_CHECKING:
    from mmocap_warp.calibration.sync.synchronise import Synchronisation
    from mmocap_warp.masks.mask_check import MaskReport
    from mmocap_warp.scene.recording import Scene

_DECIDED_BY = {
    True: "the visual hull: these silhouettes fit into one body",
    False: "the silhouettes' motion: the calibration or the motion is too poor for the visual hull to tell",
    None: "the silhouettes' motion: right within a frame or two, better with a calibration",
}


def _mask_step(scene: Scene) -> str:
    """The command that makes a scene's masks, of large images as small as they are tracked."""
    from mmocap_warp.scene.drafting import mask_scale

    scale = mask_scale(scene)
    options = () if scale == 1 else ("--scale", f"{scale:g}")
    return next_step("mask", scene.path, "-o", scene.path.parent / "masks", *options)


def _track_step(scene: Path) -> str:
    return next_step("track", scene, "-o", scene.parent / "result.usdc")


@command("new_scenes:init")
def init(call: Any, folder: Path) -> Answer:
    draft, scene = call(), folder / "scene.toml"
    step = next_step("cameras", scene, "-o", folder / "axes")
    kind = f"a {draft.project} project, " if draft.project else ""
    lines = [f"{scene}: {kind}{len(draft.cameras)} cameras ({', '.join(draft.cameras)})"]
    lines += [f"found: {line}" for line in draft.found] + [f"missing: {line}" for line in draft.missing]
    lines.append(f"next: {'complete ' + str(scene) + ', then ' if draft.missing else ''}{step}")
    values = attributes(draft, "project", "calibration", "cameras", "found", "missing")
    return Answer({"scene": scene, **values, "next": step}, lines)


@command("mask:mask", frames=SceneFrames)
def mask(call: Any) -> Answer:
    masks = call()
    report, good = masks.report, masks.remedy is None
    step = next_step("track", masks.scene, "-o", masks.source.parent / "result.usdc")
    made = masks.consistency
    changes = {} if made is None else {"filled_px": made.filled, "cut_px": made.cut}
    views = {
        name: {"area_px": view.area, "empty_frames": int((view.area == 0).sum())}
        | attributes(view, "explained", "covered")
        | {key: [int(frame[k]) for frame in each] for key, each in changes.items()}
        for k, (name, view) in enumerate(report.views.items())
    }
    values = attributes(masks, "scene", "overlay", "frames") | {
        "views": views,
        "hull_litres": 1000 * report.volume,
        "contradicting_frames": None if made is None else made.untouched,
        "masks_ok": good,
        "faults": list(report.faults),
        "next": step if good else None,
    }
    lines = [f"{masks.scene}: {masks.frames} frames, {len(report.views)} views", *_mask_table(report, changes)]
    if made is not None and made.untouched:
        where, look = "in which views contradict each other throughout", next_step("calib", "check", masks.scene)
        lines.append(f"not made consistent: {made.untouched} frames, {where}; see {look}")
    lines += [f"next: {step}"] if good else [*(f"check failed: {fault}" for fault in report.faults), masks.remedy]
    return Answer(values, lines, checked(good))


def _mask_table(report: MaskReport, changes: dict[str, list[list[int]]]) -> list[str]:
    """Each view's areas, how many frames are empty, how well it agrees with the others, and what they changed in it."""
    import numpy as np

    heads = [("camera", ""), ("median", "px"), ("least", "px"), ("most", "px"), ("empty", "frames"), ("explained", "%")]
    heads += [("covered", "%"), *((name.removesuffix("_px"), "px") for name in changes)]
    width = [12, 8, 8, 8, 8, 10, 8, 8, 8]
    rows: list[tuple[object, ...]] = [*zip(*heads, strict=True)]
    for k, (name, view) in enumerate(report.views.items()):
        seen = view.area[view.area > 0]
        areas = (np.median(seen), seen.min(), seen.max()) if len(seen) else (0, 0, 0)
        counts = [f"{area:.0f}" for area in areas] + [(view.area == 0).sum()]
        done = (sum(frame[k] for frame in frames) for frames in changes.values())
        rows.append((name, *counts, _percent(view.explained), _percent(view.covered), *done))
    lines = [" ".join(f"{cell!s:{'>' if i else '<'}{width[i]}}" for i, cell in enumerate(row)) for row in rows]
    lines.append("explained: of its mask by the other cameras; covered: of what these see by its mask")
    return lines + (["filled, cut: in all frames, by what the other cameras see"] if changes else [])


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if share == share else "-"


@command("calibrate:show_cameras", order="pictures", pictures=Pictures)
def cameras(call: Any, scene: Path, pictures: Path | None) -> Answer:
    from mmocap_warp.scene.scene_toml import load_scene

    loaded = load_scene(scene, masks=False)
    shown = call(scene=loaded)
    masked = all(source.masks for source in loaded.cameras)
    step = _track_step(loaded.path) if masked else _mask_step(loaded)
    values = {
        "cameras": [
            {"name": row.name, "size": size, "centre_m": row.centre}
            | attributes(row, height_m="height", nearest_m="nearest", field_of_view_deg="field_of_view")
            for row, size in zip(shown.rows, shown.size, strict=True)
        ],
        **attributes(shown, "up", mean_height_m="mean_height", mean_height_ok="plausible", pictures="pictures"),
        "next": step if shown.plausible else None,
    }
    lines = [repr(shown), *shown.pictures, f"the cameras' mean height is {shown.mean_height:.2f} m along {shown.up}"]
    if pictures is not None:
        lines.append(f"{pictures}: the world's axes in {len(shown.rows)} pictures, x red, y green, z blue")
    fault = "check failed: the cameras are on average not above the floor; correct [scene] up"
    lines.append(f"next: {step}" if shown.plausible else fault)
    return Answer(values, lines, checked(shown.plausible))


@command("calibrate:sync", calibrated=False)
def sync(call: Any, loaded: Scene, write: bool) -> Answer:
    offsets = call()
    timing, faults = offsets.timing(loaded), offsets.faults(loaded)
    step = next_step("cameras", loaded.path) if loaded.calibration and loaded.calibrated.placed else None
    values = {
        "scene": loaded.path,
        "fps": offsets.fps,
        "by": "hull" if offsets.hull else "motion",
        "cameras": {
            name: {
                "offset_frames": view.frames,
                "offset_s": timing[name]["offset"],
                "margin_frames": view.margin if isfinite(view.margin) else None,
                "fps": timing[name].get("fps"),
                "jump_frames": view.course.jump,
                "jump_at": view.course.at if view.course.jump else None,
            }
            | attributes(view, "sure", rival_frames="other", rival_score="rival", agreeing="agreeing")
            for name, view in offsets.views.items()
        },
        "written": loaded.path if write and offsets.sure else None,
        "sync_ok": offsets.sure,
        "faults": faults,
        "next": step if offsets.sure else None,
    }
    lines = [_offset_table(offsets, timing), f"decided by {_DECIDED_BY[offsets.hull]}"]
    lines += [f"check failed: {fault}" for fault in faults]
    if not faults:
        lines += [f"{loaded.path}: written"] if write else _scene_lines(timing)
        lines += [f"next: {step}"] if step else []
    return Answer(values, lines, checked(offsets.sure))


def _offset_table(offsets: Synchronisation, timing: dict[str, dict[str, float]]) -> str:
    rows = [("camera", "lag [frames]", "+-", "lag [s]", "sure", "next best by motion", "others agreeing")]
    for name, view in offsets.views.items():
        rival = f"{view.other:+d} scores {100 * min(view.rival, 9.99):.0f} %"
        sure, seconds = "yes" if view.sure else "no", f"{timing[name]['offset']:+.4f}"
        margin = f"{view.margin:.1f}" if isfinite(view.margin) else "-"
        rows.append((name, f"{view.frames:+d}", margin, seconds, sure, rival, f"{100 * view.agreeing:.0f} %"))
    return table(rows)


def _scene_lines(timing: dict[str, dict[str, float]]) -> list[str]:
    """The lines of the scene file that give the offsets."""
    lines = []
    for name, keys in timing.items():
        own = [f"{key} = {value!r}" for key, value in keys.items() if value]
        lines += [f"[cameras.{name}]", *own] if own else []
    return lines or ["all cameras are in step: offsets need not be given"]


@command("new_scenes:synthesize")
def synth(call: Any, cameras: int) -> Answer:
    made = call()
    step = _track_step(made.scene)
    values = attributes(made, "scene", "motion") | {"body": made.recording.body.name, "frames": len(made.recording)}
    return Answer(values | {"cameras": cameras, "next": step}, [repr(made), f"next: {step}"])


_USAGE = "\\\n".join(dataset.usage(name) for name, dataset in DATASETS.items())
_PARTS = Given(Annotated[str, Parameter(help=_USAGE)], kind=ANY_NUMBER)


@command("new_scenes:import_dataset", name=Given(Literal[tuple(DATASETS)], kind=BY_PLACE), parts=_PARTS)
def dataset(call: Any, output: Path) -> Answer:
    made, scene = call(), output / "scene.toml"
    step = next_step("cameras", scene, "-o", output / "axes")
    values = {
        "scene": scene,
        **attributes(made, "frames", "notes"),
        "cameras": made.rig.names,
        "joints": made.truth.joint_names if made.truth else (),
        "markers": made.truth.marker_names if made.truth else (),
        "next": step,
    }
    return Answer(values, [f"{scene}: {made!r}", f"next: {step}"])


def validate(file: Path, /, *, console: Console | None = None) -> int:
    """Say what is wrong with a USD file: by OpenUSD's validators, and what they miss in bodies that move.

    Args:
        file: A .usda, .usdc or .usdz file: a result, a subject, a body, an export, or another program's.
    """
    from mmocap_warp.formats.usd.usd_check import faults

    lines = faults(file)
    text = "\n".join(f"{file}: {line}" for line in lines or ["nothing wrong"])
    (console or Console()).result({"file": file, "faults": lines}, text)
    return checked(not lines)
