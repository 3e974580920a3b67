"""What subtracting a background leaves of a silhouette: halo, ragged and flickering contours, holes, specks, shadow.

Quick enough to run whenever a frame is asked for, because only the surroundings of the body are touched, and all
chance is drawn from a generator that the caller seeds per camera and frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist

import cv2
import numpy as np


@dataclass(frozen=True)
class Contrast:
    """How well one camera tells the body from what is behind it; perfectly by default. Lengths in pixels.

    Attributes:
        halo: mean shift of the contour, outward positive.
        flicker: standard deviation of the shift from frame to frame, the same all along the contour.
        ragged: standard deviation of the shift along the contour.
        holes: mean number of patches of the body, at any time, that look like the background.
        specks: mean number of blobs beside the body.
        shadow: share of the shadow at the feet that is taken for the body, at least 0 and below 1.
        dropouts: mean number of times in 1000 frames that the camera delivers nothing for a while.
    """

    halo: float = 0.0
    flicker: float = 0.0
    ragged: float = 0.0
    holes: float = 0.0
    specks: float = 0.0
    shadow: float = 0.0
    dropouts: float = 0.0

    def worse(self, factor: float) -> Contrast:
        """The same camera where the subject's clothes or the light are worse: all but the dropouts times ``factor``."""
        scaled = {name: getattr(self, name) * factor for name in ("halo", "flicker", "ragged", "holes", "specks")}
        return replace(self, **scaled, shadow=min(_MOST_SHADOW, self.shadow * factor))


@dataclass(frozen=True)
class Patch:
    """An elliptic piece of the body that looks like the background.

    Attributes:
        centre: column and row [px].
        radii: of the ellipse [px].
        angle: of its first axis [degrees].
    """

    centre: tuple[float, float]
    radii: tuple[float, float]
    angle: float


_MOST_SHADOW = 0.95
_GRAIN = 9  # distance over which the contour's shift changes [px]
_SPREAD = 1.4  # interpolating between independent draws takes this from their deviation
_SHADOW_GRAIN = 14  # size of the pieces in which a shadow is seen [px]
_MARGIN = 24  # around the body, in which shadow and specks are seen [px]
_SPECK_RADIUS = (1.0, 4.0)
_SUBPIXEL = 4  # binary digits of OpenCV's ellipses


def segment(
    mask: np.ndarray, shadow: np.ndarray, patches: list[Patch], contrast: Contrast, rng: np.random.Generator
) -> np.ndarray:
    """A silhouette as a real segmentation might have left it: (height, width) bool.

    Args:
        mask: (height, width) bool, the silhouette.
        shadow: (height, width) bool, of the body on the floor.
        patches: of the body that look like the background.
        contrast: how bad it is.
        rng: where chance comes from.
    """
    spoilt = np.zeros_like(mask)
    box = _surroundings(mask)
    if box is None:
        return spoilt
    body = mask[box].view(np.uint8)
    inside = cv2.distanceTransform(body, cv2.DIST_L2, cv2.DIST_MASK_3)
    outside = cv2.distanceTransform(1 - body, cv2.DIST_L2, cv2.DIST_MASK_3)
    signed = np.where(mask[box], inside - 0.5, 0.5 - outside)
    shift = contrast.halo + contrast.flicker * rng.standard_normal() + contrast.ragged * _grain(body.shape, _GRAIN, rng)
    seen = (signed + shift > 0).view(np.uint8)
    if contrast.shadow > 0:
        bound = NormalDist().inv_cdf(1.0 - contrast.shadow)
        seen |= (shadow[box] & (_grain(body.shape, _SHADOW_GRAIN, rng) > bound)).view(np.uint8)
    corner = np.array([box[1].start, box[0].start])
    for patch in patches:
        _ellipse(seen, np.array(patch.centre) - corner, patch.radii, patch.angle, 0)
    for _ in range(rng.poisson(contrast.specks)):
        place, radii = rng.uniform(0, body.shape[::-1]), rng.uniform(*_SPECK_RADIUS, 2)
        _ellipse(seen, place, (radii[0], radii[1]), rng.uniform(0, 180), 1)
    spoilt[box] = seen.view(bool)
    return spoilt


def _surroundings(mask: np.ndarray) -> tuple[slice, slice] | None:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    low = [max(0, int(axis[0]) - _MARGIN) for axis in (rows, columns)]
    return slice(low[0], int(rows[-1]) + _MARGIN + 1), slice(low[1], int(columns[-1]) + _MARGIN + 1)


def _grain(shape: tuple[int, ...], size: int, rng: np.random.Generator) -> np.ndarray:
    """Noise of mean 0 and about variance 1 that is alike over about ``size`` pixels."""
    coarse = rng.standard_normal((shape[0] // size + 3, shape[1] // size + 3), np.float32) * np.float32(_SPREAD)
    fine = cv2.resize(coarse, None, fx=size, fy=size, interpolation=cv2.INTER_LINEAR)
    return fine[size : size + shape[0], size : size + shape[1]]


def _ellipse(image: np.ndarray, centre: np.ndarray, radii: tuple[float, float], angle: float, value: int) -> None:
    x, y = (round(float(c) * 2**_SUBPIXEL) for c in centre)
    axes = (round(radii[0] * 2**_SUBPIXEL), round(radii[1] * 2**_SUBPIXEL))
    cv2.ellipse(image, (x, y), axes, float(angle), 0, 360, value, -1, cv2.LINE_8, _SUBPIXEL)
