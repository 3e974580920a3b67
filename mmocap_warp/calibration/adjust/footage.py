"""The frames of a recording that calibrate it, with cameras and times that may yet change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.observation import Observation
from mmocap_warp.scene.recording import Scene

_RATE = 30.0  # frames a second: more are not needed to follow a person
_MAX_SECONDS = 20.0  # seconds of a recording that are used
_MAX_PIXELS = 640  # pixels of an image's longer side: more are not needed for outlines


@dataclass(frozen=True)
class Footage:
    """A recording's masks, read again whenever its cameras' times change.

    The masks are read without repair, because repairing them would need the calibration that is in doubt.

    Attributes:
        scene: the recording.
        scale: of masks and cameras.
    """

    scene: Scene
    scale: float

    @classmethod
    def of(cls, scene: Scene, scale: float | None = None) -> Footage:
        """The footage of a scene, by default in images at most 640 pixels long."""
        unrepaired = replace(scene, foreground=replace(scene.foreground, repair=False))
        return cls(unrepaired, scale or min(1.0, _MAX_PIXELS / float(scene.calibrated.size.max())))

    @property
    def rig(self) -> CameraRig:
        """The cameras as they were calibrated, at the masks' size."""
        return self.scene.rig(self.scale)

    @property
    def fps(self) -> float:
        """Frames per second of the frames that are used."""
        return self.scene.rate / self._step

    @property
    def _step(self) -> int:
        return max(1, int(self.scene.rate / _RATE))

    @property
    def _camera_fps(self) -> np.ndarray:
        """(camera,) each camera's own frames per second."""
        return self.scene.fps * np.array([source.rate for source in self.scene.cameras])

    def _total(self, offset: np.ndarray) -> np.ndarray:
        """(camera,) the scene's offsets and ``offset`` together [s]."""
        stated = np.array([source.frame_offset + source.fraction for source in self.scene.cameras])
        total: np.ndarray = offset + stated / self._camera_fps
        return total

    def whole(self, offset: np.ndarray) -> np.ndarray:
        """(camera,) the number of each camera's first frame, if offsets grow by ``offset`` (camera,) [s]."""
        return np.rint(self._total(offset) * self._camera_fps).astype(int)

    def rest(self, offset: np.ndarray) -> np.ndarray:
        """(camera,) the part of these offsets that whole frames leave over [s]."""
        left: np.ndarray = self._total(offset) - self.whole(offset) / self._camera_fps
        return left

    def observations(self, offset: np.ndarray) -> list[Observation]:
        """The masks of the frames that are used; each camera gives its nearest whole frame.

        Args:
            offset: (camera,) by how much more cameras lag than the scene says [s].
        """
        shifted = tuple(
            replace(source, frame_offset=int(frames), fraction=0.0)
            for source, frames in zip(self.scene.cameras, self.whole(offset), strict=True)
        )
        scene = replace(self.scene, cameras=shifted)
        count = min(scene.frame_count, max(1, round(_MAX_SECONDS * scene.rate)))
        masks = islice(scene.masks(self.scale, count=count), 0, None, self._step)
        return [Observation.from_masks(views) for views in masks]
