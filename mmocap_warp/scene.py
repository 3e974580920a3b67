"""A recording as its ``scene.toml`` describes it: calibrated cameras, where their images lie, what is foreground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.cameras import CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.foreground.frames import Frames, VideoFile
from mmocap_warp.foreground.mask_image import decode_mask
from mmocap_warp.foreground.settings import ForegroundSettings
from mmocap_warp.observation import Observation
from mmocap_warp.undistort import Undistortion, undistortion


@dataclass(frozen=True)
class CameraSource:
    """Where one camera's images lie.

    Attributes:
        name: as in the calibration.
        video: the recording, or None.
        masks: its masks (a folder of images or a video), or None.
        clean_plate: an image without the subject, or None.
        background: a video without the subject, or None.
        frame_offset: scene frame ``f`` is this camera's frame ``f + frame_offset``; 1 for a camera that lags by one.
        recorded_scale, recorded_offset: recorded pixel = scale * calibrated pixel + offset.
    """

    name: str
    video: VideoFile | None
    masks: Frames | None
    clean_plate: Path | None
    background: VideoFile | None
    frame_offset: int
    recorded_scale: float
    recorded_offset: tuple[float, float]


@dataclass(frozen=True)
class Scene:
    """A recording. Frames run from 0 to ``frame_count - 1``; a camera whose shifted frame does not exist is lost there.

    Attributes:
        path: the scene file.
        name: for people.
        fps: frames per second.
        frame_count: number of frames, the same for all cameras.
        calibrated: the rig as calibrated (refined centres applied), with distortion, at full size.
        cameras: in the rig's order.
        foreground: how masks are made.
        subject: a fitted subject, or None.
        body: a body file, or the name of a shipped body, or None.
        truth: reference joints or a result to compare with, or None.
        truth_axes: which axes of the truth file are the world's x, y, z, such as ``zxy``.
        track: settings of the tracker, as written.
        fit: settings of the first-frame fit, as written.
    """

    path: Path
    name: str
    fps: float
    frame_count: int
    calibrated: CameraRig
    cameras: tuple[CameraSource, ...]
    foreground: ForegroundSettings
    subject: Path | None = None
    body: str | Path | None = None
    truth: Path | None = None
    truth_axes: str = "xyz"
    track: dict[str, Any] = field(default_factory=dict)
    fit: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def directory(self) -> Path:
        """The folder of the scene file."""
        return self.path.parent

    def rig(self, scale: float = 1.0) -> CameraRig:
        """The undistorted pinholes of the images at ``scale``."""
        return self.calibrated.undistorted(scale)

    def observations(self, scale: float = 1.0, first: int = 0, count: int | None = None) -> Iterator[Observation]:
        """Masks of frames ``first`` to ``first + count - 1`` (to the end without ``count``), one frame at a time.

        Raises:
            ValueError: frames that the scene does not have.
            InputError: images that turn out unreadable.
        """
        for masks in self.masks(scale, first, count):
            yield Observation.from_masks(masks)

    def masks(self, scale: float = 1.0, first: int = 0, count: int | None = None) -> Iterator[list[np.ndarray]]:
        """As :meth:`observations`, unpacked: per camera (height, width) bool."""
        count = self._checked_count(first, count)
        sizes = self.rig(scale).size
        maps = self._undistortions(scale)
        streams = [
            _shifted(source.masks, first + source.frame_offset, count)
            for source in self.cameras
            if source.masks is not None
        ]
        for images in zip(*streams, strict=True):
            yield [
                np.zeros((height, width), bool) if image is None else maps[k].mask(decode_mask(image))
                for k, (image, (width, height)) in enumerate(zip(images, sizes, strict=True))
            ]

    def images(self, scale: float = 1.0, first: int = 0, count: int | None = None) -> Iterator[list[np.ndarray | None]]:
        """Undistorted BGR images, pixel for pixel as the masks; None for a camera without video or frame."""
        count = self._checked_count(first, count)
        maps = self._undistortions(scale)
        streams = [_shifted(source.video, first + source.frame_offset, count) for source in self.cameras]
        for images in zip(*streams, strict=True):
            yield [None if image is None else maps[k].image(image) for k, image in enumerate(images)]

    def _checked_count(self, first: int, count: int | None) -> int:
        count = self.frame_count - first if count is None else count
        if first < 0 or count < 0 or first + count > self.frame_count:
            raise ValueError(f"frames {first} to {first + count - 1} are not in 0 to {self.frame_count - 1}")
        return count

    def _undistortions(self, scale: float) -> list[Undistortion]:
        return [
            undistortion(self.calibrated, k, scale, source.recorded_scale, source.recorded_offset)
            for k, source in enumerate(self.cameras)
        ]


def _shifted(frames: Frames | None, first: int, count: int) -> Iterator[np.ndarray | None]:
    """Frames ``first`` to ``first + count - 1``; None where there is none, and one at a time in memory."""
    reader = None
    for frame in range(first, first + count):
        if frames is None or not 0 <= frame < len(frames):
            yield None
            continue
        reader = reader or frames.read(frame)
        image = next(reader, None)
        if image is None:
            raise InputError(frames.path, f"frame {frame} is missing", "restore the file")
        yield image


def load_scene(path: str | Path) -> Scene:
    """Read and check a ``scene.toml`` (or the folder that holds one); paths in it are relative to its folder.

    Raises:
        InputError: anything that is wrong with the scene file, the calibration, or the files it names.
    """
    from mmocap_warp.formats.scene_toml import read_scene  # it builds a Scene, so it imports this module

    return read_scene(path)
