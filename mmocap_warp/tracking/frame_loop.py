"""Tracking a recording from its first frame to its last: masks are streamed, progress is kept, answers are gathered."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.formats.toml_table import config_from_table
from mmocap_warp.masks.observation import KeptObservations, Observation
from mmocap_warp.result.result import FrameAnswer, Result
from mmocap_warp.rigging.attaching import subject_carrying
from mmocap_warp.tracking.body_masks import body_masks, tracked_masks
from mmocap_warp.tracking.checkpoint import Checkpoint, FinishedFrame, Memory, check_same_run
from mmocap_warp.tracking.memory_need import fitting_tracker
from mmocap_warp.tracking.run_identity import run_identity
from mmocap_warp.tracking.smoothing import SmoothReport, smoothed
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.versions import versions

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import Scene

FrameReport = Callable[[int, FrameAnswer], None]
"""Called after every frame with its position and answer."""


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
    device = resolve_device(config.device)
    dof = subject.body.skeleton.model_number(config.dof)
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
    config: TrackConfig | None = None,
    *,
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: FrameReport | None = None,
    smooth_progress: SmoothReport | None = None,
    **settings: Any,
) -> Result:
    """Track a scene from its first frame to its last; the result has the recording's frame numbers.

    Args:
        scene: the recording, or part of it; its masks are streamed.
        subject: where to start; what the scene says is attached and the subject lacks, it gets.
        config: settings; None for those of the scene's [track] table.
        checkpoint: file that progress is saved to, every few seconds and when the run is interrupted.
        resume: continue from ``checkpoint`` where it exists; the result has the same bits as an uninterrupted run's.
        progress: called after every frame, also once for each frame that was already done.
        smooth_progress: called with the number of frames whose poses are final, while the track is smoothed. A run
            that is resumed reads all masks again for that, and smooths its whole track anew.
        settings: fields of :class:`TrackConfig` to replace those of ``config``, such as ``evaluations=200``.

    Raises:
        ValueError, TypeError: a setting that cannot be, or is none.
        InputError: unreadable images, a checkpoint that is damaged or another run's, more than fits into the device's
            memory, or a subject that was fitted to another frame than the first.
    """
    _check_start(scene, subject)
    subject, _ = subject_carrying(subject, scene.attached)
    config = replace(config or config_from_table(TrackConfig, scene.settings("track")), **settings)
    with KeptObservations() as kept:
        answers = _tracked(scene, subject, config, checkpoint, resume, progress, kept)
        result = collect(subject, scene.rig(config.scale), scene.fps, config, answers, scene.frames)
        if not config.acceleration:
            return result
        whole = len(kept) == len(answers)
        masks = kept if whole else scene.observed(tracked_masks(scene, result))
        return smoothed(result, config, masks, smooth_progress)


def _check_start(scene: Scene, subject: Subject) -> None:
    """See that a subject's pose is that of the first frame: where tracking starts elsewhere, it starts wrong."""
    fitted = subject.provenance.get("fit.first_frame", 0)
    if fitted != scene.frames.start:
        raise InputError(
            scene.path,
            f"the subject stands as in frame {fitted}, these frames begin with {scene.frames.start}",
            "fit one with mmocap fit and the same --frames, and name it with --subject",
        )


def _tracked(
    scene: Scene,
    subject: Subject,
    config: TrackConfig,
    checkpoint: Path | None,
    resume: bool,
    progress: FrameReport | None,
    kept: KeptObservations,
) -> list[FrameAnswer]:
    """Every frame's answer; see :func:`track`. Masks that are needed again are kept."""
    rig = scene.rig(config.scale)
    identity = run_identity(scene, subject, config) if checkpoint else {}
    if checkpoint and resume:
        check_same_run(checkpoint, identity)
    tracker = fitting_tracker(subject, rig, config, scene.rate)
    done: list[FinishedFrame] = []  # in pairs, so that no interruption finds one without the other
    memory: Memory
    _, _, *memory = tracker.state
    store = None
    if checkpoint is not None:
        coordinates = subject.body.skeleton.coordinates
        store = Checkpoint(checkpoint, identity, config.runs, coordinates, len(rig), memory)
        done, memory = store.load() if resume else ([], memory)
    for number, (answer, _) in enumerate(done):
        if progress:
            progress(number, answer)
    if done:
        answer, draw = done[-1]
        tracker.state = (answer.pose, draw, *memory)
    whole = len(done), memory  # likewise
    try:
        follows = scene.foreground.keep == "nearest"
        body = body_masks(subject, rig, lambda: tracker.state[0]) if follows else None
        for observation in scene.observations(config.scale, first=len(done), body=body):
            answer = tracker.step(observation)
            if config.acceleration:
                kept.add(observation)
            _, draw, *memory = tracker.state
            done.append((answer, draw))
            whole = len(done), memory
            if progress:
                progress(len(done) - 1, answer)
            if store and store.due:
                store.save(done, memory)
        if store:
            store.save(done, memory)
    except BaseException:
        if store:
            frames, memory = whole
            store.save(done[:frames], memory)
        raise
    return [answer for answer, _ in done]


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
    tracker = fitting_tracker(subject, rig, config, fps)
    answers, kept = [], []
    for number, observation in enumerate(observations):
        answers.append(tracker.step(observation))
        if config.acceleration:
            kept.append(observation)
        if progress:
            progress(number, answers[-1])
    del tracker  # smoothing counts on its memory
    result = collect(subject, rig, fps, config, answers)
    return smoothed(result, config, kept) if config.acceleration else result
