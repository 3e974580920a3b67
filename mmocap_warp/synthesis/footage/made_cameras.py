"""Cameras placed around a point of the floor, as people put them on tripods."""

from __future__ import annotations

import numpy as np

from mmocap_warp.body.rotations import turn


def placed_camera(
    bearing: float,
    distance: float,
    height: float,
    aim: float,
    roll: float,
    focal: float,
    offset: tuple[float, float],
    size: tuple[int, int],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K, R and t of a camera that looks at the vertical through the origin of a world with +Z up.

    Args:
        bearing: direction from the origin, from +X toward +Y [degrees].
        distance: of the centre from the vertical [m].
        height: of the centre [m].
        aim: height of the point looked at [m].
        roll: about the direction of view [degrees].
        focal: length [px].
        offset: of the principal point from the image's middle [px].
        size: width and height of the image [px].
    """
    angle = np.radians(bearing)
    centre = np.array([distance * np.cos(angle), distance * np.sin(angle), height])
    forward = np.array([0.0, 0.0, aim]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = turn("z", np.radians(-roll)) @ np.stack([right, np.cross(forward, right), forward])
    (x, y), (width, height_px) = offset, size
    K = np.array([[focal, 0.0, (width - 1) / 2 + x], [0.0, focal, (height_px - 1) / 2 + y], [0.0, 0.0, 1.0]])
    return K, R, -R @ centre
