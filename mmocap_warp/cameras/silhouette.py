"""Silhouettes of posed meshes in whole pictures, filled on the CPU: for drawing and for masks, not for the search."""

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig, project

_SUBPIXEL_BITS = 4


def silhouettes(rig: CameraRig, vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Where a mesh of triangles (face, 3) and vertices (vertex, 3) [m] is seen: per camera (height, width) bool."""
    sizes = [(int(width), int(height)) for width, height in rig.size]
    return [silhouette(pixels, faces, size) > 0 for pixels, size in zip(project(rig, vertices), sizes, strict=True)]


def intersection_over_union(one: np.ndarray, other: np.ndarray) -> float:
    """Of two silhouettes of one size (bool); at least one is not empty."""
    return float((one & other).sum() / (one | other).sum())


def silhouette(pixels: np.ndarray, faces: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The filled outline of a projected mesh, (height, width) uint8 of 0 and 255, of a ``size`` of width and height.

    Faces (face, 3) with a vertex that is not finite are left out of the projected vertices (vertex, 2) [px].
    """
    image = np.zeros((size[1], size[0]), np.uint8)
    reach = 8.0 * max(size)  # keeps fixed-point coordinates of what lies far outside from overflowing
    drawable = (np.isfinite(pixels) & (np.abs(pixels) < reach)).all(axis=1)
    fixed = np.where(drawable[:, None], pixels, 0.0) * (1 << _SUBPIXEL_BITS)
    for triangle in np.rint(fixed).astype(np.int32)[faces[drawable[faces].all(axis=1)]]:
        cv2.fillConvexPoly(image, triangle, 255, cv2.LINE_8, _SUBPIXEL_BITS)
    return image
