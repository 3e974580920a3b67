"""The visual hull: what of space all silhouettes agree on (Laurentini 1994), as voxels."""

from __future__ import annotations

import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.observation import Observation, unpack_masks

_COARSE = 0.10  # first grid [m]; bodies are found on it, then carved finely
_BEYOND = 1e6  # px, beyond any image
_REACH = 2.0  # half the first grid's edge [m]


def visual_hull(rig: CameraRig, observation: Observation, spacing: float = 0.03, tolerate: int = 0) -> np.ndarray:
    """Centres of the voxels that project onto foreground.

    Views without foreground are left out; at least two must be left. Outside of an image counts as background.
    The grid is aligned with the world's axes and surrounds the subject by itself: a coarse grid about the point where
    the silhouettes' central rays meet finds what to carve finely.

    Args:
        rig: undistorted pinholes, as the masks.
        observation: masks of a frame.
        spacing: voxel edge [m].
        tolerate: number of views that may see background at a voxel: 1 survives one bad camera or mask, and a subject
            that one camera sees in part. Fewer than two views never make a hull.

    Returns:
        (n, 3) float64 [m], possibly empty.

    Raises:
        ValueError: spacing is not positive or tolerate is negative.
    """
    if not spacing > 0 or tolerate < 0:
        raise ValueError(f"spacing must be positive and tolerate not negative, got {spacing} and {tolerate}")
    masks = unpack_masks(observation.words, rig.size)
    judging = [k for k, count in enumerate(observation.foreground) if count > 0]
    tolerate = min(tolerate, len(judging) - 2)
    if tolerate < 0:
        return np.empty((0, 3))
    rig = rig.select(tuple(rig.names[k] for k in judging))
    masks = [masks[k] for k in judging]
    centre = meeting_point(rig, masks)
    found = _carve(rig, _near(rig, masks, centre), _grid(centre - _REACH, centre + _REACH, _COARSE), tolerate)
    if not len(found):
        return found
    low, high = found.min(axis=0) - _COARSE, found.max(axis=0) + _COARSE
    return _carve(rig, masks, _grid(low, high, spacing), tolerate)


def meeting_point(rig: CameraRig, masks: list[np.ndarray]) -> np.ndarray:
    """(3,), the point nearest to all rays through the masks' centroids [m], least squares with one reweighting.

    The reweighting (Cauchy, 0.3 m) keeps one camera with a wrong mask from pulling the point away.
    """
    centres, rays = rig.centres, np.empty((len(rig), 3))
    for k, mask in enumerate(masks):
        row, column = (axis.mean() for axis in np.nonzero(mask))
        ray = rig.R[k].T @ np.linalg.solve(rig.K[k], [column, row, 1.0])
        rays[k] = ray / np.linalg.norm(ray)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # projects onto the plane across the ray
    weight = np.ones(len(rig))
    point = np.zeros(3)
    for _ in range(10):
        A = (weight[:, None, None] * across).sum(axis=0) + 1e-9 * np.eye(3)  # parallel rays have no meeting point
        point = np.linalg.solve(A, np.einsum("k,kij,kj->i", weight, across, centres))
        distance = np.linalg.norm(np.einsum("kij,kj->ki", across, point - centres), axis=1)
        weight = 1 / (1 + (distance / 0.3) ** 2)
    return point


def _near(rig: CameraRig, masks: list[np.ndarray], centre: np.ndarray) -> list[np.ndarray]:
    """Masks grown by the reach of a coarse voxel (half its diagonal), so that none that touches the subject is lost."""
    import cv2

    grown = []
    for k, mask in enumerate(masks):
        depth = max(float((rig.R[k] @ centre + rig.t[k])[2]), _COARSE)
        radius = int(np.ceil(np.sqrt(3) / 2 * _COARSE * rig.K[k, 0, 0] / depth))
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        grown.append(cv2.dilate(mask.view(np.uint8), kernel).view(bool))
    return grown


def _grid(low: np.ndarray, high: np.ndarray, spacing: float) -> np.ndarray:
    """(n, 3), centres of voxels from ``low`` to ``high``, on multiples of ``spacing`` so that frames share a grid."""
    axes = [
        np.arange(np.floor(a / spacing), np.ceil(b / spacing) + 1) * spacing for a, b in zip(low, high, strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _carve(rig: CameraRig, masks: list[np.ndarray], points: np.ndarray, tolerate: int) -> np.ndarray:
    misses = np.zeros(len(points), np.int16)
    for k, mask in enumerate(masks):
        _, inside = seen_at(rig, k, points, mask)
        misses += ~inside
        alive = misses <= tolerate
        points, misses = points[alive], misses[alive]
    return points


def seen_at(rig: CameraRig, k: int, points: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) of points (n, 3), column and row, and which of them are foreground of a camera's mask."""
    seen = points @ (rig.K[k] @ rig.R[k]).T + rig.K[k] @ rig.t[k]
    depth = np.where(seen[:, 2] > 0, seen[:, 2], np.inf)
    place = np.rint(np.clip(seen[:, :2] / depth[:, None], -_BEYOND, _BEYOND)).astype(np.int32)
    height, width = mask.shape
    inside = (place >= 0).all(axis=1) & (place[:, 0] < width) & (place[:, 1] < height) & (seen[:, 2] > 0)
    inside[inside] = mask[place[inside, 1], place[inside, 0]]
    return place, inside
