"""The loop over frames: masks are streamed, trackers step, progress is kept, and the answers are gathered and smoothed.

The way of a frame: :func:`track_frames` has its masks tracked (``Tracker.step`` or ``ContourTracker.step``),
:func:`collect` makes a result of all answers, and :func:`~mmocap_warp.tracking.smoothing.smoothed` solves the clip.
"""

import gc
from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from dataclasses import asdict, replace
from functools import partial
from itertools import chain, islice
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.masks.observation import KeptObservations, Observation
from mmocap_warp.masks.repeats import frozen_views, repeated_views
from mmocap_warp.result.result import STATUS, FrameAnswer, Result
from mmocap_warp.result.verdict import frames_by_name, views_beside
from mmocap_warp.rigging.attaching import subject_carrying
from mmocap_warp.scene.frame_choice import read_ahead
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.body_masks import body_silhouettes, tracked_observations
from mmocap_warp.tracking.checkpoint import Checkpoint, read_checkpoint, run_identity, with_code_of
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.evidence import with_evidence
from mmocap_warp.tracking.from_settings import in_own_unit
from mmocap_warp.tracking.holes import HOLE_SECONDS
from mmocap_warp.tracking.loose_clothes import PoseBefore, with_hidden
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.smoothing import SmoothReport, smoothed
from mmocap_warp.tracking.smoothing_beside import SmoothingBeside, SmoothingElsewhere, smoothing_beside
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker, lost_frame
from mmocap_warp.versions import versions

FrameReport = Callable[[int, FrameAnswer], None]  # called after every frame with its position and answer

_LEAST_VIEWS = 3  # that are left where the view of a camera that was moved is left out


def track_frames(
    tracker: Tracker | ContourTracker,
    observations: Iterable[Observation],
    *,
    first: int = 0,
    keep: Callable[[Observation], object] | None = None,
    saved: Checkpoint | None = None,
    progress: FrameReport | None = None,
) -> Iterator[FrameAnswer]:
    """Track frame after frame, and give each answer as soon as it is found.

    The tracker is in the state after the frame before the ``first``, a position. ``keep`` is called with each
    observation that was tracked, such as to have it for smoothing, and ``progress`` after every frame.
    """
    for number, observation in enumerate(observations, first):
        answer = tracker.step(observation)
        if keep:
            keep(observation)
        if saved:
            saved.add(answer, tracker.state)
        if progress:
            progress(number, answer)
        if saved:
            saved.save_if_due()
        yield answer


def collect(
    subject: Subject,
    rig: CameraRig,
    fps: float,
    config: TrackConfig,
    answers: list[FrameAnswer],
    frames: range | None = None,
) -> Result:
    """Gather the answers of consecutive frames, or of those of the recording that ``frames`` names."""
    frames = range(len(answers)) if frames is None else frames
    rotation, translation = config.radii(fps / frames.step)
    device, dof = resolve_device(config.device), subject.body.skeleton.model_number(config.dof)
    effective = {"dof": dof, "rotation_radius": rotation, "translation_radius": translation, "device": device}
    return Result(
        subject=subject,
        cameras=rig,
        fps=fps,
        frame_numbers=np.array(frames),
        pose=np.stack([answer.pose for answer in answers], axis=1).astype(np.float64),
        cost=np.stack([answer.cost for answer in answers], axis=1).astype(np.float64),
        iou=np.stack([answer.iou for answer in answers], axis=1),
        evaluations=np.repeat([[answer.evaluations for answer in answers]], config.runs, axis=0).astype(np.int64),
        status=np.stack([np.broadcast_to(answer.status, config.runs) for answer in answers], axis=1).astype(np.int8),
        seconds=float(sum(answer.seconds for answer in answers)),
        config=asdict(config) | effective,
        versions=versions(device),
    )


