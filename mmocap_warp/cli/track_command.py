"""``mmocap track``: from a scene to a result."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from mmocap_warp.cli.console import Console, Identity, Switch, given
from mmocap_warp.errors import InputError, UsageError

if TYPE_CHECKING:
    from mmocap_warp.body.model import BodyModel, Subject
    from mmocap_warp.result.result import Result
    from mmocap_warp.scene.recording import Scene
    from mmocap_warp.tracking.track_config import TrackConfig


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class TrackFlags:
    """Settings of a ``TrackConfig``; what is not given comes from the scene's [track] table."""

    algorithm: str | None = None
    """search-contour, or contour, which does without a search; or the paper's: cmaes, de, pso, apf, and h-cmaes, h-de,
    h-pso, psapf, which search part by part. [default: search-contour]"""
    dof: int | None = None
    """Degrees of freedom that are searched, one of the body's models: of a person 39, 28 or 51. [default: 39]"""
    evaluations: int | None = None
    """Budget of a frame's search, for each run. [default: 500; 120 with search-contour, where a search is needed]"""
    polish: bool | None = None
    """Finish each frame of one of the paper's algorithms by its contours. [default: no]"""
    smooth: float | None = None
    """What a joint's acceleration may be, as a standard deviation in m/s^2, when the clip's frames are solved together;
    0 leaves each frame as it was tracked. [default: 5.4 with contours, 0 with the paper's algorithms]"""
    seed: int | None = None
    """Of the first run; run r uses seed + r. [default: 0]"""
    runs: int | None = None
    """Independent runs, tracked at once. [default: 1]"""
    preset: str | None = None
    """Where the search radii come from: recording, recording-restart, common, paper, paper-rotation, paper-translation
    or authors. [default: recording]"""
    rotation_radius: float | None = None
    """In radians, instead of the preset's."""
    translation_radius: float | None = None
    """In metres, instead of the preset's."""
    cost: str | None = None
    """paper (Eq. 4-5), xor or iou. [default: paper]"""
    renderer: str | None = None
    """raycast or raster; the counts are the same. [default: raycast]"""
    limits: bool | None = None
    """Keep joints within their anatomical limits. [default: yes]"""
    scale: float | None = None
    """Of masks and cameras, up to 1. [default: 1]"""
    device: str | None = None
    """auto, cpu or a CUDA device such as cuda:0. [default: auto]"""
    threads: int | None = None
    """CPU threads. [default: all]"""


def track(
    scene: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    subject: Path | None = None,
    body: str | None = None,
    rigid: bool | None = None,
    frames: str | None = None,
    identity: Identity = None,
    flags: TrackFlags | None = None,
    resume: Switch = False,
    force: Switch = False,
    console: Console | None = None,
) -> None:
    """Track a scene: from videos or masks to an animated USD body.

    Parameters
    ----------
    scene
        The scene file, or its folder.
    output
        The result's file: .usdc, .usda or .usd. A checkpoint lies beside it until the run is complete.
    subject
        The fitted subject to track. The scene's, or else one is fitted first and kept beside the result.
    body
        Where that fit starts: a shipped body's name or a USD file. The scene's, or else adult_man.
    rigid
        That body's bones' lengths, girths and scale are known: fit the pose alone. [default: what the body says]
    frames
        Which of the recording's frames: first:end or first:end:stride, such as 120:480:2, which leaves out the end; or
        a count of those that the scene names. [default: those that the scene names]
    resume
        Continue an interrupted run; it ends with the same bits as one that was not interrupted.
    force
        Replace a result that exists.
    """
    from mmocap_warp.cli.console import next_step
    from mmocap_warp.cli.result_report import summary
    from mmocap_warp.commands.evaluate import other_world_line, report_of
    from mmocap_warp.commands.inputs import note_others, scene_from, truth_of
    from mmocap_warp.commands.outputs import new_file
    from mmocap_warp.commands.settings import effective
    from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
    from mmocap_warp.tracking.track_config import TrackConfig

    console, flags = console or Console(), flags or TrackFlags()
    if resume and force:
        raise UsageError("--resume continues what --force would replace; give one of them")
    new_file(output, *USD_SUFFIXES, force=force or resume)
    loaded = scene_from(scene, frames, identity)
    note_others(loaded, console)
    config = effective(TrackConfig, loaded.settings("track"), given(flags))
    truth = truth_of(loaded)
    start = Start(subject, body, rigid, flags, resume, force)
    tracked = track_scene(loaded, config, output, start, console)
    try:
        report = report_of(tracked, truth, loaded.truth)
    except InputError:
        console.warn(f"{output} is written, but cannot be compared with the scene's truth:")
        raise
    del report["series"]
    step = next_step("show", output)
    values = {"result": output, **report, "config": tracked.config, "next": step}
    console.result(values, f"{output}\n{summary(report)}\nnext: {step}")
    if report.get("other_world") is not None:
        console.warn(other_world_line(report, loaded.truth, loaded.truth_axes, "scene"))


