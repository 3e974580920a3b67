"""Filling what one mask lacks where the other views agree that the subject is thick there."""

from __future__ import annotations

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.visual_hull import meeting_point

# A gap or dent up to so wide is filled where the other views' hull is so thick along its rays [m, m]. A narrow one may
# be in a limb. A wide one, or a hole that is enclosed, can only be in the trunk: less is the phantom volume that few
# views leave between arm and trunk. Going from narrow to wide keeps a false gap apart from a true one that it meets.
_GAPS = ((0.04, 0.10), (0.08, 0.18), (0.12, 0.18))
_REACH = 1.2  # the rays are followed this far before and behind the subject [m]
_STEP = 0.025  # along the rays [m]


def repair_masks(rig: CameraRig, masks: list[np.ndarray]) -> list[np.ndarray]:
    """Fill holes, gaps and dents of each mask where the other views' visual hull is over 10 cm thick.

    A dark pair of shorts before a dark floor leaves a hole that no single image can mend; seen from elsewhere, the
    body is plainly there. True gaps, as between arm and torso, have little or no hull behind them and stay. A view
    needs two others that see the subject; with fewer, or when it is empty itself, it is returned as it is.

    Args:
        rig: undistorted pinholes, as the masks.
        masks: per camera (height, width) bool.

    Returns:
        New masks, per camera (height, width) bool; each contains its original.
    """
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    if len(seen) < 3:
        return list(masks)
    subject = meeting_point(rig.select(tuple(rig.names[k] for k in seen)), [masks[k] for k in seen])
    return [
        _repair(rig, masks, k, [j for j in seen if j != k], subject) if k in seen else mask
        for k, mask in enumerate(masks)
    ]


def _repair(rig: CameraRig, masks: list[np.ndarray], k: int, others: list[int], subject: np.ndarray) -> np.ndarray:
    mask = masks[k]
    depth = float((rig.R[k] @ subject + rig.t[k])[2])
    if depth <= 0:
        return mask
    repaired = mask
    for width, thickness in _GAPS:
        diameter = max(3, round(width * rig.K[k, 0, 0] / depth)) | 1
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (diameter, diameter))
        closed = cv2.morphologyEx(repaired.view(np.uint8), cv2.MORPH_CLOSE, kernel).view(bool)
        if width == _GAPS[-1][0]:
            closed = fill_enclosed(closed)
        row, column = np.nonzero(closed & ~repaired)
        count, label = cv2.connectedComponents((closed & ~repaired).view(np.uint8), connectivity=4)
        hole = label[row, column]
        thick = hull_thickness(rig, masks, k, others, np.stack([column, row], axis=1), depth)
        typical = [np.median(thick[hole == h]) if h else 0.0 for h in range(count)]
        repaired = repaired | (np.array(typical) > thickness)[label]
    return repaired


def fill_enclosed(mask: np.ndarray) -> np.ndarray:
    """(height, width) bool: ``mask`` with every background region filled that the image's border does not touch."""
    padded = np.pad(mask.astype(np.uint8), 1)
    cv2.floodFill(padded, None, (0, 0), 2)
    return padded[1:-1, 1:-1] != 2


def hull_thickness(
    rig: CameraRig, masks: list[np.ndarray], k: int, others: list[int], pixels: np.ndarray, depth: float
) -> np.ndarray:
    """Length of the rays through camera ``k``'s pixels that lies inside the other cameras' silhouettes [m].

    Args:
        rig: undistorted pinholes, as the masks.
        masks: per camera (height, width) bool.
        k: the camera.
        others: cameras that judge; one whose image a point misses does not judge it, but two must.
        pixels: (n, 2) column and row.
        depth: about which the rays are followed [m].

    Returns:
        (n,) float [m].
    """
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(rig.K[k]).T  # depth 1
    depths = np.arange(max(depth - _REACH, _STEP), depth + _REACH, _STEP, dtype=np.float32)
    agree = np.zeros((len(rays), len(depths)), np.int8)
    possible = np.ones(agree.shape, bool)
    for j in others:
        # A point at depth z is z * direction + origin in camera j's homogeneous pixels: linear in z.
        turn = rig.R[j] @ rig.R[k].T
        direction = (rays @ (rig.K[j] @ turn).T).astype(np.float32)
        origin = (rig.K[j] @ (rig.t[j] - turn @ rig.t[k])).astype(np.float32)
        w = direction[:, 2:] * depths + origin[2]
        column = np.rint((direction[:, :1] * depths + origin[0]) / w)
        row = np.rint((direction[:, 1:2] * depths + origin[1]) / w)
        height, width = masks[j].shape
        inside = (w > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        hit = masks[j].ravel()[np.where(inside, row * width + column, 0).astype(np.int32)] & inside
        agree += hit
        possible &= hit | ~inside
    count = (possible & (agree >= 2)).sum(axis=1)
    return count * _STEP * np.linalg.norm(rays, axis=1)