def track(
    scene: Scene,
    subject: Subject,
    config: TrackConfig,
    *,
    checkpoint: Path | None = None,
    resume: bool = False,
    accept_changed_code: bool = False,
    progress: FrameReport | None = None,
    smooth_progress: SmoothReport | None = None,
) -> Result:
    """Track a scene from its first frame to its last; the result has the recording's frame numbers.

    A body that is larger than any person is tracked in a unit of length in which it is as large as one: what priors,
    margins and steps are in metres holds for people.

    Args:
        scene: the recording, or part of it; its masks are streamed.
        subject: where to start; what the scene says is attached and the subject lacks, it gets.
        config: settings.
        checkpoint: file that progress is saved to, every few seconds and when the run is interrupted.
        resume: continue from ``checkpoint`` where it exists; the result has the same bits as an uninterrupted run's.
        accept_changed_code: continue also where another version of the program began; its frames stay as they are.
        progress: called after every frame, also once for each frame that was already done; for all of them once more
            where tracking starts again without the views of cameras that froze or were moved.
        smooth_progress: called with the number of frames whose poses are final, while the track is smoothed. A run
            that is resumed reads all masks again for that, and smooths its whole track anew.

    Raises:
        InputError: unreadable images, a checkpoint that is damaged, another run's or of another version, more than fits
            into the device's memory, or a subject that was fitted to another frame than the first.
    """
    check_start(scene, subject)
    subject, _ = subject_carrying(subject, scene.attached)
    rig, unit = scene.rig(config.scale), subject.body.unit

    # Smooth meanwhile, but a run that is resumed only once its frames are all there.
    frames = 0 if resume and checkpoint is not None and checkpoint.exists() else scene.frame_count
    with KeptObservations() as kept, smoothing_beside(frames, config, kept, smooth_progress) as beside:
        # Refuse another run's checkpoint before anything is built.
        identity = run_identity(scene, subject, config) if checkpoint else {}
        if checkpoint and resume:
            identity = with_code_of(checkpoint, identity) if accept_changed_code else identity
            read_checkpoint(checkpoint, identity)
        given: dict[str, Any] = {"subject": subject, "cameras": rig}
        subject, rig, config = in_own_unit(subject, rig, config)
        tracker = make_tracker(subject, rig, config, scene.rate)

        # Go on after the frames that were saved, which may be those of later starts, too.
        answers: list[FrameAnswer] = []
        saved = Checkpoint(checkpoint, identity, tracker.state, len(rig)) if checkpoint else None
        if saved and resume:
            answers, tracker.state = saved.resumed()
        count, state = scene.frame_count, tracker.state
        later = [answers[count : 2 * count], answers[2 * count :]]
        del answers[count:]

        # Track the others. What is kept of masks with several people in them follows the body.
        silhouettes_of, done = body_silhouettes(subject, rig), len(answers)
        body = (lambda: silhouettes_of(tracker.state.pose)) if scene.foreground.keep == "nearest" else None
        observations = kept.through(scene.observations(config.scale, first=done, body=body))
        if body is None:
            observations = read_ahead(observations)

        # A hole that was open when the run was interrupted is still open.
        first = max(0, done - ceil(HOLE_SECONDS * scene.rate))
        if first < done:
            begun = collect(subject, rig, scene.fps, config, answers, scene.frames[:done])
            observations = chain(tracked_observations(scene, begun, range(first, done)), observations)
        observations = with_hidden(observations, subject, rig, scene.rate, lambda i: answers[first + i - 1].pose)
        if beside:
            blank = lost_frame(tracker.state.pose, len(rig))
            beside.begin(collect(subject, rig, scene.fps, config, [blank] * scene.frame_count, scene.frames), config)
        _extend(answers, tracker, islice(observations, done - first, None), saved, progress, beside)
        result = collect(subject, rig, scene.fps, config, answers, scene.frames)
        complete = len(kept) == len(answers)

        # Smooth the track, and see how the masks lie beside it. Frames of before a resumption, or what a full disk
        # had no room for, are read again.
        def masks() -> Iterable[Observation]:
            return kept if complete else tracked_observations(scene, result)

        def start_again(shown: Callable[[PoseBefore], Iterator[Observation]]) -> list[FrameAnswer]:
            tracker, again = make_tracker(subject, rig, config, scene.rate), later.pop(0)
            if again:
                tracker.state = state
            seen = shown(lambda place: again[place - 1].pose)
            _extend(again, tracker, islice(seen, len(again), None), saved, progress)
            return again

        finished = _finished(result, config, masks, start_again, smooth_progress, beside if complete else None)
        return replace(finished.in_unit(1 / unit), **given)


def _extend(
    answers: list[FrameAnswer],
    tracker: Tracker | ContourTracker,
    observations: Iterable[Observation],
    saved: Checkpoint | None,
    progress: FrameReport | None,
    beside: SmoothingBeside | SmoothingElsewhere | None = None,
) -> None:
    """Track the frames after those whose ``answers`` are known."""
    if progress:
        for number, answer in enumerate(answers):
            progress(number, answer)
    with saved or nullcontext():
        for answer in track_frames(tracker, observations, first=len(answers), saved=saved, progress=progress):
            if beside:
                beside.add(len(answers), answer)
            answers.append(answer)


