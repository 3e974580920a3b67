"""Resampling a camera's images once, from the video's pixels to an undistorted pinhole at the wanted scale."""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from mmocap_warp.cameras.fisheye import FIELD
from mmocap_warp.cameras.rig import CameraRig, through_lens, to_pixels

_OUTSIDE = -1e4  # a pixel's coordinate, far outside any image
_ROWS = 16  # of an image, whose map is computed at once


@dataclass(frozen=True)
class Undistortion:
    """Where each pixel of the pinhole image is found in the recorded image.

    A pixel is the mean of ``oversampling`` x ``oversampling`` bilinear samples on an even grid over its area: a box
    filter as wide as the pixel, so nothing is skipped when shrinking.
    """

    oversampling: int  # samples per pixel and axis
    position: np.ndarray  # OpenCV's fixed-point map of the samples
    fraction: np.ndarray  # its fractional part

    def _keeps(self, image: np.ndarray) -> bool:
        """Whether resampling leaves an image as it is."""
        return self._keeps_pixels and image.shape[:2] == self.fraction.shape and self.oversampling == 1

    @cached_property
    def _keeps_pixels(self) -> bool:
        """Whether the samples are the pixels of an image of the map's size, as of a lens without distortion."""
        column, row = np.moveaxis(self.position, -1, 0)
        return not self.fraction.any() and np.array_equal((row, column), np.indices(row.shape))

    def image(self, image: np.ndarray) -> np.ndarray:
        """Resample a gray or BGR image; what lies outside the recorded image is black."""
        return image.copy() if self._keeps(image) else self._part(image, slice(None), slice(None))

    def _part(self, image: np.ndarray, rows: slice, columns: slice) -> np.ndarray:
        """The pixels of some samples, which are whole pixels'."""
        position, fraction = self.position[rows, columns], self.fraction[rows, columns]
        samples = cv2.remap(image, position, fraction, cv2.INTER_LINEAR, borderValue=0)
        if self.oversampling == 1:
            return samples
        size = (samples.shape[1] // self.oversampling, samples.shape[0] // self.oversampling)
        return cv2.resize(samples, size, interpolation=cv2.INTER_AREA)

    def mask(self, mask: np.ndarray) -> np.ndarray:
        """Resample a boolean mask: a pixel is foreground if more than half of it is."""
        if self._keeps(mask):
            return mask
        n, box = self.oversampling, cv2.boundingRect(mask.view(np.uint8))
        resampled = np.zeros([length // n for length in self.fraction.shape], bool)
        # Foreground is where samples lie in the box around what was foreground, or beside it.
        near = []
        for (lowest, highest), first, length in zip(self._extent, box[1::-1], box[:1:-1], strict=True):
            inside = np.flatnonzero((highest >= first - 1) & (lowest < first + length)) // n
            near.append(slice(int(inside[0]), int(inside[-1]) + 1) if len(inside) else slice(0, 0))
        if resampled[tuple(near)].size and box[2]:
            samples = (slice(n * part.start, n * part.stop) for part in near)
            resampled[tuple(near)] = self._part(mask.view(np.uint8) * np.uint8(255), *samples) > 127
        return resampled

    @cached_property
    def _extent(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The lowest and the highest recorded row of each row of samples, and the same of columns."""
        column, row = np.moveaxis(self.position, -1, 0)
        return [(row.min(axis=1), row.max(axis=1)), (column.min(axis=0), column.max(axis=0))]


def undistortion(
    rig: CameraRig, k: int, scale: float, recorded_scale: float = 1.0, recorded_offset: tuple[float, float] = (0.0, 0.0)
) -> Undistortion:
    """Map from camera ``k``'s recorded images to its pinhole in ``rig.undistorted(scale)``; the rig is as calibrated.

    Of videos that were scaled, letterboxed or cropped after calibration, recorded pixel = ``recorded_scale`` *
    calibrated pixel + ``recorded_offset``.
    """
    n = max(1, math.ceil(recorded_scale / scale - 1e-9))
    width, height = rig.undistorted(scale).size[k]
    pinhole, _ = rig.pinhole(k)

    def to_plane(count: int, axis: int) -> np.ndarray:
        pixel = (np.arange(count * n) + 0.5) / (n * scale) - 0.5
        return (pixel - pinhole[axis, 2]) / pinhole[axis, axis]

    def to_recorded(plane: np.ndarray) -> np.ndarray:
        return to_pixels(rig, k, through_lens(rig, k, plane)) * recorded_scale + recorded_offset

    across, down = to_plane(width, 0), to_plane(height, 1)
    recorded, is_fisheye = np.empty((len(down), len(across), 2), np.float32), rig.names[k] in rig.fisheye
    if not (is_fisheye or rig.distortion[k].any() or rig.K[k, 0, 1]):
        # Without distortion a column depends on x alone, and a row on y alone.
        recorded[..., 0] = to_recorded(np.stack([across, np.zeros_like(across)], axis=-1))[:, 0]
        recorded[..., 1] = to_recorded(np.stack([np.zeros_like(down), down], axis=-1))[:, 1, None]
    else:
        # Some rows at a time stay in the processor's cache, which takes a third of the time.
        for first in range(0, len(down), _ROWS):
            rows = slice(first, first + _ROWS)
            plane = np.stack(np.meshgrid(across, down[rows]), axis=-1)
            recorded[rows] = to_recorded(plane)
            if is_fisheye:
                recorded[rows][~(np.linalg.norm(plane, axis=-1) <= np.tan(FIELD))] = _OUTSIDE
    column, row = np.moveaxis(recorded, -1, 0)
    position, fraction = cv2.convertMaps(column, row, cv2.CV_16SC2)
    return Undistortion(n, np.asarray(position), np.asarray(fraction))
