"""Gross mistakes in a calibration or its masks, found by trial repairs: after the right one, all views agree.

Whatever casts the silhouettes lies in the visual hull of any views, so the hull of the other views explains nearly all
of each mask, whoever is seen and however large. Of a mirrored, turned or exchanged view, or of extrinsics that were
written the wrong way round, it explains much less. The repair that brings the agreement back names the mistake.
"""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.visual_hull import explained_share, mask_centroid, meeting_point_of

_PIXELS = 120  # pixels of each mask that are compared with the other views
_MIN_PIXELS = 20  # a mask with fewer foreground pixels shows nobody
_EXTENT = 1.75  # metres to which the subject is scaled, so that neither its size nor a wrong unit counts
_SURE = 0.95  # share: views that agree so well hide no mistake, and nothing is tried
_REPAIRED = 0.93  # share that the right repair brings at least; sound recordings with hidden limbs reach .88 by any
_LEFT = 0.35  # share of the disagreement that the right repair leaves at most; others leave .6 and more
_SURE_TWO_VIEWS, _REPAIRED_TWO_VIEWS = 0.7, 0.97  # the same of two views, which agree on more than there is
_ALL_TRIAL_FRAMES = 6  # cameras up to which every other frame judges a repair; one frame judges those of more
_GRAPHICS = np.diag([1.0, -1.0, -1.0])  # from the camera axes of computer graphics to OpenCV's

_SIZES = (0.5, 2 / 3, 0.75, 4 / 3, 1.5, 2.0)  # of images over those that were calibrated, of which one may be true
MIRRORED, SWAPPED, IMAGE_SIZE = "mirrored", "wrong file", "image size"
# What may have happened to images after the calibration: (2, 2) from calibrated to seen directions, x right and y down.
_TURNS = {
    MIRRORED: np.diag([-1.0, 1.0]),
    "turned by 180 degrees": np.diag([-1.0, -1.0]),
    "turned by 90 degrees clockwise": np.array([[0.0, -1.0], [1.0, 0.0]]),
    "turned by 90 degrees counterclockwise": np.array([[0.0, 1.0], [-1.0, 0.0]]),
    "mirrored top to bottom": np.diag([1.0, -1.0]),
}
_INVERTED = "inverted extrinsics"
_POSES = {  # what may be wrong with how extrinsics were written, and what to do
    _INVERTED: "rotation and translation are camera to world: give them world to camera",
    "graphics axes": "camera axes are those of computer graphics (y up, z backward): give OpenCV's (y down, z forward)",
    "inverted graphics axes": "poses are camera to world with the axes of computer graphics (y up, z backward): give"
    " them world to camera with OpenCV's axes (y down, z forward)",
    "centre for translation": "translations are the cameras' places c: give t = -R c",
}
# Of these, what two views tell from a limb that one of them does not see.
_IN_TWO_VIEWS = (*_POSES, *(cause for cause in _TURNS if cause.startswith("turned by 90 degrees")))


@dataclass(frozen=True)
class Mistake:
    """A mistake that one repair puts right."""

    cameras: tuple[str, ...] | None  # which have it; None for all. Two that are exchanged.
    cause: str  # ``MIRRORED``, ``SWAPPED``, ``IMAGE_SIZE``, or another one of this module
    size: float | None = None  # of the images over those that were calibrated, where that is the cause

    def __str__(self) -> str:
        """The mistake and what to do about it, for people."""
        if self.cause == SWAPPED:
            return "{} and {}: one has the other's masks, or its calibration".format(*self.cameras or ())
        whose = "all cameras" if self.cameras is None else self.cameras[0]
        if self.size is not None:
            return f"{whose}: pictures are {self.size:.3g} times as large as those of the calibration"
        if self.cause in _POSES:
            return f"{whose}: {_POSES[self.cause]}"
        return f"{whose}: pictures are {self.cause}, those of the calibration were not"


