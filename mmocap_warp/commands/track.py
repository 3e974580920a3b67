"""From a scene to a subject and a result: ``mmocap fit`` and ``mmocap track``."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from glob import escape
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.calibration.adjust.camera_changes import AdjustConfig
from mmocap_warp.commands import inputs
from mmocap_warp.commands.caller import Progress, Reporter, describe, effective, start_warp
from mmocap_warp.commands.mask import with_masks
from mmocap_warp.commands.outputs import new_file, releases_locks
from mmocap_warp.commands.track_pieces import spans_of, track_in_pieces
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.fitting import subject_fit
from mmocap_warp.fitting.fit_config import FitConfig
from mmocap_warp.formats.usd.usd_body import read_subject, write_subject
from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
from mmocap_warp.formats.usd.usd_result import read_result, write_result
from mmocap_warp.result.result import FrameAnswer, Result
from mmocap_warp.rigging.attaching import carrying, subject_carrying
from mmocap_warp.rigging.shipped import DEFAULT_BODY, body_file
from mmocap_warp.rigging.start_poses import start_poses as named_start_poses
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking import frame_loop
from mmocap_warp.tracking.checkpoint import asked_for
from mmocap_warp.tracking.track_config import AS_GIVEN, REFINE, TrackConfig

_UNDECIDED = {
    "turned": "fit: the masks do not tell which way the subject faces; it may be back to front",
    "swapped": "fit: the masks do not tell left limbs from right ones; they may be swapped",
}
_UNDECIDED_LYING = {  # the same of a body that does not stand
    "turned": "fit: the masks do not tell which way the subject lies; it may lie the other way round",
    "swapped": "fit: the masks do not tell similar limbs from one another; they may be swapped",
}


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
    person: str | None = None,
    trust_cameras: bool = False,
    force: bool = False,
    reporter: Reporter | None = None,
    **settings: Any,
) -> Subject:
    """Find the body's place, heading and first pose in a scene's first frame, and its shape in the first seconds.

    Args:
        scene: the recording, or its file or folder.
        body: a generic body like the subject's: a shipped one's name or a USD file. What the scene attaches is added.
            [default: the scene's, or adult_man]
        config: settings. [default: those of the scene's [fit] table]
        start_poses: roughly how the recording starts: names of the body's motions, some frames of which are tried,
            or .toml files of angles in degrees such as 'LKnee.Rx = 40', shifts in metres; one or several. From Python
            also an array (pose, coordinate). [default: the body's usual ones]
        output: the subject's file: .usdc, .usda or .usd. Name it as 'subject' in the scene to track with it.
        frames: which of the recording's frames: first:end or first:end:stride. A number is the setting of that name.
            [default: those that the scene names]
        identity: of the person who is meant, where masks show several.
        person: who is meant of the scene's people, by name; the command also takes all. [default: the scene's, or all]
        trust_cameras: go on even if masks and calibration fit no body; the subject says so.
        force: replace a file that exists.
        reporter: receives notes and progress.
        settings: fields of :class:`FitConfig` that replace those of ``config``, such as ``headings=4``.

    Raises:
        UsageError: a setting that cannot be. TypeError: one that does not exist.
        InputError: the first frame's masks do not show one subject in at least two views, or a file is wrong.
    """
    reporter = reporter or Reporter()
    file = None if output is None else new_file(output, *USD_SUFFIXES, force=force)
    if isinstance(frames, int):
        settings, frames = settings | {"frames": frames}, None
    loaded = inputs.one_person(inputs.scene_from(scene, frames, identity, reporter, person=person))
    inputs.keep_named(file, loaded, "truth")
    chosen = effective(FitConfig, loaded.settings("fit"), settings, config)
    generic, poses = inputs.body_from(body, loaded), _start_poses(start_poses, body, loaded)
    is_given = config is not None or "device" in settings
    start_warp(chosen.device, None if is_given else f"{loaded.path}: [fit]")
    trusted = inputs.look_first(loaded, generic, reporter, trust_cameras)
    reporter.note(f"fit: {describe(chosen, loaded.fit if config is None else {}, settings)}")
    return fit_subject(loaded, generic, chosen, file, reporter, trusted, poses)


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
    trusted: dict[str, str],
    start_poses: np.ndarray | None = None,
) -> Subject:
    """Fit a body to a scene, and write it where there is an ``output``; a note says where masks do not decide.

    ``start_poses`` (pose, coordinate) are those in which the recording may start; None for the body's usual ones.
    ``trusted`` is what :func:`look_first` returned.

    Raises:
        InputError: the first frame's masks do not show one subject.
    """
    # What is attached begins as it is carried; its joints come last.
    carried, notes = carrying(body, scene.attached)
    for note in notes:
        reporter.note(f"attach: {note}")
    if start_poses is not None:
        own, coordinates = body.skeleton.coordinates, carried.skeleton.coordinates
        if start_poses.shape[1:] != (own,) or not np.isfinite(start_poses).all():
            raise UsageError(f"--start-poses must be finite and (pose, {own}), got shape {start_poses.shape}")
        start_poses = np.pad(start_poses, ((0, 0), (0, coordinates - own)))
    with reporter.stage("fit", None) as progress:
        subject = subject_fit.fit(
            scene, carried, config, lambda stage, done, cost: progress(round(100 * done), 100), start_poses
        )
    if float(subject.provenance["fit.cost"]) > subject_fit.MAX_COST:
        reporter.warn(
            "fit: the body fits the first frame's masks badly; look at them, or begin with another (--frames)"
        )
    if subject.provenance["fit.decided"] == "no":
        name = str(subject.provenance["fit.alternative"])
        reporter.note((_UNDECIDED if body.skeleton.stands else _UNDECIDED_LYING)[name])
    not_heeded = {f"fit.{name}": problem for name, problem in trusted.items()}
    facts = inputs.scene_reference(scene, output, "fit.") | not_heeded
    subject = replace(subject, provenance={**subject.provenance, **facts})
    if output is not None:
        write_subject(output, subject)
    return subject


@releases_locks
def track(
    scene: Scene | str | Path,
    subject: Subject | BodyModel | str | Path | None = None,
    config: TrackConfig | None = None,
    *,
    output: str | Path | None = None,
    body: BodyModel | str | Path | None = None,
    rigid: bool | None = None,
    frames: inputs.Frames = None,
    identity: int | None = None,
    person: str | None = None,
    pieces: int = 1,
    again: Result | str | Path | None = None,
    pins: str | Path | list[dict[str, Any]] | None = None,
    resume: bool = False,
    accept_changed_code: bool = False,
    trust_cameras: bool = False,
    force: bool = False,
    reporter: Reporter | None = None,
    **settings: Any,
) -> Result:
    """Track a scene from its first frame to its last; where no subject is named, one is fitted first.

    Args:
        scene: the recording, or its file or folder. Masks that a program makes are made first, and kept beside it.
        subject: the fitted subject to track, or its file. From Python also a body, or a shipped one's name, which is
            fitted first. [default: the scene's, or else one is fitted first and kept beside the result]
        config: settings. [default: those of the scene's [track] table]
        output: the result's file: .usdc, .usda or .usd. A checkpoint lies beside it until the run is complete. Unless
            it is named, the command makes what is missing beside the scene: result.usdc, its overlay and its page.
        body: where that fit starts: a shipped body's name or a USD file. [default: the scene's, or adult_man]
        rigid: that body's bones' lengths, girths and scale are known: fit the pose alone. [default: what the body says]
        frames: which of the recording's frames. [default: those that the scene names]
        identity: of the person who is meant, where masks show several.
        person: who is meant of the scene's people, by name; the command also takes all. [default: the scene's, or all]
        pieces: into which a long clip is cut. Processes that share the threads track them side by side, on the CPU or
            in turn on all GPUs. Another number gives slightly other poses.
        again: a result of this scene, in which only the frames around pins, or those of --frames, are solved anew; all
            others keep their bits. Subject and settings are the result's own; device and threads may be other ones.
        pins: for --again, a file of joints that were clicked in two views or more, which 'mmocap view' helps to write.
            From Python also a list of dictionaries.
        resume: continue an interrupted run; it ends with the same bits as one that was not interrupted.
        accept_changed_code: resume also where another version of the program began; its frames stay as they are.
        trust_cameras: go on even if masks and calibration fit no body; the result says so.
        force: replace a result that exists.
        reporter: receives notes and progress.
        settings: fields of :class:`TrackConfig` that replace those of ``config``, such as ``evaluations=200``.

    Raises:
        UsageError: a setting that cannot be. TypeError: one that does not exist, or what is no subject and no body.
        InputError: anything wrong with the scene's images, the subject or the body, or masks and calibration that fit
            no body; an interrupted run lies there and neither ``resume`` nor ``force`` says what to do with it.
    """
    reporter = reporter or Reporter()
    if resume and force:
        raise UsageError("--resume and --force cannot both be given: one continues the run, the other replaces it")
    if resume and output is None:
        raise UsageError("--resume needs --output, the file of the run that it continues")
    if again is not None:
        others = {"subject": subject, "body": body, "resume": resume, "pieces": pieces > 1}
        if given_too := [name for name, value in others.items() if value]:
            raise UsageError(f"--again cannot be given with --{given_too[0]}: it solves part of its result anew")
        if pins is not None and frames is not None:
            raise UsageError("--frames cannot be given with --pins, which say themselves what is solved anew")
    elif pins is not None:
        raise UsageError("--pins needs --again, the result whose frames were pinned")
    subject, body = _starts_from(subject, body)
    if subject is not None and (body is not None or rigid is not None):
        raise UsageError("--body and --rigid say how to fit a subject; --subject names a fitted one")
    file = None if output is None else new_file(output, *USD_SUFFIXES, force=force or resume)
    loaded = inputs.one_person(inputs.scene_from(scene, frames, identity, reporter, person=person))
    inputs.keep_named(file, loaded, "truth", "subject")
    if file is not None:
        inputs.refuse_live(file)
    if again is not None:
        from mmocap_warp.commands.track_again import solved_again  # and with it what draws

        return solved_again(loaded, again, pins, config, file, reporter, settings)
    loaded = with_masks(loaded, reporter, effective(TrackConfig, loaded.settings("track"), settings, config))
    chosen = inputs.track_settings(loaded, settings, config)
    inputs.truth_of(loaded)  # a truth that cannot be read is an error now, and not after hours
    given = settings if config is None else {name: getattr(chosen, name) for name in vars(chosen)}

    start_warp(chosen.device, None if "device" in given else f"{loaded.path}: [track]")
    checkpoint = None if file is None else file.with_name(f"{file.name}.checkpoint")
    if checkpoint is not None and checkpoint.exists() and not (resume or force):
        remedy = "continue it with --resume, or --force a new one"
        raise InputError(checkpoint, "an interrupted run lies here", remedy)
    # What cannot be is an error before a fit of minutes.
    loaded.rig(chosen.scale)
    spans = spans_of(loaded, pieces)

    # The subject: named, kept by the run that is resumed, or fitted.
    kept = None if file is None else file.with_name(f"{file.stem}.subject.usdc")
    if subject is None and body is None:
        subject = loaded.subject
    if subject is None:
        inputs.keep_named(kept, loaded, "subject")
    if isinstance(subject, str | Path):
        subject = read_subject(subject)
    generic = inputs.body_from(body, loaded) if subject is None else subject.body
    _check_model(generic, loaded, chosen, given)
    named = subject or Subject(generic, np.eye(3), np.zeros(generic.skeleton.coordinates), {})
    more = [each for each in (pieces > 1 and pieces, *([rigid, loaded.fit] if subject is None else ())) if each]
    asked = {}
    if file is not None:
        asked["asked"] = asked_for(loaded, subject_carrying(named, loaded.attached)[0], chosen, more)
    if resume and file is not None and file.exists() and not (checkpoint and checkpoint.exists()):
        return _complete(file, asked["asked"], given.get("cameras", loaded.track.get("cameras")), reporter)
    fitted_for = f"{chosen.cameras} {asked.get('asked')}"
    goes_on = resume and checkpoint is not None and checkpoint.exists()
    if subject is None and resume and kept is not None and kept.exists():
        known = read_subject(kept)
        if known.provenance.get("fit.asked", fitted_for) == fitted_for:  # else it is fitted anew
            subject, generic, goes_on = known, known.body, True
        elif goes_on:
            problem = "is of a run of other frames, settings, cameras or masks, or of another body"
            raise InputError(f"{file}.checkpoint", problem, "ask for what was asked for then, or give --force")
    refines = chosen.cameras == REFINE
    trusted = inputs.look_first(loaded, generic, reporter, trust_cameras, start=subject, to_be_mended=refines)
    if refines:
        loaded, refined = _refined(loaded, subject, generic, chosen, file, goes_on, reporter)
        trusted |= refined
    if subject is None:
        subject = _fitted(loaded, generic, chosen, given, rigid, kept, trusted | {"asked": fitted_for}, reporter)
    start, notes = subject_carrying(subject, loaded.attached)
    for note in notes:
        reporter.note(f"attach: {note}")
    chosen = replace(chosen, dof=start.body.skeleton.model_number(chosen.dof))
    reporter.note(f"track: {describe(chosen, loaded.track, given)}")

    resumption = {"resume": resume, "accept_changed_code": accept_changed_code}
    if pieces > 1:
        tracked = track_in_pieces(loaded, start, chosen, spans, reporter, checkpoint, **resumption)
    else:
        tracked = _tracked(loaded, start, chosen, reporter, checkpoint=checkpoint, **resumption)
    tracked = replace(tracked, config=tracked.config | inputs.scene_reference(loaded, file) | trusted | asked)
    if file is not None and checkpoint is not None:
        write_result(file, tracked)
        for each in file.parent.glob(f"{escape(checkpoint.name)}*"):  # of this run's pieces, and of another's
            each.unlink(missing_ok=True)
    return tracked


def _complete(file: Path, asked: str, cameras: str | None, reporter: Reporter) -> Result:
    """The result that is there; an InputError if something else was ``asked`` for then, or other ``cameras``."""
    done = read_result(file)
    # Versions before 30 November 2026 do not say what was asked for.
    if done.config.get("asked", asked) != asked or cameras not in (None, done.config.get("cameras", AS_GIVEN)):
        problem = "is of other frames, settings, cameras or masks than are asked for now, or of another subject or body"
        raise InputError(file, problem, "replace it with --force, or write elsewhere")
    reporter.note(f"{file} is complete")
    return done


def _refined(
    scene: Scene,
    subject: Subject | None,
    body: BodyModel,
    config: TrackConfig,
    output: Path | None,
    begun: bool,
    reporter: Reporter,
) -> tuple[Scene, dict[str, str]]:
    """The scene with cameras and times that are refined where that is significantly better, and what a result says.

    The calibration is kept beside the result. A run that had ``begun`` reads it, or has none.
    """
    from mmocap_warp.commands.calibrate import refine_scene

    kept = None if output is None else output.with_name(f"{output.stem}.calibration.toml")
    refined: Scene | None = None
    if not begun:
        inputs.keep_named(kept, scene, "calibration")
        adjust = AdjustConfig(seed=config.seed, device=config.device, threads=config.threads, subject=subject)
        found = refine_scene(scene, body, adjust, kept, reporter)
        if found.better:
            refined = scene.with_cameras(found.rig, found.offsets(scene))
        elif kept is not None:
            kept.unlink(missing_ok=True)
    # What was written is read back, so that a resumed run has the same cameras to the last bit.
    if kept is not None and kept.exists():
        refined = inputs.with_refined(scene, kept)
    if refined is None:
        reporter.note("cameras: as given; no change explains the masks significantly better")
        return scene, {}
    kept_in = "in memory" if kept is None else kept.name
    reporter.note(f"cameras: refined, {kept_in}")
    return refined, {"refined_cameras": kept_in}


def _starts_from(
    subject: Subject | BodyModel | str | Path | None, body: BodyModel | str | Path | None
) -> tuple[Subject | str | Path | None, BodyModel | str | Path | None]:
    """The subject to track, or the body to fit; a name without an ending is a shipped body's."""
    if isinstance(subject, BodyModel) or (isinstance(subject, str) and not Path(subject).suffix):
        return None, subject
    if isinstance(subject, Subject | str | Path | None):
        return subject, body
    possible = "a Subject, which is tracked, or a BodyModel, which is fitted first"
    raise TypeError(f"subject must be {possible}, not a {type(subject).__name__}")


def _fitted(
    scene: Scene,
    generic: BodyModel,
    config: TrackConfig,
    given: dict[str, Any],
    rigid: bool | None,
    output: Path | None,
    trusted: dict[str, str],
    reporter: Reporter,
) -> Subject:
    """A subject fitted to the scene, and kept beside the result."""
    settings = {"rigid": rigid, "device": config.device, "threads": config.threads}
    settings["seed"] = config.seed if "seed" in given else None  # else the scene's own of its [fit] table holds
    settings = {name: value for name, value in settings.items() if value is not None}
    fit = effective(FitConfig, scene.settings("fit"), settings)
    stated = {name: value for name, value in settings.items() if name == "rigid" or name in given}
    reporter.note(f"fit: {describe(fit, scene.fit, stated)}")
    subject = fit_subject(scene, generic, fit, output, reporter, trusted)
    return subject if output is None else read_subject(output)  # as a resumed run will find it, to the last bit


def _check_model(body: BodyModel, scene: Scene, config: TrackConfig, given: dict[str, Any]) -> None:
    """See that the body has a model with as many degrees of freedom as the caller or the scene asks for."""
    try:
        body.skeleton.searched(config.dof)
    except ValueError as error:
        if given.get("dof") is not None:
            raise UsageError(f"--{error}") from None
        raise InputError(f"{scene.path}: [track]", str(error), "correct that value") from None


def _tracked(scene: Scene, subject: Subject, config: TrackConfig, reporter: Reporter, **resumption: Any) -> Result:
    """Track, and report progress: of the frames, perhaps of a second start, then of frames whose poses are final."""
    total, evaluations = scene.frame_count, 0
    with ExitStack() as stages:
        progress: Progress = stages.enter_context(reporter.stage("track"))

        def begin(stage: str) -> None:
            nonlocal progress
            stages.close()
            progress = stages.enter_context(reporter.stage(stage))

        def report(frame: int, answer: FrameAnswer) -> None:
            nonlocal evaluations
            if frame == 0 and evaluations:
                begin("track again")
            evaluations += answer.evaluations * config.runs
            progress(frame + 1, total, evaluations)
            if config.acceleration and frame + 1 == total:
                begin("smooth")

        return frame_loop.track(
            scene, subject, config, progress=report, smooth_progress=lambda done: progress(done, total), **resumption
        )
