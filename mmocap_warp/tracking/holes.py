"""Holes that open in masks from one frame to the next: what lies there is unknown, and may hide the subject.

A segmenter that loses a trunk for a moment takes more away at once than any motion does. The hole is followed for as
long as the body that is tracked is missing there. One that takes 27 % of the mask, such as the legs, goes with the
body where two other views show where that is.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np

from mmocap_warp.masks.cleanup import around
from mmocap_warp.masks.observation import Observation, pack_masks, unpack_masks
from mmocap_warp.scene.recording import ViewMasks

HOLE_SECONDS = 10.0  # a hole is followed for so long at most [s]
LEAST_WHOLE = 2  # so many views without a hole show where a limb is
_STILL_SECONDS = 1.0  # a hole that stays where it opened is followed for so long at most
_RADIUS = 0.045  # of a disc that fits into a hole, as a share of the mask's extent: limbs are thinner
_FASTEST = 1.15  # extents a second that such a disc may move, so that it vanishes from where it was
_LIMB_RADIUS = 0.012  # of a disc that fits into limbs, in the same measure
_LARGE, _FASTEST_LARGE = 0.27, 4.0  # share of a mask that no motion takes away from a frame to the next, or in a second
_SMALLER = 0.5  # share of what vanished by which the mask must shrink: what only moved is elsewhere in it
_MARGIN = 4.0  # radii of such a disc by which a hole may be larger; an arm beside the trunk is in it, too
_CLOSED = 0.25  # share of what vanished: if the body misses less, the hole has closed
_GONE = 0.75  # share of the body: if more of it is missing, it is not where the mask is

BodyBefore = Callable[[int], ViewMasks]
"""From a position, the silhouettes (height, width) bool of the body as it was tracked in the frame before."""


@dataclass(frozen=True, eq=False)
class _Hole:
    """A hole, which stays where it opened, or goes where the body goes."""

    view: int
    opened: int  # the frame's position
    core: tuple[int, int, int, int]  # rows from and to, columns from and to, of where middles of discs vanished
    margin: int  # by which it may go on beyond them [px]
    shown: np.ndarray  # (height, width) bool, where the mask has been since: no hole is there
    vanished: int  # what it took from the mask [px]; of one that goes with the body, middles of discs
    radius: float  # of these discs [px]; 0 of one that stays

    def followed(self, seen: Observation, silhouettes: ViewMasks) -> Self | None:
        """The hole in the next frame, where the tracked body has some silhouettes; None where it has closed."""
        mask, silhouette = _unpacked(seen.words[self.view]), silhouettes[self.view]
        height, width = silhouette.shape
        missing = silhouette & ~mask[:height, :width]
        if not self.radius:
            is_open = np.count_nonzero(missing & self.covered[:height, :width]) >= _CLOSED * self.vanished
            return replace(self, shown=self.shown | mask) if is_open else None
        if mask.any() and np.count_nonzero(missing) > _GONE * np.count_nonzero(silhouette):
            return None
        middles = _middles(missing, self.radius)
        is_open = np.count_nonzero(middles) >= _CLOSED * self.vanished
        return replace(self, core=_box(middles), shown=mask) if is_open else None

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
        longest = (HOLE_SECONDS if hole.radius else _STILL_SECONDS for hole in holes)
        holes = [hole for hole, seconds in zip(holes, longest, strict=True) if place - hole.opened < seconds * rate]
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
    large = smaller > max(_LARGE, _FASTEST_LARGE / rate) * before.foreground
    is_seen = np.count_nonzero((seen.foreground > 0) & ~large) >= LEAST_WHOLE
    for k in np.flatnonzero((before.foreground > 0) & (seen.foreground > 0) & (smaller > 0)).tolist():
        left, _, width, height = cv2.boundingRect(before.words[k].view(np.uint8))
        extent = max(height - 1, 32 * ((left + width - 1) // 4 - left // 4))  # a word has four bytes
        trunk, may_move = max(_RADIUS, _FASTEST / rate) * extent, large[k] and is_seen
        if smaller[k] < np.pi * trunk**2 and not may_move:  # nearly always: what follows is for few frames
            continue
        gone = _unpacked(before.words[k] & ~seen.words[k])
        middles = _middles(gone, trunk)
        # The body, which takes longest to draw, is asked for last.
        if smaller[k] < _SMALLER * np.count_nonzero(gone) or not (may_move or middles.any()):
            continue
        silhouette, shown = body(place)[k], _unpacked(seen.words[k])
        within = slice(len(silhouette)), slice(silhouette.shape[1])
        moves = may_move and np.count_nonzero(silhouette & ~shown[within]) <= _GONE * np.count_nonzero(silhouette)
        radius = _LIMB_RADIUS * extent if moves else trunk
        deep = (_middles(gone, radius) if moves else middles)[within] & silhouette
        if deep.any():
            of_discs = (int(deep.sum()), radius) if moves else (int(gone.sum()), 0.0)
            holes.append(_Hole(k, place, _box(deep), round((1 + _MARGIN) * radius), shown, *of_discs))
    return holes


def _middles(pixels: np.ndarray, radius: float) -> np.ndarray:
    """(height, width) bool: middles of discs of a radius [px] that fit into pixels (height, width) bool."""
    # Around the pixels nothing is: the box around them and a pixel more has all distances.
    middles, box = np.zeros_like(pixels), around(pixels.view(np.uint8), 1)
    middles[box] = cv2.distanceTransform(pixels.view(np.uint8)[box], cv2.DIST_L2, 5) > radius
    return middles


def _box(pixels: np.ndarray) -> tuple[int, int, int, int]:
    """Rows from and to, and columns from and to, of pixels (height, width) bool."""
    x, y, width, height = cv2.boundingRect(pixels.view(np.uint8))
    return y, y + height, x, x + width


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
