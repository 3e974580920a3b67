"""Where a study's sequences come from: the shipped ones by name, or any scene by its file."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.formats.toml_table import relative_path
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.truth import Truth, at_rate
from mmocap_warp.scenes import ROOT
from mmocap_warp.whole_file import content_hash

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import Scene
    from mmocap_warp.study.sequences import StudySequence

_RIG_DECIMALS = 9  # of a calibration that count: more differ between machines


@dataclass(frozen=True)
class Clip:
    """Which frames of which sequence a cell tracks."""

    name: str  # the sequence's
    scene: Path | None = None  # its ``scene.toml``; None for a shipped sequence
    frames: int | None = None  # the most that count, from the first on; None for all
    scale: float = 1.0  # of masks and cameras, in (0, 1]; 1 for a shipped sequence
    subject: Path | None = None  # file of the subject to start from; None for the sequence's own


class ClipFacts(NamedTuple):
    """What can be said of a clip without opening it."""

    identity: str  # a hash of what a result depends on, the same on any machine
    frames: int  # their number
    models: Collection[int] = ()  # degrees of freedom that the body of a scene's subject may have


@dataclass(frozen=True)
class OpenClip:
    """A clip as a tracker needs it; the frames are 0 to ``frames - 1``."""

    fps: float  # frames per second
    subject: Subject  # where tracking starts
    rig: CameraRig  # undistorted cameras
    truth: Truth | None  # what is known of these frames, if anything
    frames: int  # their number
    observations: Iterator[Observation]  # their masks, read or made as they are asked for, once


def clip_facts(clip: Clip) -> ClipFacts:
    """A clip's identity and length.

    A shipped sequence is identified by the bodies in it (the code that makes it is part of every result's key, see
    :func:`mmocap_warp.study.store.content_key`), a recording by its scene, subject and truth and by the names and sizes
    of its images and videos. Raises an InputError for no such sequence, or a scene that is wrong or names no fitted
    subject.
    """
    if clip.scene is None:
        from mmocap_warp.study.sequences import CLIP_PLANS

        _check_shipped(clip, CLIP_PLANS)
        own = {"subject": file_hash([clip.subject])} if clip.subject else {}
        return _facts(clip, CLIP_PLANS[clip.name].frames, {"bodies": shipped_bodies()} | own)
    from mmocap_warp.formats.usd.usd_body import read_subject
    from mmocap_warp.scene.scene_toml import load_scene

    scene = load_scene(clip.scene)
    subject = clip.subject or _subject_file(scene)
    facts = _facts(clip, scene.frame_count, recording_facts(scene) | {"subject": file_hash([subject])})
    return facts._replace(models=[*read_subject(subject).body.skeleton.models])


def recording_facts(scene: Scene) -> dict[str, Any]:
    """What a result depends on of a recording, for a hash: see :func:`clip_facts`; the subject is not in it."""
    rig = scene.calibrated
    numbers = [np.round(array, _RIG_DECIMALS).tolist() for array in (rig.K, rig.R, rig.t, rig.size, rig.distortion)]
    described = {
        "fps": scene.fps,
        "foreground": asdict(scene.foreground),
        "rig": [rig.names, rig.up, numbers],
        "images": [_images(scene, k) for k in range(len(scene.cameras))],
        "truth": [file_hash([scene.truth]), scene.truth_axes, scene.truth_first_frame] if scene.truth else None,
    }
    trimmed = [scene.first_frame, scene.stride]
    described |= ({"trimmed": trimmed} if trimmed != [0, 1] else {}) | ({"fisheye": rig.fisheye} if rig.fisheye else {})
    return described


def open_clip(clip: Clip) -> OpenClip:
    """Open a clip; an InputError as of :func:`clip_facts`, or for files that turn out unreadable."""
    from mmocap_warp.formats.usd.usd_body import read_subject

    if clip.scene is None:
        from mmocap_warp.study.sequences import CLIPS

        _check_shipped(clip, CLIPS)
        opened = open_sequence(CLIPS[clip.name].first(clip.frames))
        return replace(opened, subject=read_subject(clip.subject)) if clip.subject else opened
    from mmocap_warp.formats.truth_file import load_truth
    from mmocap_warp.scene.scene_toml import load_scene

    scene = load_scene(clip.scene)
    frames = min(clip.frames or scene.frame_count, scene.frame_count)
    truth = load_truth(scene.truth, scene.truth_axes, scene.truth_first_frame) if scene.truth else None
    if truth is not None:
        if (scene.first_frame, scene.stride) != (0, 1):  # its frames are numbered from 0, as a clip's are
            truth = at_rate(truth, scene.fps)
            place = truth.frame_numbers - scene.first_frame
            own = (place >= 0) & (place % scene.stride == 0)
            truth = replace(truth.at_frames(own), fps=scene.rate, frame_numbers=place[own] // scene.stride)
        known = truth.frame_numbers < frames
        truth = truth.at_frames(known) if known.any() else None
    subject, masks = read_subject(clip.subject or _subject_file(scene)), islice(scene.observations(clip.scale), frames)
    return OpenClip(scene.rate, subject, scene.rig(clip.scale), truth, frames, masks)


def open_sequence(sequence: StudySequence, labelled: bool = False) -> OpenClip:
    """All of a sequence; ``labelled``: garments have a label of their own."""
    masks = (sequence.observation(frame, labelled) for frame in range(sequence.frame_count))
    return OpenClip(sequence.fps, sequence.subject, sequence.rig, sequence.truth, sequence.frame_count, masks)


def _check_shipped(clip: Clip, shipped: Iterable[str]) -> None:
    if clip.name not in shipped:
        remedy = f"use one of {', '.join(shipped)}, or name its scene in [sequences]"
        raise InputError("study", f"there is no sequence '{clip.name}'", remedy)
    if clip.scale != 1.0:
        raise InputError("study", f"scale = {clip.scale:g}, but {clip.name} is a shipped sequence", "use scale = 1")


def _facts(clip: Clip, frames: int, described: dict) -> ClipFacts:
    frames = min(clip.frames or frames, frames)
    depends = described | {"frames": frames, "scale": clip.scale}
    return ClipFacts(hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest(), frames)


@cache
def shipped_bodies() -> str:
    """A hash of the bodies that shipped sequences are made from; read once a process."""
    return file_hash((ROOT / "bodies").glob("*.usdc"))


def file_hash(files: Iterable[Path]) -> str:
    """A hash of files' names and content, in the order of their names."""
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(file.name.encode())
        digest.update(content_hash(file))
    return digest.hexdigest()


def _subject_file(scene: Scene) -> Path:
    if scene.subject is None:
        remedy = "fit one with 'mmocap fit' and name it as [scene] subject, so that every cell starts alike"
        raise InputError(scene.path, "names no subject", remedy)
    return scene.subject


def _images(scene: Scene, k: int) -> list:
    """Which frames camera ``k`` has: names relative to the scene and sizes, and how they are placed."""
    camera = scene.cameras[k]
    prefix = cache(lambda folder: (relative_path(Path(folder or "."), scene.directory) / "_").as_posix()[:-1])
    files = [
        (prefix(folder) + name, os.stat(file).st_size)
        for frames in (camera.video, camera.masks, camera.clean_plate, camera.background)
        if frames is not None
        for file in getattr(frames, "files", None) or (frames.path,)
        for folder, name in [os.path.split(file)]
    ]
    resampled = [camera.rate] if camera.rate != 1.0 else []
    resampled += [camera.fraction] if camera.fraction else []
    return [files, camera.frame_offset, camera.recorded_scale, camera.recorded_offset, *resampled]
