"""Masks with faults: ragged contours, holes, specks, and shadows at the feet, in each mask by itself.

Silhouettes are what a real camera would see, lens and all. OpenCV draws them: they share nothing with the tracker.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig, project


@dataclass(frozen=True)
class Faults:
    """How bad one camera's masks are, by default perfect; lengths in pixels but for the shadow's."""

    grow: float = 0.0  # mean shift of the contour, outward positive
    ragged: float = 0.0  # standard deviation of that shift along the contour
    smooth: float = 10.0  # distance over which the shift changes
    holes: float = 0.0  # mean number of holes in the body
    specks: float = 0.0  # mean number of blobs beside the body
    salt: float = 0.0  # share of all pixels that are flipped
    shadow: float = 0.0  # the shadow on the floor of what is lower than this [m] is taken for the body; 0 for none


@dataclass(frozen=True)
class SpoiltMasks:
    """Polygons seen through the lens, then spoilt."""

    face: np.ndarray  # (face, corner) of the mesh that is seen
    faults: tuple[Faults, ...]  # one per camera
    light: np.ndarray  # (3,), where the lamps shine to
    seed: int  # where chance comes from

    def silhouettes(self, rig: CameraRig, vertices: np.ndarray) -> list[np.ndarray]:
        """Per camera (height, width) bool: what a faultless segmentation of the distorted image would give."""
        return draw_silhouettes(rig, vertices, self.face)

    def masks(self, rig: CameraRig, vertices: np.ndarray, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) bool; the same for the same seed, camera and frame."""
        masks = []
        for k, silhouette in enumerate(self.silhouettes(rig, vertices)):
            faults, rng = self.faults[k], np.random.default_rng([self.seed, k, frame])
            shadow = np.zeros_like(silhouette)
            if faults.shadow > 0:
                low = self.face[((vertices @ rig.up_vector)[self.face] < faults.shadow).all(axis=1)]
                floor = on_floor(vertices, rig.up_vector, self.light)
                shadow = draw_silhouettes(rig.select((rig.names[k],)), floor, low)[0]
            masks.append(spoil(silhouette, shadow, faults, rng))
        return masks


_HOLE_RADIUS = (2.0, 5.0)
_SPECK_RADIUS = (1.5, 5.0)
_FIELD_MARGIN = 3.0  # margin of a field in smoothing lengths, so that its edges are like its middle


def spoil(mask: np.ndarray, shadow: np.ndarray, faults: Faults, rng: np.random.Generator) -> np.ndarray:
    """A perfect mask (height, width) as a real segmentation might have left it, which takes the shadow for the body."""
    depth = distance_inside(mask, 5)
    shift = faults.grow + faults.ragged * _smooth_field(mask.shape, faults.smooth, rng)
    spoilt = ((depth + shift > 0) | shadow).astype(np.uint8)
    _blobs(spoilt, np.argwhere(depth > _HOLE_RADIUS[1] - 0.5), rng.poisson(faults.holes), _HOLE_RADIUS, 0, rng)
    _blobs(spoilt, np.argwhere(~mask), rng.poisson(faults.specks), _SPECK_RADIUS, 1, rng)
    return spoilt.astype(bool) ^ (rng.random(mask.shape) < faults.salt)


def _smooth_field(shape: tuple[int, ...], length: float, rng: np.random.Generator) -> np.ndarray:
    """Noise of mean 0 and variance 1 that is alike over about ``length`` pixels."""
    margin = round(_FIELD_MARGIN * length)
    white = rng.standard_normal((shape[0] + 2 * margin, shape[1] + 2 * margin))
    field = cv2.GaussianBlur(white, (0, 0), length)[margin:-margin, margin:-margin]
    return field * (2.0 * np.sqrt(np.pi) * length)  # a Gaussian of that width divides the deviation by this


def _blobs(
    mask: np.ndarray, places: np.ndarray, count: int, radius: tuple[float, float], value: int, rng: np.random.Generator
) -> None:
    """Draw ellipses of any direction with centres at random ``places`` (n, 2: row, column)."""
    for _ in range(count if len(places) else 0):
        centre, radii = places[rng.integers(len(places))][::-1], np.rint(rng.uniform(*radius, 2))
        Ellipse(centre, radii, rng.uniform(0, 180)).draw(mask, value)


_FINER = 16  # subpixels per pixel and axis; OpenCV fills all that an outline touches, up to a subpixel too much
_SHIFT = 6  # binary digits after the point of OpenCV's polygon corners


def draw_silhouettes(rig: CameraRig, vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Per camera (height, width) bool, lens and all: pixels of which the mesh covers more than half.

    Its vertices (vertex, 3) [m] are in the world, all in front of every camera; its faces (face, corner) are convex.
    Raises a ValueError for a vertex behind a camera.
    """
    image = project(rig, vertices)
    if not np.isfinite(image).all():
        raise ValueError("a vertex lies behind a camera")
    return [_draw(corners[faces], *rig.size[k]) for k, corners in enumerate(image)]


def _draw(polygons: np.ndarray, width: int, height: int) -> np.ndarray:
    """Fill all polygons (face, corner, 2) [px] on a finer grid, and see how much of each pixel they cover."""
    flat = polygons.reshape(-1, 2)
    left, top = np.clip(np.floor(flat.min(axis=0)) - 1, 0, (width, height)).astype(int)
    right, bottom = np.clip(np.ceil(flat.max(axis=0)) + 2, 0, (width, height)).astype(int)
    mask = np.zeros((height, width), bool)
    if left < right and top < bottom:
        fine = (polygons - (left, top) + 0.5) * _FINER - 0.5
        canvas = np.zeros(((bottom - top) * _FINER, (right - left) * _FINER), np.uint8)
        for corners in np.rint(fine * 2**_SHIFT).astype(np.int32):
            cv2.fillConvexPoly(canvas, corners, 255, cv2.LINE_8, _SHIFT)
        covered = cv2.resize(canvas, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
        mask[top:bottom, left:right] = covered > 127
    return mask


_SUBPIXEL = 4  # binary digits of OpenCV's ellipses


def distance_inside(mask: np.ndarray, reach: int) -> np.ndarray:
    """(height, width) float32, how far inside the contour of a mask each pixel's centre is [px]; outside is negative.

    OpenCV looks at a neighbourhood as wide as ``reach``, 3 or 5: quicker or nearer to the truth.
    """
    seen = mask.view(np.uint8)
    inside, outside = (cv2.distanceTransform(side, cv2.DIST_L2, reach) for side in (seen, 1 - seen))
    return np.where(mask, inside - 0.5, 0.5 - outside)


class Ellipse(NamedTuple):
    """Centre (column, row) and radii (2,) [px], and the angle of the first radius [degrees]."""

    centre: np.ndarray
    radii: np.ndarray
    angle: float

    def draw(self, image: np.ndarray, value: int) -> None:
        """Fill the ellipse with a value."""
        x, y, across, along = (round(float(length) * 2**_SUBPIXEL) for length in (*self.centre, *self.radii))
        cv2.ellipse(image, (x, y), (across, along), float(self.angle), 0, 360, value, -1, cv2.LINE_8, _SUBPIXEL)


def on_floor(vertices: np.ndarray, up: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Where the shadows of vertices (vertex, 3) lie on the floor, at height zero: moved along ``light`` (3,)."""
    return vertices - np.outer(vertices @ up / (light @ up), light)
