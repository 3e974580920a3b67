"""A person in each view as an upright stick and an outline: the top of the head, the foot below it, the convex hull."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from mmocap_warp.masks.observation import Observation, unpack_masks

CORNERS = 96
"""Points that a convex hull is given by; one with fewer repeats its last."""

_MIN_PIXELS = 200  # pixels of a silhouette that shows how a person stands
_SPECK_SHARE = 0.02  # pieces below this share of a silhouette's pixels are no part of the person
_MARGIN_SHARE = 0.01  # share of an image's longer side: silhouettes so near the border may be cut off
_HEAD_SHARE = 0.06  # share of the person's length at the top that belongs to the head
_END_SHARE = 0.12  # share of the person's length at either end, whose width tells head from feet
_LYING_SINE = 0.5  # sine of the person's angle to the image's rows; below it the camera lies on its side
_MIN_SLENDERNESS = 1.6  # standard deviation of a standing person's pixels along over that across, at least


@dataclass(frozen=True, eq=False)
class PersonInViews:
    """What cameras see of the person; NaN in frames where a camera does not see the whole person."""

    head: np.ndarray  # (camera, frame, 2) float64, the top of the head [px]
    foot: np.ndarray  # (camera, frame, 2) float64, where the body's axis ends at the height of the lower foot [px]
    hull: np.ndarray  # (camera, frame, CORNERS, 2) float64, corners of the silhouette's convex hull in order [px]

    @property
    def whole(self) -> np.ndarray:
        """(camera, frame) bool: the whole person is seen."""
        return np.isfinite(self.head[..., 0])

    def without(self, frames: np.ndarray) -> Self:
        """The same, not seen in these frames (numbers or a mask)."""
        left = [values.copy() for values in (self.head, self.foot, self.hull)]
        for values in left:
            values[:, frames] = np.nan
        return type(self)(*left)


def person_in_views(observations: Sequence[Observation], sizes: np.ndarray) -> PersonInViews:
    """The person in every view, from the masks of each frame; ``sizes`` (camera, 2) are those of the images [px]."""
    frames = [[_whole_silhouette(mask) for mask in unpack_masks(each.words, sizes)] for each in observations]
    head, foot, hull = (np.full((len(sizes), len(frames), *shape), np.nan) for shape in ((2,), (2,), (CORNERS, 2)))
    for k in range(len(sizes)):
        # A standing person's silhouette is longer than wide; its principal axis is the person's, up to the sign.
        standing, axes = {}, []
        for frame, pixels in enumerate(silhouettes[k] for silhouettes in frames):
            if pixels is not None:
                (across, along), directions = np.linalg.eigh(np.cov(pixels.T))
                if along > _MIN_SLENDERNESS**2 * across:
                    standing[frame] = pixels
                    axes.append(directions[:, 1])
        if standing:
            up = _up_direction(np.array(axes), list(standing.values()))
            for frame, pixels in standing.items():
                head[k, frame], foot[k, frame] = _axis(pixels, up)
                hull[k, frame] = _hull(pixels)
    return PersonInViews(head, foot, hull)


def _whole_silhouette(mask: np.ndarray) -> np.ndarray | None:
    """(n, 2), the pixels of a silhouette; None of one that is missing or may be cut off by the image's border."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= _SPECK_SHARE * int(mask.sum())
    large[0] = False  # the background
    y, x = np.nonzero(large[labels])
    if len(x) < _MIN_PIXELS:
        return None
    height, width = mask.shape
    margin = _MARGIN_SHARE * max(height, width)
    inside = x.min() >= margin and y.min() >= margin and x.max() < width - margin and y.max() < height - margin
    return np.stack([x, y], axis=1).astype(float) if inside else None


def _up_direction(axes: np.ndarray, silhouettes: list[np.ndarray]) -> np.ndarray:
    """(2,), the direction from feet to head in the image, for a person with axes (n, 2) of either sign.

    It points up in the image unless the camera lies on its side. There it points where silhouettes are narrower,
    because feet step apart and heads do not.
    """
    lying = np.median(np.abs(axes[:, 1])) < _LYING_SINE
    towards = -axes[:, 0] if lying else axes[:, 1]
    up = np.median(axes * np.where(towards > 0, -1, 1)[:, None], axis=0)
    up /= np.linalg.norm(up)
    if lying and np.mean([_end_width(pixels, up) < _end_width(pixels, -up) for pixels in silhouettes]) < 0.5:
        up = -up
    return up


def _end_width(pixels: np.ndarray, way: np.ndarray) -> float:
    """Standard deviation across a way, of a silhouette's pixels at the end that lies there [px]."""
    along, across = pixels @ way, pixels @ [-way[1], way[0]]
    return float(across[along > along.max() - _END_SHARE * np.ptp(along)].std())


def _axis(pixels: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The top of the head, and the foot of the line from there through the silhouette's centroid [px]."""
    across = np.array([-up[1], up[0]])
    height, side = pixels @ up, pixels @ across
    top, bottom = height.max() + 0.5, height.min() - 0.5  # a pixel reaches half its size beyond its centre
    length = top - bottom
    head_side = side[height > top - _HEAD_SHARE * length].mean()
    slope = (head_side - side.mean()) / (top - 0.5 * _HEAD_SHARE * length - height.mean())
    foot_side = head_side + slope * (bottom - top)
    return up * top + across * head_side, up * bottom + across * foot_side


def _hull(pixels: np.ndarray) -> np.ndarray:
    """(CORNERS, 2), the convex hull's corners, moved outward by half a pixel as the axis' ends are."""
    corners = cv2.convexHull(pixels.astype(np.int32))[:, 0].astype(float)
    outward = corners - pixels.mean(axis=0)
    corners += 0.5 * outward / np.linalg.norm(outward, axis=1, keepdims=True)
    if len(corners) > CORNERS:
        return corners[np.linspace(0, len(corners) - 1, CORNERS).round().astype(int)]
    return np.concatenate([corners, np.repeat(corners[-1:], CORNERS - len(corners), axis=0)])
