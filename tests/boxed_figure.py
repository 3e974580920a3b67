"""A figure of three boxes, drawn into the images of cameras around it."""

from __future__ import annotations

import cv2
import numpy as np
from synthetic import ring_rig

from mmocap_warp.cameras.rig import CameraRig, project

LEG = np.array([[0.04, 0.0, -0.08], [0.2, 0.85, 0.08]])
FIGURE = (LEG, LEG * (-1, 1, 1), np.array([[-0.2, 0.8, -0.12], [0.2, 1.75, 0.12]]))
VOLUME = sum(np.abs(np.diff(box, axis=0)).prod() for box in FIGURE)


def seen(rig: CameraRig, boxes: tuple[np.ndarray, ...], along: float = 0.0) -> list[np.ndarray]:
    """Per camera (height, width) bool: boxes, moved along x."""
    masks = [np.zeros((height, width), np.uint8) for width, height in rig.size]
    for box in boxes:
        corners = np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3) + np.array([along, 0, 0])
        for mask, pixels in zip(masks, project(rig, corners), strict=True):
            cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(pixels).astype(np.int32)), 1)
    return [mask.astype(bool) for mask in masks]


def rig_of(cameras: int) -> CameraRig:
    return ring_rig(cameras, distance=4.0).undistorted(0.5)
