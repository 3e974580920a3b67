"""``mmocap init``: a first scene file for a folder of videos."""

from __future__ import annotations

from pathlib import Path

from mmocap_warp.cli.console import Console, Switch


def init(folder: Path, /, *, force: Switch = False, console: Console | None = None) -> None:
    """Write a scene.toml for the videos, images, masks and calibration in a folder, and say what is missing.

    Parameters
    ----------
    folder
        Where the videos lie, in folders of their own or not; projects of Pose2Sim, EasyMocap, Caliscope and OpenCap
        are known.
    force
        Replace a scene.toml that exists.
    """
    from mmocap_warp.cli.console import next_step
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.errors import InputError
    from mmocap_warp.scene.drafting import draft_scene
    from mmocap_warp.scene.scene_toml import load_scene
    from mmocap_warp.whole_file import write_whole

    console = console or Console()
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "give the folder that the videos lie in")
    scene = new_file(folder / "scene.toml", ".toml", force=force)
    draft = draft_scene(folder)
    write_whole(scene, draft.text.encode())
    if not draft.missing:
        try:
            load_scene(scene, masks=False)
        except InputError as error:
            draft.missing.append(str(error))
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
    console.result(values, "\n".join(lines))
