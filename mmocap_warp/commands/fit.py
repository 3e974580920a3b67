"""The subject of a scene, without hand work: ``mmocap fit``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.commands.inputs import body_from, look_first, note_others, scene_from, scene_reference
from mmocap_warp.commands.outputs import new_file, releases_locks
from mmocap_warp.commands.reporter import Reporter
from mmocap_warp.commands.settings import describe, effective, start_warp
from mmocap_warp.errors import UsageError
from mmocap_warp.fitting import subject_fit
from mmocap_warp.fitting.fit_config import FitConfig
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
from mmocap_warp.rigging.attaching import carrying
from mmocap_warp.rigging.shipped import DEFAULT_BODY, body_file
from mmocap_warp.rigging.start_poses import start_poses as named_start_poses
from mmocap_warp.scene.recording import Scene

_UNDECIDED = {
    "turned": "fit: the masks do not tell which way the subject faces; it may be back to front",
    "swapped": "fit: the masks do not tell left limbs from right ones; they may be swapped",
}
_UNDECIDED_LYING = {
    "turned": "fit: the masks do not tell which way the subject lies; it may be turned far from it",
    "swapped": "fit: the masks do not tell limbs that are alike from one another; they may be exchanged",
}
"""The same of a body that does not stand."""


@releases_locks
def fit(
    scene: Scene | str | Path,
    body: BodyModel | str | Path | None = None,
    config: FitConfig | None = None,
    *,
    start_poses: np.ndarray | Sequence[str] | None = None,
    output: str | Path | None = None,
    frames: str | int | range | None = None,
    identity: int | None = None,
    trust_cameras: bool = False,
    force: bool = False,
    reporter: Reporter | None = None,
    **settings: Any,
) -> Subject:
    """Find the body's place, heading and first pose in a scene's first frame, and its shape in the first seconds.

    Args:
        scene: the recording, or its file or folder.
        body: the generic body that the subject's is near to: a shipped one's name or a USD file. It gets what the scene
            says is attached. [default: the scene's, or adult_man]
        config: settings. [default: those of the scene's [fit] table]
        start_poses: in which the recording starts, about: names of the body's motions, of which some frames are tried,
            or .toml files of angles in degrees such as 'LKnee.Rx = 40', shifts in metres; one or several. From Python
            also an array (pose, coordinate). [default: the body's usual ones]
        output: the subject's file: .usdc, .usda or .usd. Name it as 'subject' in the scene to track with it.
        frames: which of the recording's frames: first:end or first:end:stride. A number is the setting of that name.
            [default: those that the scene names]
        identity: of the person who is meant, where masks show several.
        trust_cameras: go on even if masks and calibration fit no body; the subject says so.
        force: replace a file that exists.
        reporter: who is told of notes and progress.
        settings: fields of :class:`FitConfig` that replace those of ``config``, such as ``headings=4``.

    Raises:
        UsageError: a setting that cannot be. TypeError: one that does not exist.
        InputError: the first frame's masks do not show one subject in at least two views, or a file is wrong.
    """
    reporter = reporter or Reporter()
    file = None if output is None else new_file(output, *USD_SUFFIXES, force=force)
    if isinstance(frames, int):
        settings, frames = settings | {"frames": frames}, None
    loaded = scene_from(scene, frames, identity)
    note_others(loaded, reporter)
    chosen = effective(FitConfig, loaded.settings("fit"), settings, config)
    generic = body_from(body, loaded)
    poses = _start_poses(start_poses, body, loaded)
    start_warp(chosen.device)
    trusted = look_first(loaded, generic, reporter, trust_cameras)
    reporter.note(f"fit: {describe(chosen, loaded.fit if config is None else {}, settings)}")
    return fit_subject(loaded, generic, chosen, file, reporter, poses, trusted)


def _start_poses(
    named: np.ndarray | Sequence[str] | None, body: BodyModel | str | Path | None, scene: Scene
) -> np.ndarray | None:
    """The poses (pose, coordinate) in which the recording may start; None for the usual ones."""
    if named is None or isinstance(named, np.ndarray):
        return named
    if isinstance(body, BodyModel):
        raise UsageError("--start-poses names motions of a body's file: give body as that file, or poses as an array")
    source = "--body" if body else scene.path
    return named_start_poses(body_file(body or scene.body or DEFAULT_BODY, source), list(named)) if named else None


def fit_subject(
    scene: Scene,
    body: BodyModel,
    config: FitConfig,
    output: Path | None,
    reporter: Reporter,
    start_poses: np.ndarray | None = None,
    trusted: Mapping[str, str] | None = None,
) -> Subject:
    """Fit a body to a scene, and write it where there is an ``output``; a note says where masks do not decide.

    ``start_poses`` (pose, coordinate) are those in which the recording may start; None for the body's usual ones.
    ``trusted`` is what :func:`look_first` returned.

    Raises:
        InputError: the first frame's masks do not show one subject.
    """
    # What is attached begins as it is carried; its joints come last.
    carried = carrying(body, scene.attached)
    for note in carried.notes:
        reporter.note(f"attach: {note}")
    if start_poses is not None:
        start_poses = np.pad(start_poses, ((0, 0), (0, carried.body.skeleton.coordinates - start_poses.shape[1])))
    with reporter.stage("fit", None) as progress:
        subject = subject_fit.fit(
            scene, carried.body, config, lambda stage, done, cost: progress(round(100 * done), 100), start_poses
        )
    if subject.provenance["fit.decided"] == "no":
        name = str(subject.provenance["fit.alternative"])
        reporter.note((_UNDECIDED if body.skeleton.stands else _UNDECIDED_LYING)[name])
    identity = {"fit.identity": scene.foreground.identity} if scene.foreground.identity else {}
    reference = {"fit.scene": scene_reference(scene.path, output)}
    reference |= {f"fit.{name}": problem for name, problem in (trusted or {}).items()}
    subject = replace(subject, provenance={**subject.provenance, **reference, **identity})
    if output is not None:
        write_subject(output, subject)
    return subject
