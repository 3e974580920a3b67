"""How well silhouettes agree with each other, without a body.

Whatever casts the silhouettes lies within the visual hull of any views. So the hull of the other views, seen by a
camera, covers its silhouette; how much of it is covered says how well the camera agrees with them, as in C. Hernandez,
F. Schmitt and R. Cipolla, *Silhouette coherence for camera calibration under circular motion* (2007).

This judges cameras, by masks of one moment. The share is of the silhouette's pixels; where the hull reaches beyond the
silhouette nothing is lost, since the hull of a few views is larger than the body anyway. Times are judged by another
measure, that of ``hull_agreement``, which counts what the hull has too much as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.masks.visual_hull import meeting_point, seen_at

_SPACING = 0.03  # [m]
_REACH = 1.0  # from the point where the silhouettes meet, along each axis [m]


def coherence(rig: CameraRig, observations: Sequence[Observation]) -> np.ndarray:
    """(camera,) share of each silhouette that the hull of the other views covers, the mean over frames.

    Frames in which less than three views see anybody say nothing; NaN where none says anything.

    Args:
        rig: undistorted cameras at the masks' size.
        observations: masks.
    """
    shares = [_covered(rig, observation) for observation in observations]
    known = [share for share in shares if share is not None]
    if not known:
        return np.full(len(rig), np.nan)
    stacked = np.stack(known)
    count = np.isfinite(stacked).sum(axis=0)
    mean: np.ndarray = np.where(count > 0, np.nansum(stacked, axis=0) / np.maximum(count, 1), np.nan)
    return mean


def _covered(rig: CameraRig, observation: Observation) -> np.ndarray | None:
    seeing = np.flatnonzero(observation.foreground > 0).tolist()
    if len(seeing) < 3:
        return None
    masks = unpack_masks(observation.words, rig.size)
    rig_seeing = rig.select(tuple(rig.names[k] for k in seeing))
    centre = meeting_point(rig_seeing, [masks[k] for k in seeing])
    axis = np.arange(-_REACH, _REACH + _SPACING, _SPACING)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3) + centre
    places, missing = [], np.zeros(len(points), int)
    culprit = np.full(len(points), -1)
    for k in seeing:
        place, inside = seen_at(rig, k, points, masks[k])
        missing += ~inside
        culprit[~inside] = k
        alive = missing <= 1
        points, missing, culprit = points[alive], missing[alive], culprit[alive]
        places = [each[alive] for each in places] + [place[alive]]
    share = np.full(len(rig), np.nan)
    for number, k in enumerate(seeing):
        hull = (culprit == k) | (missing == 0)
        share[k] = _share(rig, k, centre, places[number][hull], masks[k])
    return share


def _share(rig: CameraRig, k: int, centre: np.ndarray, place: np.ndarray, mask: np.ndarray) -> float:
    """Of a mask, what voxels at these pixels cover."""
    import cv2

    height, width = mask.shape
    within = (place >= 0).all(axis=1) & (place[:, 0] < width) & (place[:, 1] < height)
    drawn = np.zeros(mask.shape, np.uint8)
    drawn[place[within, 1], place[within, 0]] = 1
    depth = max(float((rig.R[k] @ centre + rig.t[k])[2]), 0.1)
    radius = max(1, int(np.ceil(0.5 * np.sqrt(2) * _SPACING * rig.K[k, 0, 0] / depth)))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    covered = cv2.dilate(drawn, kernel).astype(bool)
    return float((covered & mask).sum() / mask.sum())
