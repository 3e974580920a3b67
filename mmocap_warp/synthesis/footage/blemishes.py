"""What the two ways to spoil masks have in common: distances from a contour, blobs, and shadows on the floor."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

_SUBPIXEL = 4  # binary digits of OpenCV's ellipses


def distance_inside(mask: np.ndarray, reach: int) -> np.ndarray:
    """(height, width) float32, how far inside the contour each pixel's centre is [px]; outside is negative.

    Args:
        mask: (height, width) bool.
        reach: 3 or 5, width of the neighbourhood that OpenCV looks at: quicker or nearer to the truth.
    """
    seen = mask.view(np.uint8)
    inside, outside = (cv2.distanceTransform(side, cv2.DIST_L2, reach) for side in (seen, 1 - seen))
    return np.where(mask, inside - 0.5, 0.5 - outside)


class Ellipse(NamedTuple):
    """Centre (column, row) and radii (2,) [px], and the angle of the first radius [degrees]."""

    centre: np.ndarray
    radii: np.ndarray
    angle: float

    def draw(self, image: np.ndarray, value: int) -> None:
        """Fill it."""
        x, y, across, along = (round(float(length) * 2**_SUBPIXEL) for length in (*self.centre, *self.radii))
        cv2.ellipse(image, (x, y), (across, along), float(self.angle), 0, 360, value, -1, cv2.LINE_8, _SUBPIXEL)


def on_floor(vertices: np.ndarray, up: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Where the shadows of vertices (vertex, 3) lie on the floor, at height zero: moved along ``light`` (3,)."""
    return vertices - np.outer(vertices @ up / (light @ up), light)
