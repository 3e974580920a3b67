"""The frames of a recording that calibrate it, with cameras and times that may yet change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.observation import Observation
from mmocap_warp.scene.recording import Scene

_RATE = 30.0  # frames a second that are enough to follow a person
_LONGEST = 20.0  # [s] of a recording
_LARGEST = 640  # px, the longer side of images that are enough for outlines


@dataclass(frozen=True)
class Footage:
    """A recording's masks, read as often as its cameras' times change.

    Masks are as they were given: repairing them would need the calibration that is in doubt.

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
        return cls(unrepaired, scale or min(1.0, _LARGEST / float(scene.calibrated.size.max())))

    @property
    def rig(self) -> CameraRig:
        """The cameras as they were calibrated, at the masks' size."""
        return self.scene.rig(self.scale)

    @property
    def fps(self) -> float:
        """Of the frames that are followed."""
        return self.scene.rate / self._step

    @property
    def _step(self) -> int:
        return max(1, int(self.scene.rate / _RATE))

    def whole(self, offset: np.ndarray) -> np.ndarray:
        """(camera,) which of its frames each camera has for the recording's first, with offsets (camera,) [s] more."""
        return np.rint(self._total(offset) * self._own_fps).astype(int)

    def rest(self, offset: np.ndarray) -> np.ndarray:
        """(camera,) what is left of all offsets beside whole frames [s]."""
        left: np.ndarray = self._total(offset) - self.whole(offset) / self._own_fps
        return left

    def _total(self, offset: np.ndarray) -> np.ndarray:
        said = np.array([source.frame_offset + source.fraction for source in self.scene.cameras])
        total: np.ndarray = offset + said / self._own_fps
        return total

    @property
    def _own_fps(self) -> np.ndarray:
        """(camera,) frames a second."""
        return self.scene.fps * np.array([source.rate for source in self.scene.cameras])

    def observations(self, offset: np.ndarray) -> list[Observation]:
        """The masks of the frames that are followed, each camera's of the whole frame that is nearest.

        Args:
            offset: (camera,) by how much more cameras lag than the scene says [s].
        """
        shifted = tuple(
            replace(source, frame_offset=int(frames), fraction=0.0)
            for source, frames in zip(self.scene.cameras, self.whole(offset), strict=True)
        )
        scene = replace(self.scene, cameras=shifted)
        count = min(scene.frame_count, max(1, round(_LONGEST * scene.rate)))
        masks = islice(scene.masks(self.scale, count=count), 0, None, self._step)
        return [Observation.from_masks(views) for views in masks]
