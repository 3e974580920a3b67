"""``mmocap fit``: the subject of a scene, without hand work."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Identity, Switch, given


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FitFlags:
    """Settings of ``FitConfig``; what is not given comes from the scene's [fit] table."""

    seed: int | None = None
    """Of the random numbers. [default: 0]"""
    scale: float | None = None
    """Of masks and cameras, up to 1. [default: images 480 pixels long]"""
    headings: int | None = None
    """Evenly spread starting directions; of a body that starts anyhow, the best of many starts. [default: 8]"""
    rigid: bool | None = None
    """Bones' lengths, girths and scale are known, as a robot's are: find the pose alone. [default: what the body
    says]"""
    device: str | None = None
    """auto, cpu or a CUDA device such as cuda:0. [default: auto]"""
    threads: int | None = None
    """CPU threads. [default: all]"""


def fit(
    scene: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("subject.usdc"),
    body: str | None = None,
    start_pose: list[str] | None = None,
    frames: str | None = None,
    identity: Identity = None,
    flags: FitFlags | None = None,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Find the body's place, heading and first pose in a scene's first frame, and its shape in the first seconds.

    Parameters
    ----------
    scene
        The scene file, or its folder.
    output
        The subject's file: .usdc, .usda or .usd. Name it as 'subject' in the scene to track with it.
    body
        The generic body that the subject's is near to: a shipped one's name or a USD file. The scene's, or else
        adult_man.
    start_pose
        In which the recording starts, about: the name of one of the body's motions, of which some frames are tried, or
        a .toml file of angles in degrees such as 'LKnee.Rx = 40', shifts in metres. May be given more than once.
    frames
        Which of the recording's frames: first:end or first:end:stride, such as 120:480:2, which leaves out the end; or
        a count of those that the scene names. [default: those that the scene names]
    force
        Replace a file that exists.
    """
    from mmocap_warp.cli.subjects import fit_subject
    from mmocap_warp.commands.inputs import note_others, scene_from
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.commands.settings import describe, effective, start_warp
    from mmocap_warp.fitting.subject_fit import FitConfig
    from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
    from mmocap_warp.rigging.shipped import DEFAULT_BODY, body_file, load_body
    from mmocap_warp.rigging.start_poses import start_poses

    console, flags = console or Console(), flags or FitFlags()
    new_file(output, *USD_SUFFIXES, force=force)
    loaded = scene_from(scene, frames, identity)
    note_others(loaded, console)
    config = effective(FitConfig, loaded.settings("fit"), given(flags))
    named = body or loaded.body or DEFAULT_BODY, "--body" if body else loaded.path
    start = load_body(*named)
    poses = start_poses(body_file(*named), start_pose) if start_pose else None
    start_warp(config.device)
    console.note(f"fit: {describe(config, loaded.fit, given(flags))}")
    subject = fit_subject(loaded, start, config, output, console, poses)
    values = {"file": output, "body": start.name, "height_m": subject.provenance["body.height"], **subject.provenance}
    console.result(values, f"{output}: {start.name}, {_measures(subject.provenance)}")


def _measures(provenance: dict[str, str | float | int]) -> str:
    """How large the body is, and its bones, with their standard deviations, for people."""
    measure, adjective = ("length", "long") if "body.length" in provenance else ("height", "tall")
    size, frames = f"{float(provenance[f'body.{measure}']):.2f} m {adjective}", provenance["fit.frames"]
    of_size = 1000 * float(provenance[f"body.{measure}.sigma"])
    if of_size == 0:
        return f"{size}, as given; seen in {frames} frames"
    sigma = [1000 * float(value) for name, value in provenance.items() if re.fullmatch(r"body\.bone\..*\.sigma", name)]
    bones = f", bones to {min(sigma):.0f} to {max(sigma):.0f} mm" if sigma else ""
    return f"{size}, known to {of_size:.0f} mm{bones} from {frames} frames"
