"""Fisheye lenses in OpenCV's model of four coefficients (Kannala and Brandt), and the pinholes that stand for them.

A ray at ``angle`` from the optical axis meets the image plane at ``angle (1 + k1 angle^2 + k2 angle^4 + k3 angle^6 +
k4 angle^8)`` from its centre, where a pinhole has ``tan(angle)``.
"""

import numpy as np

FIELD = np.radians(60.0)
"""From the optical axis: what lies further out is left out of the pinhole, whose image would grow without end."""

_TABLE = np.linspace(0.0, FIELD, 6001)


def image_radius(angle: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """Distance from the image's centre, at focal length 1, of rays at an angle from the axis [rad]."""
    k1, k2, k3, k4 = distortion[:4]
    square = angle * angle
    return angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))


def distort_fisheye(points: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """Where the lens puts a point of the ideal image plane, both at focal length 1; points are (..., 2)."""
    radius = np.linalg.norm(points, axis=-1)
    safe = np.where(radius > 0, radius, 1.0)
    return points * np.where(radius > 0, image_radius(np.arctan(safe), distortion) / safe, 1.0)[..., None]


def pinhole_of(K: np.ndarray, size: np.ndarray, distortion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Intrinsics and (width, height) [px] of the pinhole that a fisheye's images are undistorted to.

    It keeps the focal lengths, so that the middle of the image keeps its resolution, and is as large as it must be to
    hold all that the lens saw within ``FIELD`` of its axis: who was in the recorded picture stays in it.
    """
    focal, centre = K[[0, 1], [0, 1]], K[:2, 2]
    width, height = size
    across, down = np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5
    border = np.concatenate(
        [np.stack(np.broadcast_arrays(across, row), -1) for row in (-0.5, height - 0.5)]
        + [np.stack(np.broadcast_arrays(column, down), -1) for column in (-0.5, width - 0.5)]
    )
    seen = (border - centre) / focal
    radius = np.maximum(np.linalg.norm(seen, axis=-1), 1e-12)
    # Beyond the image the polynomial may fold, which no lens does.
    angle = np.interp(radius, np.maximum.accumulate(image_radius(_TABLE, distortion)), _TABLE)
    edge = seen * (np.tan(angle) / radius)[:, None] * focal + centre
    first = np.floor(np.round(edge.min(0) + 0.5, 6)).astype(int)
    last = np.ceil(np.round(edge.max(0) - 0.5, 6)).astype(int)
    pinhole = K.copy()
    pinhole[:2, 2] -= first
    return pinhole, last - first + 1


def folds_over(K: np.ndarray, size: np.ndarray, distortion: np.ndarray) -> bool:
    """Whether two rays within ``FIELD`` of the axis meet one pixel of the image, which no lens does."""
    corners = np.array([[x, y] for x in (-0.5, size[0] - 0.5) for y in (-0.5, size[1] - 0.5)])
    reach = np.linalg.norm((corners - K[:2, 2]) / K[[0, 1], [0, 1]], axis=-1).max()
    with np.errstate(over="ignore", invalid="ignore"):
        radius = image_radius(_TABLE, distortion)
        falling = ~(np.diff(radius) > 0)
    return bool(falling.any() and radius[falling.argmax()] < reach)
