"""Silhouettes as a real camera would see them, lens and all, drawn by OpenCV: nothing is shared with the tracker."""

from __future__ import annotations

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig, project

_FINER = 16  # subpixels per pixel and axis; OpenCV fills all that an outline touches, up to a subpixel too much
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
    flat = polygons.reshape(-1, 2)
    left, top = np.clip(np.floor(flat.min(axis=0)) - 1, 0, (width, height)).astype(int)
    right, bottom = np.clip(np.ceil(flat.max(axis=0)) + 2, 0, (width, height)).astype(int)
    mask = np.zeros((height, width), bool)
    if left < right and top < bottom:
        fine = (polygons - (left, top) + 0.5) * _FINER - 0.5
        canvas = np.zeros(((bottom - top) * _FINER, (right - left) * _FINER), np.uint8)
        for corners in np.rint(fine * 2**_SHIFT).astype(np.int32):
            cv2.fillConvexPoly(canvas, corners, 255, cv2.LINE_8, _SHIFT)
        mask[top:bottom, left:right] = (
            cv2.resize(canvas, (right - left, bottom - top), interpolation=cv2.INTER_AREA) > 127
        )
    return mask
