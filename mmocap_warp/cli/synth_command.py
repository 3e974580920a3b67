"""``mmocap synth``: a made-up recording of a body, with its truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Switch


def synth(
    body: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    motion: str | None = None,
    cameras: int = 6,
    size: tuple[int, int] = (640, 480),
    perfect: Switch = False,
    seed: int = 0,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Write a scene of a body in one of its own motions, with made masks and known truth.

    Cameras stand evenly around it and see all of it. Track the scene to find out how many of them a recording needs.

    Parameters
    ----------
    body
        A body's USD file with motions, such as 'mmocap body import' writes, or a shipped body's name, such as fox.
    output
        The scene's folder.
    motion
        Which of its motions. [default: the first]
    cameras
        How many.
    size
        Width and height of their images, in pixels.
    perfect
        Masks without faults. By default they have ragged contours, holes and specks.
    seed
        Of the faults.
    force
        Write into a folder that holds files.
    """
    from mmocap_warp.body.model import motion_named
    from mmocap_warp.cli.exit_codes import UsageError
    from mmocap_warp.cli.next_step import track_command
    from mmocap_warp.cli.outputs import new_folder
    from mmocap_warp.cli.progress import Progress
    from mmocap_warp.errors import InputError
    from mmocap_warp.formats.usd.usd_body import read_body, read_motions
    from mmocap_warp.rigging.shipped import body_file
    from mmocap_warp.synthesis.any_body import recorded, write_recorded

    console = console or Console()
    file = body_file(body)
    read, motions = read_body(file), read_motions(file)
    if not motions:
        raise InputError(file, "has no motions", "import a file with animations, or name another body")
    name = motion or next(iter(motions))
    chosen = motion_named(name, motions, file)
    if cameras < 1 or min(size) < 1:
        raise UsageError(f"--cameras and --size must be at least 1, got {cameras} and {size[0]} {size[1]}")
    folder = new_folder(output, force=force)
    recording = recorded(read, chosen, cameras, size=size, faulty=not perfect, seed=seed)
    with Progress("synth", quiet=console.quiet) as progress:
        scene = write_recorded(folder, recording, not perfect, file=file, progress=progress)
    step = track_command(scene)
    values = {"scene": scene, "body": read.name, "motion": name, "frames": len(recording), "cameras": cameras}
    text = f"{scene}: {len(recording)} frames of {name} at {recording.fps:g} a second, {cameras} cameras"
    console.result({**values, "next": step}, f"{text}\nnext: {step}")
