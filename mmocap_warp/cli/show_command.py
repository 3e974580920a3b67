"""``mmocap show``: a result, or a fitted subject, over what the cameras saw."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch
from mmocap_warp.errors import UsageError


def show(
    result: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    scene: Path | None = None,
    frames: str | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write an overlay video of all cameras, and a contact sheet beside it: mask against model, skin and skeleton.

    Of a subject it is a picture: the fit over the first frame, or the body alone where the scene is not known.

    Parameters
    ----------
    result
        What 'mmocap track' or 'mmocap fit' wrote.
    output
        The video's file, .webm; beside the result and named after it by default. The sheet, and a subject's picture,
        have the ending .png.
    scene
        The scene, if it is no longer where the result says.
    frames
        Which of the result's frames: first:end or first:end:stride by the recording's numbers, or a count. All by
        default.
    force
        Replace files that exist.
    """
    from mmocap_warp.cli.result_report import draw_result, draw_subject
    from mmocap_warp.commands.inputs import positions_of, recorded_scene, scene_of
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.commands.settings import start_warp
    from mmocap_warp.formats.usd.usd_body import read_subject
    from mmocap_warp.formats.usd.usd_result import holds_result, read_result

    console = console or Console()
    if not holds_result(result):
        if frames is not None:
            raise UsageError("--frames belongs to a result; a subject is drawn over the frame that it was fitted to")
        picture = new_file(output or result.with_suffix(".png"), ".png", force=force)
        subject = read_subject(result)
        start_warp()
        reference = str(subject.provenance["fit.scene"]) if "fit.scene" in subject.provenance else None
        chosen = subject.provenance.get("fit.identity")
        identity = None if chosen is None else int(chosen)
        draw_subject(subject, recorded_scene(reference, result, scene, identity), picture)
        console.result({"sheet": picture}, str(picture))
        return
    video = new_file(output or result.with_suffix(".webm"), ".webm", force=force)
    sheet = new_file(video.with_suffix(".png"), ".png", force=force)
    tracked = read_result(result)
    positions = positions_of(tracked, frames)
    start_warp()
    draw_result(tracked, scene_of(tracked, result, scene), video, sheet, console, positions)
    console.result({"video": video, "sheet": sheet}, f"{video}\n{sheet}")