def _finished(
    result: Result,
    config: TrackConfig,
    masks: Callable[[], Iterable[Observation]],
    start_again: Callable[[Callable[[PoseBefore], Iterator[Observation]]], list[FrameAnswer]],
    progress: SmoothReport | None,
    beside: SmoothingBeside | SmoothingElsewhere | None = None,
) -> Result:
    """The track, smoothed where that is wanted, and what the masks, read anew each time, say about it.

    A frame that repeats the one before shows nothing, and neither does a view whose camera is frozen. The tracker has
    followed that view, so it must ``start_again`` with what is shown then, or if a camera was moved, without its view.
    What smoothed the track ``beside`` knew of neither: it holds where there are none.
    """
    repeated = repeated_views(read_ahead(masks()))
    at_once, frozen = repeated.all(axis=1), frozen_views(repeated)
    whole = beside if not repeated.any() else None
    if beside and not whole:
        beside.close()  # else two threads smooth at once

    def masks_without(left_out: np.ndarray, pose: PoseBefore) -> Iterator[Observation]:
        seen = with_hidden(masks(), result.subject, result.cameras, result.rate, pose)
        return (each.without(views) for each, views in zip(seen, left_out, strict=True)) if left_out.any() else seen

    def track_without(views: np.ndarray, why: str) -> Result:
        gc.collect()  # what smoothed a track holds itself, and with it the fields of a window
        tracked = start_again(partial(masks_without, frozen | views))
        begun = collect(result.subject, result.cameras, result.fps, config, tracked)
        own, seconds = result.config | {why: frames_by_name(result, views)}, result.seconds + begun.seconds
        return replace(begun, frame_numbers=result.frame_numbers, config=own, seconds=seconds)

    def finish(raw: Result, left_out: np.ndarray, whole: SmoothingBeside | SmoothingElsewhere | None = None) -> Result:
        status = np.where(at_once, STATUS.index("repeated"), raw.status).astype(raw.status.dtype)
        result, seen = replace(raw, status=status), partial(masks_without, left_out, lambda at: raw.pose[:, at - 1])
        if not config.acceleration:
            return with_evidence(result, config, read_ahead(seen()))
        return (whole and whole.of(result)) or smoothed(result, config, read_ahead(seen()), progress)

    result = finish(track_without(frozen, "frozen_views") if frozen.any() else result, frozen, whole)
    moved = views_beside(result)
    moved &= (np.isfinite(result.iou[result.best_run]) & ~moved).sum(axis=1, keepdims=True) >= _LEAST_VIEWS
    return finish(track_without(moved, "moved_views"), frozen | moved) if moved.any() else result


def check_start(scene: Scene, subject: Subject) -> None:
    """See that a subject's pose is that of the first frame, or raise InputError: elsewhere tracking starts wrong."""
    fitted = subject.provenance.get("fit.first_frame", 0)
    if fitted != scene.frames.start:
        problem = f"the subject was fitted to frame {fitted}, but tracking begins with frame {scene.frames.start}"
        where = f"in [people.{scene.person}]" if scene.person else "with --subject"
        remedy = f"start with --frames {fitted}:, or fit a subject with the same --frames and name it {where}"
        raise InputError(scene.path, problem, remedy)


def track_observations(
    subject: Subject,
    rig: CameraRig,
    observations: Iterable[Observation],
    fps: float,
    config: TrackConfig,
    progress: FrameReport | None = None,
) -> Result:
    """Track consecutive observations in memory or from any stream; they are kept until the track is smoothed.

    Raises:
        InputError: more than fits into the device's memory.
    """
    kept: list[Observation] = []
    keep = kept.append if config.acceleration else None
    unit, given = subject.body.unit, dict[str, Any](subject=subject, cameras=rig)
    subject, rig, config = in_own_unit(subject, rig, config)
    tracker = make_tracker(subject, rig, config, fps)
    observations = with_hidden(observations, subject, rig, fps, lambda _: tracker.state.pose)
    answers = list(track_frames(tracker, observations, keep=keep, progress=progress))
    result = collect(subject, rig, fps, config, answers)
    result = smoothed(result, config, kept) if config.acceleration else result
    return replace(result.in_unit(1 / unit), **given)
