"""Silhouettes as a real camera would see them, lens and all, drawn by OpenCV: nothing is shared with the tracker."""

from __future__ import annotations

import cv2
import numpy as np

from mmocap_warp.cameras import CameraRig, project

_FINER = 4  # subpixels per pixel and axis
_SHIFT = 6  # binary digits after the point of OpenCV's polygon corners


def draw_silhouettes(rig: CameraRig, vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Per camera (height, width) bool: pixels of which the mesh covers more than half.

    Args:
        rig: the cameras, with their distortion.
        vertices: (vertex, 3), posed, in the world [m]; all in front of every camera.
        faces: (face, 3) or (face, 4), convex.

    Raises:
        ValueError: a vertex behind a camera.
    """
    image = project(rig, vertices)
    if not np.isfinite(image).all():
        raise ValueError("a vertex lies behind a camera")
    return [_draw(corners[faces], *rig.size[k]) for k, corners in enumerate(image)]


def _draw(polygons: np.ndarray, width: int, height: int) -> np.ndarray:
    """Fill all polygons (face, corner, 2) [px] on a finer grid, and see how much of each pixel they cover."""
    fine = (polygons + 0.5) * _FINER - 0.5
    canvas = np.zeros((height * _FINER, width * _FINER), np.uint8)
    for corners in np.rint(fine * 2**_SHIFT).astype(np.int32):
        cv2.fillConvexPoly(canvas, corners, 255, cv2.LINE_8, _SHIFT)
    return cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA) > 127
