"""Holes that open in masks from one frame to the next: what lies there is unknown, and may hide the subject.

A segmenter that loses a trunk for a moment takes more away at once than any motion does. The hole is followed for as
long as the body that is tracked is missing there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from mmocap_warp.masks.cleanup import around
from mmocap_warp.masks.observation import Observation, pack_masks, unpack_masks
from mmocap_warp.scene.recording import ViewMasks

HOLE_SECONDS = 1.0
"""A hole is followed for so long at most [s]."""
_RADIUS = 0.045  # of a disc that fits into a hole, as a share of the mask's extent: limbs are thinner
_FASTEST = 1.15  # extents a second that such a disc may move, so that it vanishes from where it was
_SMALLER = 0.5  # of what vanished, by how much the mask is smaller: what moved is elsewhere
_MARGIN = 4.0  # of such discs' radius, by which a hole may be larger: an arm beside the trunk is in it, too
_CLOSED = 0.25  # of what vanished, less than which the body misses where a hole has closed

BodyBefore = Callable[[int], ViewMasks]
"""From a position, the silhouettes (height, width) bool of the body as it was tracked in the frame before."""


@dataclass(frozen=True, eq=False)
class _Hole:
    view: int
    opened: int  # the frame's position
    vanished: int  # what it took from the mask [px]
    core: tuple[int, int, int, int]  # rows from and to, columns from and to, of where middles of discs vanished
    margin: int  # by which it may go on beyond them [px]
    shown: np.ndarray  # (height, width) bool, where the mask has been since: no hole is there

    def followed(self, seen: Observation, silhouettes: ViewMasks) -> _Hole | None:
        """The hole in the next frame, where the tracked body has some silhouettes; None where it has closed."""
        mask = _unpacked(seen.words[self.view])
        shown, silhouette = self.shown | mask, silhouettes[self.view]
        height, width = silhouette.shape
        missing = silhouette & ~mask[:height, :width] & self.covered[:height, :width]
        return replace(self, shown=shown) if np.count_nonzero(missing) >= _CLOSED * self.vanished else None

    @property
    def covered(self) -> np.ndarray:
        """(height, width) bool, what it may cover: its core, and beside that as far as no mask was shown."""
        top, bottom, left, right = self.core
        shown = self.shown
        height, width = shown.shape
        for _ in range(self.margin):
            top -= top > 0 and not shown[top - 1, left:right].any()
            bottom += bottom < height and not shown[bottom, left:right].any()
            left -= left > 0 and not shown[top:bottom, left - 1].any()
            right += right < width and not shown[top:bottom, right].any()
        covered = np.zeros_like(self.shown)
        covered[top:bottom, left:right] = True
        return covered


def with_holes(observations: Iterable[Observation], rate: float, body: BodyBefore) -> Iterator[Observation]:
    """Consecutive frames' masks; what holes in them may cover is ``hidden``.

    What is hidden in a frame depends on the :data:`HOLE_SECONDS` before it alone. ``rate`` is in frames a second.
    """
    before: Observation | None = None
    holes: list[_Hole] = []
    for place, seen in enumerate(observations):
        holes = [hole for hole in holes if place - hole.opened < HOLE_SECONDS * rate]
        if holes:
            silhouettes = body(place)
            holes = [now for hole in holes if (now := hole.followed(seen, silhouettes))]
        if before is not None:
            holes += _opened(before, seen, place, rate, body)
        before = seen
        yield _hiding(seen, holes) if holes else seen


def _opened(before: Observation, seen: Observation, place: int, rate: float, body: BodyBefore) -> list[_Hole]:
    """The holes in the tracked body that were not there in the frame before. What else vanishes was not the subject."""
    holes = []
    smaller = before.foreground - seen.foreground
    for k in np.flatnonzero((before.foreground > 0) & (seen.foreground > 0) & (smaller > 0)).tolist():
        rows, words = (np.flatnonzero(before.words[k].any(axis=axis)) for axis in (1, 0))
        radius = max(_RADIUS, _FASTEST / rate) * max(np.ptp(rows), 32 * np.ptp(words))
        if smaller[k] < np.pi * radius**2:  # nearly always: what follows is for few frames
            continue
        gone = before.words[k] & ~seen.words[k]
        vanished = int(np.bitwise_count(gone).sum())
        if smaller[k] < _SMALLER * vanished:
            continue
        # Around what is gone nothing is: the box around it and a pixel more has all distances.
        pixels = _unpacked(gone).view(np.uint8)
        deep, box = np.zeros(pixels.shape, bool), around(pixels, 1)
        deep[box] = cv2.distanceTransform(pixels[box], cv2.DIST_L2, 5) > radius
        if deep.any():
            silhouette = body(place)[k]
            deep = deep[: len(silhouette), : silhouette.shape[1]] & silhouette
        if deep.any():
            x, y, width, height = cv2.boundingRect(deep.view(np.uint8))
            core, margin = (y, y + height, x, x + width), round((1 + _MARGIN) * radius)
            holes.append(_Hole(k, place, vanished, core, margin, _unpacked(seen.words[k])))
    return holes


def _hiding(seen: Observation, holes: list[_Hole]) -> Observation:
    hidden = np.zeros_like(seen.words) if seen.hidden is None else seen.hidden.copy()
    holed = np.zeros(len(hidden), bool)
    for hole in holes:
        hidden[hole.view] |= pack_masks([hole.covered])[0]
        holed[hole.view] = True
    return replace(seen, hidden=hidden & ~seen.words, holed=holed)


def _unpacked(words: np.ndarray) -> np.ndarray:
    """(height, width) bool: all pixels of a view's words (row, word)."""
    rows, columns = words.shape
    return unpack_masks(words[None], np.array([[32 * columns, rows]]))[0]
