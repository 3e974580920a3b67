"""All that a run's bits depend on, so that a checkpoint is never continued as another run's, and it is said why."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, fields, is_dataclass
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.code_hash import code_hash
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.scene.recording import CameraSource, Scene
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import content_hash

Identity = dict[str, Any]
"""What a run depends on, by names for people: hashes, and settings as JSON-compatible values."""


def run_identity(scene: Scene, subject: Subject, config: TrackConfig) -> Identity:
    """What identifies a run of a scene. Files count by their content, wherever they lie and whenever they were touched.

    Raises:
        InputError: an image or a video that cannot be read.
    """
    rotation, translation = config.radii(scene.rate)
    settings = asdict(config) | {
        "dof": len(subject.body.skeleton.searched(config.dof)),
        "device": resolve_device(config.device),
        "rotation_radius": rotation,
        "translation_radius": translation,
    }
    del settings["threads"], settings["renderer"]  # any of them give the same bits
    placed = [(camera.recorded_scale, camera.recorded_offset, camera.mask_mark) for camera in scene.cameras]
    return {
        "version": __version__,
        "code": code_hash("tracking.frame_loop"),
        "images": _digest([_images(camera, scene.foreground.source) for camera in scene.cameras]),
        "frames": [scene.first_frame, scene.frame_count, scene.stride],
        "frame offsets": [[camera.frame_offset, camera.rate, camera.fraction] for camera in scene.cameras],
        "fps": scene.fps,
        "cameras": _digest([scene.calibrated, placed]),
        "body": _digest(subject.body),
        "first pose": _digest([subject.root_base, subject.pose]),
        **settings,
        **{f"foreground.{name}": value for name, value in asdict(scene.foreground).items()},
    }


def _images(camera: CameraSource, source: str) -> list[list[bytes]]:
    """The content of the files that a camera's masks are made of, in order; of those that are subtracted, too."""
    return [[content_hash(file) for file in files] for files in camera.files_for(source)]


def _digest(thing: object) -> str:
    """A hash of arrays, numbers and strings, in sequences, dictionaries and dataclasses of any depth."""
    digest = hashlib.sha256()
    unread = [thing]
    while unread:
        thing = unread.pop()
        if isinstance(thing, np.ndarray):
            digest.update(f"{thing.dtype} {thing.shape}".encode())
            digest.update(thing.tobytes())
        elif is_dataclass(thing):
            unread += [getattr(thing, field.name) for field in fields(thing)]
        elif isinstance(thing, dict):
            unread.append(list(thing.items()))
        elif isinstance(thing, list | tuple):
            digest.update(f"{len(thing)} in turn".encode())
            unread += thing
        else:
            digest.update(repr(thing).encode())
    return digest.hexdigest()
