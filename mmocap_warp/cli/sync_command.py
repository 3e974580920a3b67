"""``mmocap sync``: which frames of a scene's cameras were taken at the same time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mmocap_warp.cli.console import CHECK_FAILED, OK, Console, Switch, table
from mmocap_warp.errors import UsageError

if TYPE_CHECKING:
    from mmocap_warp.calibration.sync.synchronise import Synchronisation, ViewOffset


def sync(
    scene: Path,
    /,
    *,
    frames: str | None = None,
    within: float = 1.0,
    write: Switch = False,
    console: Console | None = None,
) -> int:
    """Find how far a scene's cameras lag one another, from the motion of the person; a calibration need not be there.

    Parameters
    ----------
    scene
        The scene file, or its folder.
    frames
        Which of the cameras' frames are looked at: first:end, such as 120:900, or a count. [default: those that the
        scene names]
    within
        By how many seconds one camera lags another at most. Steps repeat themselves every half second, so of somebody
        who only walks motion tells lags of less than half of that.
    write
        Put the offsets into the scene file, and leave everything else in it as it is.
    """
    from mmocap_warp.calibration.sync.synchronise import synchronise
    from mmocap_warp.cli.console import next_step
    from mmocap_warp.commands.inputs import scene_from
    from mmocap_warp.errors import InputError
    from mmocap_warp.scene.offset_writing import write_timing

    console = console or Console()
    loaded = scene_from(scene, frames, calibrated=False)
    try:
        with console.stage("sync") as progress:
            found = synchronise(loaded, progress, within)
    except InputError:
        raise
    except ValueError as error:
        raise UsageError.of_setting(error) from None
    timing = {
        source.name: _timing(found.views[source.name], found, found.fps * source.rate) for source in loaded.cameras
    }
    doubted = [name for name, view in found.views.items() if not view.sure or view.course.changes]
    faults = [_doubt(name, found.views[name], timing[name]) for name in doubted]
    if write and found.sure:
        write_timing(loaded.path, timing)
    step = next_step("cameras", loaded.path) if loaded.calibration and loaded.calibrated.placed else None
    values = {
        "scene": loaded.path,
        "fps": found.fps,
        "by": "hull" if found.hull else "motion",
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
            for name, view in found.views.items()
        },
        "written": loaded.path if write and found.sure else None,
        "sync_ok": found.sure,
        "faults": faults,
        "next": step if found.sure else None,
    }
    console.result(values, "\n".join(_lines(found, timing, faults, write, loaded.path, step)))
    return OK if found.sure else CHECK_FAILED


def _timing(view: ViewOffset, found: Synchronisation, fps: float) -> dict[str, float]:
    """What a camera's table has to say: its offset [s], and its rate where that is not what the scene says."""
    offset = round((view.frames + view.course.start) / found.fps, 6)
    return {"offset": offset} | ({"fps": round(fps * (1 + view.course.slope), 4)} if view.course.slope else {})


def _lines(
    found: Synchronisation,
    timing: dict[str, dict[str, float]],
    faults: list[str],
    write: bool,
    path: Path,
    step: str | None,
) -> list[str]:
    rows: list[tuple[str, ...]] = [
        ("camera", "lag [frames]", "lag [s]", "sure", "next best by motion", "others agreeing")
    ]
    for name, view in found.views.items():
        rival = f"{view.other:+d} scores {100 * min(view.rival, 9.99):.0f} %"
        sure = "yes" if view.sure else "no"
        offset = timing[name]["offset"]
        rows.append((name, f"{view.frames:+d}", f"{offset:+.4f}", sure, rival, f"{100 * view.agreeing:.0f} %"))
    lines = [table(rows), _decided_by(found)]
    if faults:
        return [*lines, *(f"check failed: {fault}" for fault in faults)]
    if write:
        lines.append(f"{path}: written")
    else:
        moved = {name: {key: value for key, value in keys.items() if value} for name, keys in timing.items()}
        moved = {name: keys for name, keys in moved.items() if keys}
        for name, keys in moved.items():
            lines += [f"[cameras.{name}]", *(f"{key} = {value!r}" for key, value in keys.items())]
        lines += [] if moved else ["all cameras are in step: offsets need not be given"]
    return [*lines, *([f"next: {step}"] if step else [])]


def _decided_by(found: Synchronisation) -> str:
    if found.hull:
        return "decided by the visual hull: these silhouettes fit into one body"
    if found.hull is None:
        return "decided by when silhouettes move: right within a frame or two, better with a calibration"
    return "decided by when silhouettes move: the calibration or the motion is too poor for the visual hull to tell"


def _doubt(name: str, view: ViewOffset, timing: dict[str, float]) -> str:
    """Why an offset cannot be relied on."""
    if view.sure and view.course.jump:
        what = f"dropped {-view.course.jump}" if view.course.jump < 0 else f"has {view.course.jump} too many"
        return (
            f"{name} {what} of its frames near frame {view.course.at}: its offset changes there; cut or mend the video"
        )
    if view.sure and view.course.slope:
        runs = f"{100 * abs(view.course.slope):.1f} % {'faster' if view.course.slope > 0 else 'slower'}"
        return (
            f"{name} runs {runs} than it says, or dropped frames here and there: set fps = {timing['fps']:g} under "
            f"[cameras.{name}] and run sync again; if it still changes, mend the video"
        )
    if view.rival == float("inf"):
        return f"{name} shows no motion that the other views share: the person stands still, or it is another recording"
    if view.rival >= 0.75:
        period = abs(view.other - view.frames)
        return (
            f"{name} fits as well {view.other - view.frames:+d} frames later: the motion repeats itself every {period}"
            " frames, as steps do, or there is too little of it; record a clap, a jump or a turn too"
        )
    return f"{name} agrees with {100 * view.agreeing:.0f} % of the other views: too little motion, or poor masks"
