"""Masks of which each is spoilt on its own: ragged contours, holes, specks, and shadows at the feet."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.synthesis.footage.blemishes import Ellipse, distance_inside, on_floor
from mmocap_warp.synthesis.footage.polygons import draw_silhouettes


@dataclass(frozen=True)
class Faults:
    """How bad one camera's masks are, by default perfect; lengths in pixels but for the shadow's.

    Attributes:
        grow: mean shift of the contour, outward positive.
        ragged: standard deviation of that shift along the contour.
        smooth: distance over which the shift changes.
        holes: mean number of holes in the body.
        specks: mean number of blobs beside the body.
        salt: share of all pixels that are flipped.
        shadow: the shadow on the floor of what is lower than this [m] is taken for the body; 0 for none.
    """

    grow: float = 0.0
    ragged: float = 0.0
    smooth: float = 10.0
    holes: float = 0.0
    specks: float = 0.0
    salt: float = 0.0
    shadow: float = 0.0


@dataclass(frozen=True)
class SpoiltMasks:
    """Polygons seen through the lens, then spoilt.

    Attributes:
        face: (face, corner) of the mesh that is seen.
        faults: one per camera.
        light: (3,), where the lamps shine to.
        seed: where chance comes from.
    """

    face: np.ndarray
    faults: tuple[Faults, ...]
    light: np.ndarray
    seed: int

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
_FIELD_MARGIN = 3.0  # smoothing lengths that a field is made larger by, so that its edges are like its middle


def spoil(mask: np.ndarray, shadow: np.ndarray, faults: Faults, rng: np.random.Generator) -> np.ndarray:
    """A mask as a real segmentation might have left it.

    Args:
        mask: (height, width) bool, perfect.
        shadow: (height, width) bool, taken for foreground.
        faults: how bad it is.
        rng: where chance comes from.
    """
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