@dataclass(frozen=True, eq=False)
class Silhouettes:
    """What is compared of a frame's masks."""

    seeing: list[int]  # the cameras that see somebody
    # Per camera (height, width) bool, grown by a pixel, so that thin limbs and small errors do not count.
    masks: list[np.ndarray]
    centroids: np.ndarray  # (camera, 2) [px]; NaN where there is nobody, as below
    pixels: list[np.ndarray]  # per camera (n, 2), some of the foreground's
    diameters: np.ndarray  # (camera,) of the circles about the masks' largest pieces [px]

    @classmethod
    def of(cls, masks: Sequence[np.ndarray]) -> Self:
        """What is compared of the masks of a frame, per camera (height, width) bool."""
        grown = [cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) for mask in masks]
        centroids, diameters = np.full((len(masks), 2), np.nan), np.full(len(masks), np.nan)
        pixels = []
        for k, mask in enumerate(masks):
            place = np.argwhere(mask)[:, ::-1]
            pixels.append(place[:: max(1, len(place) // _PIXELS)])
            if len(place) >= _MIN_PIXELS:
                centroids[k] = mask_centroid(mask)
                # Specks far away do not make the subject larger.
                _, label, boxes, _ = cv2.connectedComponentsWithStats(grown[k])
                largest = np.argwhere(label == 1 + np.argmax(boxes[1:, cv2.CC_STAT_AREA])).astype(np.float32)
                diameters[k] = 2 * cv2.minEnclosingCircle(cv2.convexHull(largest))[1]
        seeing = np.flatnonzero(np.isfinite(diameters)).tolist()
        return cls(seeing, [mask.astype(bool) for mask in grown], centroids, pixels, diameters)


@dataclass(frozen=True, eq=False)
class Agreement:
    """How well views agree."""

    # (camera,) share of its masks that the hull of the others explains, the median over frames; NaN where it never sees
    # anybody.
    explained: np.ndarray
    extent: float  # of the subject, as the views see it [m]; NaN where they do not meet

    @property
    def share(self) -> float:
        """Of all views; 1 where there is nothing to compare."""
        known = self.explained[np.isfinite(self.explained)]
        return float(known.mean()) if len(known) else 1.0


def agreement(rig: CameraRig, frames: Sequence[Silhouettes]) -> Agreement:
    """How well views agree in some frames; the rig's cameras are undistorted, as the masks."""
    explained, extent = np.full((len(frames), len(rig)), np.nan), np.full((len(frames), len(rig)), np.nan)
    focal = np.sqrt(np.abs(np.linalg.det(rig.K[:, :2, :2])))
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # medians of nothing are NaN, as they should be
        for number, frame in enumerate(frames):
            seeing = frame.seeing
            if len(seeing) < 2:
                continue
            # Where the views meet, and how large the subject is there.
            sees = rig.select(tuple(rig.names[k] for k in seeing))
            scale = 1.0
            for _ in range(2):  # the point depends on the scale a little
                point = meeting_point_of(replace(sees, t=sees.t * scale), frame.centroids[seeing]) / scale
                depth = rig.R[:, 2] @ point + rig.t[:, 2]
                size = np.where(depth > 0, frame.diameters * depth / focal, np.nan)
                scale = _EXTENT / np.nanmedian(size) if np.isfinite(size).any() else 1.0
            extent[number] = size
            scaled = replace(rig, t=rig.t * scale)
            for k in seeing:
                others = [j for j in seeing if j != k]
                least = min(2, len(others))
                share = explained_share(scaled, frame.masks, k, others, frame.pixels[k], depth[k] * scale, least)
                explained[number, k] = share if depth[k] > 0 else 0.0
        return Agreement(np.nanmedian(explained, axis=0), float(np.nanmedian(np.nanmedian(extent, axis=1))))


def find_mistake(rig: CameraRig, frames: Sequence[Silhouettes], now: Agreement) -> Mistake | None:
    """The mistake after whose repair the views agree; None where they do as it is, or no repair helps.

    The cameras are undistorted; ``now`` is how well they agree as they are.
    """
    two = max((len(frame.seeing) for frame in frames), default=0) == 2
    if now.share > (_SURE_TWO_VIEWS if two else _SURE):
        return None
    # A few frames choose among all repairs; all frames judge the best one.
    few = frames[::2] if len(rig) <= _ALL_TRIAL_FRAMES else frames[len(frames) // 2 :][:1]
    trials = [(mistake, repaired) for mistake, repaired in repairs(rig) if not two or mistake.cause in _IN_TWO_VIEWS]
    mistake, repaired = max(trials, key=lambda trial: agreement(trial[1], few).share)
    share = agreement(repaired, frames).share
    enough = share >= (_REPAIRED_TWO_VIEWS if two else _REPAIRED)
    return mistake if enough and 1 - share <= _LEFT * (1 - now.share) else None


def repairs(rig: CameraRig) -> Iterator[tuple[Mistake, CameraRig]]:
    """Every mistake, and the cameras with which its masks would agree."""
    cameras = list(range(len(rig)))
    inverted, graphics = _inverted(rig, cameras), _with_graphics_axes(rig)
    yield Mistake(None, _INVERTED), inverted
    yield Mistake(None, "graphics axes"), graphics
    yield Mistake(None, "inverted graphics axes"), _with_graphics_axes(inverted)
    yield Mistake(None, "centre for translation"), replace(rig, t=-np.einsum("kij,kj->ki", rig.R, rig.t))
    # All cameras, then each alone.
    for some in [cameras, *([k] for k in cameras)]:
        names = None if len(some) == len(rig) else (rig.names[some[0]],)
        if names is not None:
            yield Mistake(names, _INVERTED), _inverted(rig, some)
        for cause, turn in _TURNS.items():
            yield Mistake(names, cause), _turned(rig, some, turn)
        for size in _SIZES:
            K = rig.K.copy()
            K[some, :2] *= size
            yield Mistake(names, IMAGE_SIZE, size), replace(rig, K=K)
    for pair in combinations(cameras, 2):
        order = np.array(cameras)
        order[list(pair)] = pair[::-1]
        both = rig.names[pair[0]], rig.names[pair[1]]
        yield Mistake(both, SWAPPED), replace(rig, K=rig.K[order], R=rig.R[order], t=rig.t[order])


def _inverted(rig: CameraRig, some: list[int]) -> CameraRig:
    R, t = rig.R.copy(), rig.t.copy()
    R[some], t[some] = rig.R[some].transpose(0, 2, 1), -np.einsum("kji,kj->ki", rig.R[some], rig.t[some])
    return replace(rig, R=R, t=t)


def _with_graphics_axes(rig: CameraRig) -> CameraRig:
    return replace(rig, R=_GRAPHICS @ rig.R, t=rig.t @ _GRAPHICS)


def _turned(rig: CameraRig, some: list[int], turn: np.ndarray) -> CameraRig:
    """Cameras whose images are turned about their middle; after a quarter of a turn the principal point lies there."""
    K = rig.K.copy()
    for k in some:
        middle = (rig.size[k] - 1) / 2
        quarter = turn[0, 0] == 0
        K[k, :2, 2] = middle + (0.0 if quarter else turn @ (rig.K[k, :2, 2] - middle))
        K[k, :2, :2] = turn @ rig.K[k, :2, :2]
    return replace(rig, K=K)
