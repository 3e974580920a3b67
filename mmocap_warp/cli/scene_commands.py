"""Commands that write or look at a scene: ``init``, ``cameras``, ``sync``, ``synth``, ``humaneva`` and ``validate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from mmocap_warp.cli.command_help import documented_by
from mmocap_warp.cli.console import (
    CHECK_FAILED,
    OK,
    Console,
    Output,
    SceneFile,
    Switch,
    mask_step,
    next_step,
    table,
    track_step,
)

if TYPE_CHECKING:
    from mmocap_warp.calibration.sync.synchronise import Synchronisation


@documented_by("new_scenes:init")
def init(folder: Path, /, *, force: Switch = False, console: Console | None = None) -> None:
    from mmocap_warp.commands.new_scenes import init

    draft, scene = init(folder, force=force), folder / "scene.toml"
    step = next_step("cameras", scene, "-o", folder / "axes")
    kind = f"a {draft.project} project, " if draft.project else ""
    lines = [f"{scene}: {kind}{len(draft.cameras)} cameras ({', '.join(draft.cameras)})"]
    lines += [f"found: {line}" for line in draft.found] + [f"missing: {line}" for line in draft.missing]
    lines.append(f"next: {'complete ' + str(scene) + ', then ' if draft.missing else ''}{step}")
    values = {
        "scene": scene,
        "project": draft.project,
        "calibration": draft.calibration,
        "cameras": draft.cameras,
        "found": draft.found,
        "missing": draft.missing,
        "next": step,
    }
    (console or Console()).result(values, "\n".join(lines))


@documented_by("calibrate:show_cameras", output="pictures")
def cameras(
    scene: SceneFile,
    /,
    *,
    output: Annotated[Path | None, Output] = None,
    force: Switch = False,
    console: Console | None = None,
) -> int:
    from mmocap_warp.commands.calibrate import show_cameras
    from mmocap_warp.scene.scene_toml import load_scene

    loaded = load_scene(scene, masks=False)
    shown = show_cameras(loaded, output, force=force)
    have_masks = all(source.masks is not None for source in loaded.cameras)
    step = track_step(loaded.path) if have_masks else mask_step(loaded.path)
    values = {
        "cameras": [
            {
                "name": row.name,
                "size": size,
                "centre_m": row.centre,
                "height_m": row.height,
                "nearest_m": row.nearest,
                "field_of_view_deg": row.field_of_view,
            }
            for row, size in zip(shown.rows, shown.size, strict=True)
        ],
        "up": shown.up,
        "mean_height_m": shown.mean_height,
        "mean_height_ok": shown.plausible,
        "pictures": shown.pictures,
        "next": step if shown.plausible else None,
    }
    lines = [repr(shown), *map(str, shown.pictures), f"mean height {shown.mean_height:.2f} m along {shown.up}"]
    if not shown.plausible:
        lines.append("check failed: cameras at or below the world's zero; is [scene] up this calibration's vertical?")
    if output is not None:
        lines.append(f"{output}: the world's axes in {len(shown.rows)} pictures, x red, y green, z blue")
    if shown.plausible:
        lines.append(f"next: {step}")
    (console or Console()).result(values, "\n".join(lines))
    return OK if shown.plausible else CHECK_FAILED


@documented_by("calibrate:sync")
def sync(
    scene: SceneFile,
    /,
    *,
    frames: str | None = None,
    within: float = 1.0,
    trust_cameras: Switch = False,
    write: Switch = False,
    console: Console | None = None,
) -> int:
    from mmocap_warp.commands.calibrate import sync
    from mmocap_warp.commands.inputs import scene_from

    console = console or Console()
    loaded = scene_from(scene, frames, calibrated=False)
    offsets = sync(loaded, within=within, trust_cameras=trust_cameras, write=write, reporter=console)
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
                "fps": timing[name].get("fps"),
                "jump_frames": view.course.jump,
                "jump_at": view.course.at if view.course.jump else None,
                "sure": view.sure,
                "rival_frames": view.other,
                "rival_score": view.rival,
                "agreeing": view.agreeing,
            }
            for name, view in offsets.views.items()
        },
        "written": loaded.path if write and offsets.sure else None,
        "sync_ok": offsets.sure,
        "faults": faults,
        "next": step if offsets.sure else None,
    }
    lines = [_offset_table(offsets, timing), _decided_by(offsets), *(f"check failed: {fault}" for fault in faults)]
    if not faults:
        lines += [f"{loaded.path}: written"] if write else _scene_lines(timing)
        lines += [f"next: {step}"] if step else []
    console.result(values, "\n".join(lines))
    return OK if offsets.sure else CHECK_FAILED


def _offset_table(offsets: Synchronisation, timing: dict[str, dict[str, float]]) -> str:
    rows: list[tuple[str, ...]] = [
        ("camera", "lag [frames]", "lag [s]", "sure", "next best by motion", "others agreeing")
    ]
    for name, view in offsets.views.items():
        rival = f"{view.other:+d} scores {100 * min(view.rival, 9.99):.0f} %"
        sure = "yes" if view.sure else "no"
        seconds = f"{timing[name]['offset']:+.4f}"
        rows.append((name, f"{view.frames:+d}", seconds, sure, rival, f"{100 * view.agreeing:.0f} %"))
    return table(rows)


def _decided_by(offsets: Synchronisation) -> str:
    if offsets.hull:
        return "decided by the visual hull: these silhouettes fit into one body"
    if offsets.hull is None:
        return "decided by when silhouettes move: right within a frame or two, better with a calibration"
    return "decided by when silhouettes move: the calibration or the motion is too poor for the visual hull to tell"


def _scene_lines(timing: dict[str, dict[str, float]]) -> list[str]:
    """The lines of the scene file that give the offsets."""
    lines = []
    for name, keys in timing.items():
        own = [f"{key} = {value!r}" for key, value in keys.items() if value]
        lines += [f"[cameras.{name}]", *own] if own else []
    return lines or ["all cameras are in step: offsets need not be given"]


@documented_by("new_scenes:synthesize")
def synth(
    body: str,
    /,
    *,
    output: Annotated[Path, Output],
    motion: str | None = None,
    cameras: int = 6,
    size: tuple[int, int] = (640, 480),
    perfect: Switch = False,
    seed: int = 0,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    from mmocap_warp.commands.new_scenes import synthesize

    console = console or Console()
    made = synthesize(
        body,
        output,
        motion=motion,
        cameras=cameras,
        size=size,
        perfect=perfect,
        seed=seed,
        force=force,
        reporter=console,
    )
    step = track_step(made.scene)
    values = {
        "scene": made.scene,
        "body": made.recording.body.name,
        "motion": made.motion,
        "frames": len(made.recording),
        "cameras": cameras,
        "next": step,
    }
    console.result(values, f"{made!r}\nnext: {step}")


@documented_by("new_scenes:import_humaneva")
def humaneva(
    root: Path,
    subject: str,
    action: str,
    /,
    *,
    output: Annotated[Path, Output],
    first: int | None = None,
    last: int | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    import numpy as np

    from mmocap_warp.commands.new_scenes import import_humaneva

    console = console or Console()
    sequence = import_humaneva(
        root, subject, action, output, first=first, last=last, force=force, reporter=_Warnings(quiet=console.quiet)
    )
    with_truth = int(np.isfinite(sequence.truth.markers).all(axis=(1, 2)).sum())
    scene = output / "scene.toml"
    values = {
        "scene": scene,
        "frames": sequence.count,
        "truth_frames": with_truth,
        "first": sequence.first,
        "last": sequence.first + sequence.count - 1,
        "cameras": sequence.rig.names,
        "frame_offsets": sequence.frame_offsets,
        "starts_as_published": sequence.starts_as_published,
        "mocap_per_frame": sequence.sync.mocap_per_frame,
        "joints": sequence.truth.joint_names,
        "backgrounds": [background.path.name for background in sequence.backgrounds],
    }
    console.result(values, f"{scene}: {sequence.count} frames, {with_truth} with truth, {len(sequence.rig)} cameras")


class _Warnings(Console):
    """A console whose warnings say that they are."""

    def warn(self, line: str) -> None:
        super().warn(f"mmocap: warning: {line}")


def validate(file: Path, /, *, console: Console | None = None) -> int:
    """Say what is wrong with a USD file: by OpenUSD's validators, and what they miss in bodies that move.

    Parameters
    ----------
    file
        A .usda, .usdc or .usdz file: a result, a subject, a body, an export, or another program's.
    """
    from mmocap_warp.formats.usd.usd_check import faults

    lines = faults(file)
    text = "\n".join(f"{file}: {line}" for line in lines or ["nothing wrong"])
    (console or Console()).result({"file": file, "faults": lines}, text)
    return CHECK_FAILED if lines else OK
