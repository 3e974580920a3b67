"""Calibrated pinhole cameras in OpenCV's convention."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class CameraRig:
    """Static calibrated cameras: ``x_cam = R @ X + t``, x right, y down, z forward, pixel centres at integers.

    Attributes:
        names: one per camera.
        K: (camera, 3, 3) float64, intrinsics [px]; no skew.
        R: (camera, 3, 3) float64, rotation, world to camera.
        t: (camera, 3) float64, translation, world to camera [m].
        size: (camera, 2) int, width and height [px].
        distortion: (camera, 5) float64, OpenCV's k1 k2 p1 p2 k3; zero once images are undistorted.
        up: the world's up axis: ``+x``, ``-x``, ``+y``, ``-y``, ``+z`` or ``-z``.
    """

    names: tuple[str, ...]
    K: np.ndarray
    R: np.ndarray
    t: np.ndarray
    size: np.ndarray
    distortion: np.ndarray
    up: str = "+z"

    def __len__(self) -> int:
        return len(self.names)

    @property
    def centres(self) -> np.ndarray:
        """(camera, 3), optical centres in the world [m]."""
        return -np.einsum("kji,kj->ki", self.R, self.t)
