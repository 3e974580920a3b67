"""What subtracting a background leaves of a silhouette: halo, ragged and flickering contours, holes, specks, shadow.

Quick enough to run whenever a frame is asked for, because only the surroundings of the body are touched, and all
chance is drawn from a generator that is seeded per camera and frame.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist
from typing import Self

import cv2
import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.synthesis.exact_posing import led_by
from mmocap_warp.synthesis.footage.faults import Ellipse, distance_inside, on_floor
from mmocap_warp.synthesis.footage.outlines import Surface, draw_outlines, on_image


@dataclass(frozen=True)
class Contrast:
    """How well one camera tells the body from what is behind it; perfectly by default. Lengths in pixels."""

    halo: float = 0.0  # mean shift of the contour, outward positive
    flicker: float = 0.0  # standard deviation of the shift from frame to frame, the same all along the contour
    ragged: float = 0.0  # standard deviation of the shift along the contour
    holes: float = 0.0  # mean number of patches of the body, at any time, that look like the background
    specks: float = 0.0  # mean number of blobs beside the body
    shadow: float = 0.0  # share of the shadow at the feet that is taken for the body, at least 0 and below 1
    dropouts: float = 0.0  # mean number of times in 1000 frames that the camera delivers nothing for a while

    def worse(self, factor: float) -> Self:
        """The same camera where the subject's clothes or the light are worse: all but the dropouts times ``factor``."""
        scaled = {name: getattr(self, name) * factor for name in ("halo", "flicker", "ragged", "holes", "specks")}
        return replace(self, **scaled, shadow=min(_MOST_SHADOW, self.shadow * factor))


_MOST_SHADOW = 0.95
_SHADOW_JOINTS = ("LKnee", "LAnkle", "RKnee", "RAnkle")  # joints of shanks and feet, whose shadow is seen
_PATCH_LIFE = 24  # frames in which a patch that looks like the background comes and goes
_PATCH_RADIUS = (0.015, 0.06)  # [m]
_DROPOUT_EVERY, _DROPOUT_FRAMES = 100, (6, 19)  # frames in which there is one dropout at most, and its length in frames
_MASK, _PATCHES, _DROPOUT = range(3)  # numbers of the sequences of random draws