@dataclass(frozen=True)
class Start:
    """How a run starts.

    Attributes:
        subject: the subject's file; None for the scene's, or one that is fitted.
        body: where that fit starts; None for the scene's, or the default.
        rigid: whether that body's shape is known; None for what the scene or the body says.
        flags: what was given on the command line, to say where settings come from.
        resume: continue an interrupted run.
        force: replace an earlier run.
    """

    subject: Path | None = None
    body: str | None = None
    rigid: bool | None = None
    flags: TrackFlags = field(default_factory=TrackFlags)
    resume: bool = False
    force: bool = False


def track_scene(scene: Scene, config: TrackConfig, output: Path, start: Start, console: Console) -> Result:
    """Track a scene and write the result, fitting a subject first where none is named.

    Raises:
        InputError: anything wrong with the scene's images, the subject or the body; an interrupted run lies there and
            ``start`` does not say what to do with it.
    """
    from mmocap_warp.commands.inputs import scene_reference
    from mmocap_warp.commands.settings import describe, start_warp
    from mmocap_warp.formats.usd.usd_result import read_result, write_result
    from mmocap_warp.result.result import FrameAnswer
    from mmocap_warp.rigging.attaching import subject_carrying
    from mmocap_warp.tracking.frame_loop import track as track_frames

    checkpoint = output.with_name(f"{output.name}.checkpoint")
    if start.resume and output.exists() and not checkpoint.exists():
        console.note(f"{output} is complete")
        return read_result(output)
    if checkpoint.exists() and not (start.resume or start.force):
        raise InputError(checkpoint, "an interrupted run lies here", "continue it with --resume, or --force a new one")
    start_warp(config.device)
    scene.rig(config.scale)  # a scale that cannot be is told before a fit of minutes
    subject = _named_subject(scene, output, start) or _fitted_subject(scene, config, output, start, console)
    subject, notes = subject_carrying(subject, scene.attached)
    for note in notes:
        console.note(f"attach: {note}")
    _check_model(subject.body, scene, config, start.flags)
    config = replace(config, dof=subject.body.skeleton.model_number(config.dof))
    console.note(f"track: {describe(config, scene.track, given(start.flags))}")
    total, evaluations = scene.frame_count, 0
    progress: Any = None

    def report(frame: int, answer: FrameAnswer) -> None:
        nonlocal evaluations, progress
        evaluations += answer.evaluations * config.runs
        progress(frame + 1, total, evaluations)

        if config.acceleration and frame + 1 == total:
            stages.close()
            progress = stages.enter_context(console.stage("smooth"))

    with ExitStack() as stages:
        progress = stages.enter_context(console.stage("track"))
        tracked = track_frames(
            scene,
            subject,
            config,
            checkpoint=checkpoint,
            resume=start.resume,
            progress=report,
            smooth_progress=lambda frames: progress(frames, total),
        )
    chosen = {"identity": scene.foreground.identity} if scene.foreground.identity else {}
    tracked = replace(tracked, config=tracked.config | {"scene": scene_reference(scene.path, output)} | chosen)
    write_result(output, tracked)
    checkpoint.unlink(missing_ok=True)
    return tracked


def _check_model(body: BodyModel, scene: Scene, config: TrackConfig, flags: TrackFlags) -> None:
    """See that the body has a model with as many degrees of freedom as a flag or the scene asks for."""
    try:
        body.skeleton.searched(config.dof)
    except ValueError as error:
        if flags.dof is not None:
            raise UsageError(f"--{error}") from None
        raise InputError(f"{scene.path}: [track]", str(error), "correct that value") from None


def _kept_subject(output: Path) -> Path:
    """Where a subject that was fitted for this result lies."""
    return output.with_name(f"{output.stem}.subject.usdc")


def _named_subject(scene: Scene, output: Path, start: Start) -> Subject | None:
    """The subject that a flag or the scene names, or that the run to be resumed has fitted."""
    from mmocap_warp.formats.usd.usd_body import read_subject

    named = start.subject or (None if start.body else scene.subject)
    if named is None and start.resume and _kept_subject(output).exists():
        named = _kept_subject(output)
    return None if named is None else read_subject(named)


def _fitted_subject(scene: Scene, config: TrackConfig, output: Path, start: Start, console: Console) -> Subject:
    """A subject fitted to the scene and kept beside the result."""
    from mmocap_warp.cli.fit_command import FitFlags
    from mmocap_warp.cli.subjects import fit_subject
    from mmocap_warp.commands.settings import describe, effective
    from mmocap_warp.fitting.subject_fit import FitConfig
    from mmocap_warp.formats.usd.usd_body import read_subject
    from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body

    flags = FitFlags(rigid=start.rigid, device=config.device, threads=config.threads)
    fit = effective(FitConfig, scene.settings("fit"), given(flags))
    body = load_body(start.body or scene.body or DEFAULT_BODY, "--body" if start.body else scene.path)
    _check_model(body, scene, config, start.flags)
    told = FitFlags(rigid=start.rigid, device=start.flags.device, threads=start.flags.threads)
    console.note(f"fit: {describe(fit, scene.fit, given(told))}")
    fit_subject(scene, body, fit, _kept_subject(output), console)
    return read_subject(_kept_subject(output))  # as --resume will find it, to the last bit