@dataclass(frozen=True)
class SegmentedMasks:
    """Exact outlines before pinhole cameras, as subtracting their backgrounds would leave them."""

    body: BodyModel  # who is seen
    contrast: tuple[Contrast, ...]  # one per camera
    light: np.ndarray  # (3,), where the lamps shine to
    seed: int  # where chance comes from

    def silhouettes(self, rig: CameraRig, vertices: np.ndarray) -> list[np.ndarray]:
        """Per camera (height, width) bool: what a faultless segmentation would give."""
        return draw_outlines(rig, vertices, self._surface)

    def masks(self, rig: CameraRig, vertices: np.ndarray, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) bool; empty where the camera has dropped out."""
        shadows = draw_outlines(rig, on_floor(vertices, rig.up_vector, self.light), self._casting_surface)
        masks = []
        for k, silhouette in enumerate(self.silhouettes(rig, vertices)):
            if self.dropped_out(k, frame):
                masks.append(np.zeros_like(silhouette))
                continue
            patches = self._patches(rig, k, frame, vertices)
            rng = np.random.default_rng([self.seed, _MASK, k, frame])
            masks.append(segment(silhouette, shadows[k], patches, self.contrast[k], rng))
        return masks

    def dropped_out(self, k: int, frame: int) -> bool:
        """Whether camera ``k`` delivers nothing in a frame; in frame 0, where tracking starts, all do."""
        block = frame // _DROPOUT_EVERY
        rng = np.random.default_rng([self.seed, _DROPOUT, k, block])
        first = block * _DROPOUT_EVERY + 1 + rng.integers(_DROPOUT_EVERY - _DROPOUT_FRAMES[1])
        happens = rng.random() < self.contrast[k].dropouts * _DROPOUT_EVERY / 1000
        return bool(happens and first <= frame < first + rng.integers(*_DROPOUT_FRAMES))

    @cached_property
    def _surface(self) -> Surface:
        return Surface.of(self.body.skin.face)

    @cached_property
    def _casting_surface(self) -> Surface:
        """The part of the mesh that casts the shadow at the feet."""
        face = self.body.skin.face
        return Surface.of(face[led_by(self.body, *_SHADOW_JOINTS)[face].all(axis=1)])

    @cached_property
    def _share_of_skin(self) -> np.ndarray:
        """(face,) each face's share of the body's surface, summed up: for drawing points evenly."""
        corner = self.body.skin.rest[self.body.skin.face]
        area = np.linalg.norm(np.cross(corner[:, 2] - corner[:, 0], corner[:, -1] - corner[:, 1]), axis=1)
        return np.cumsum(area) / area.sum()

    def _patches(self, rig: CameraRig, k: int, frame: int, vertices: np.ndarray) -> list[Ellipse]:
        """Patches of the body that look like the background to camera ``k``, each for a fraction of a second."""
        block = frame // _PATCH_LIFE
        rng = np.random.default_rng([self.seed, _PATCHES, k, block])
        patches = []
        for _ in range(rng.poisson(3.0 * self.contrast[k].holes)):  # each is there for a third of its block, on average
            begin, end = np.sort(rng.integers(0, _PATCH_LIFE + 1, 2)) + block * _PATCH_LIFE
            face = int(np.searchsorted(self._share_of_skin, rng.random()))
            radii, angle = rng.uniform(*_PATCH_RADIUS, 2), rng.uniform(0, 180)
            if begin <= frame < end:
                place = vertices[self.body.skin.face[face, 0]]
                radii = radii * rig.K[k, 0, 0] / float(rig.R[k, 2] @ place + rig.t[k, 2])
                patches.append(Ellipse(on_image(rig, k, place), radii, angle))
        return patches


_GRAIN = 9  # distance over which the contour's shift changes [px]
_SPREAD = 1.4  # interpolating between independent draws divides their deviation by this
_SHADOW_GRAIN = 14  # size of the pieces in which a shadow is seen [px]
_MARGIN = 24  # distance around the body within which shadow and specks are seen [px]
_SPECK_RADIUS = (1.0, 4.0)


def segment(
    mask: np.ndarray, shadow: np.ndarray, patches: list[Ellipse], contrast: Contrast, rng: np.random.Generator
) -> np.ndarray:
    """A silhouette, (height, width) bool, as a real segmentation might have left it.

    Some of the body's shadow on the floor, likewise, is taken for it, and its ``patches`` look like the background.
    """
    spoilt = np.zeros_like(mask)
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    if not width:
        return spoilt
    # The surroundings of the body, in which all is done.
    corner = np.maximum((left - _MARGIN, top - _MARGIN), 0)
    box = np.s_[corner[1] : top + height + _MARGIN, corner[0] : left + width + _MARGIN]
    depth = distance_inside(mask[box], 3)
    steady = contrast.halo + contrast.flicker * rng.standard_normal()
    shift = steady + contrast.ragged * _noise(depth.shape, _GRAIN, rng)
    seen = (depth + shift > 0).view(np.uint8)
    if contrast.shadow > 0:
        bound = NormalDist().inv_cdf(1.0 - contrast.shadow)
        seen |= (shadow[box] & (_noise(depth.shape, _SHADOW_GRAIN, rng) > bound)).view(np.uint8)
    for patch in patches:
        patch._replace(centre=patch.centre - corner).draw(seen, 0)
    for _ in range(rng.poisson(contrast.specks)):
        place, radii = rng.uniform(0, depth.shape[::-1]), rng.uniform(*_SPECK_RADIUS, 2)
        Ellipse(place, radii, rng.uniform(0, 180)).draw(seen, 1)
    spoilt[box] = seen.view(bool)
    return spoilt


def _noise(shape: tuple[int, ...], size: int, rng: np.random.Generator) -> np.ndarray:
    """Noise of mean 0 and about variance 1 that is alike over about ``size`` pixels."""
    coarse = rng.standard_normal((shape[0] // size + 3, shape[1] // size + 3), np.float32) * np.float32(_SPREAD)
    fine = cv2.resize(coarse, None, fx=size, fy=size, interpolation=cv2.INTER_LINEAR)
    return fine[size : size + shape[0], size : size + shape[1]]
