"""Masks of all views made consistent: what the others contradict is filled or cut, frame by frame.

A view's *excess* is the part of its mask outside of the hull of the others. A part that one view lacks is excess in all
others, and lies where these excesses meet. A part that only one view has is an excess that meets no other.
"""

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.visual_hull import fill_enclosed, hull_thickness, meeting_point

_PIXELS_PER_METRE = 100.0  # at the subject, of the small masks that are compared: a finer look finds nothing more
_MIN_EXPLAINED = 0.98  # share of a mask within the others' hull; sound masks of sound cameras are above
_FULLY_EXPLAINED = 0.995  # share of the mask of a view that lacks a part
_MAX_UNTOUCHED = 0.1  # share of the frames so far. If more contradict themselves, the calibration is at fault
_MARGIN = 0.03  # metres by which masks are grown before others are compared with them
_MIN_WIDTH = 0.06  # metres: an excess is wider than this somewhere; contours of sound masks differ by less
_THICK = 0.29  # metres of hull behind an enclosed hole in the trunk. Between limbs four views leave up to 0.28
_MIN_HOLE = 0.04  # metres: such a hole is wider than this somewhere
_MIN_UNSUPPORTED = 0.3  # share of a piece that is cut: so much lies outside of the hull even if any one view is wrong
_MIN_VIEWS = 4  # number of views that see the subject: the hull of two others holds far more than the body


class Consistency:
    """Makes the masks of undistorted pinholes consistent frame by frame, and counts what it changes."""

    def __init__(self, rig: CameraRig) -> None:
        self._rig = rig
        self._small: CameraRig | None = None
        self.filled: list[list[int]] = []  # for each frame, the pixels that were filled in each view
        self.cut: list[list[int]] = []  # likewise, that were cut
        self.untouched = 0  # frames that stayed as they were because their views contradict each other throughout

    def __call__(self, masks: list[np.ndarray]) -> list[np.ndarray]:
        """A frame's masks, per camera (height, width) bool, made consistent."""
        made = self._consistent(masks)
        self.filled.append([int((new & ~old).sum()) for old, new in zip(masks, made, strict=True)])
        self.cut.append([int((old & ~new).sum()) for old, new in zip(masks, made, strict=True)])
        return made

    def add(self, other: "Consistency") -> None:
        """Count what was changed in another person's views after this one's."""
        for own, others in ((self.filled, other.filled), (self.cut, other.cut)):
            own[:] = [before + after for before, after in zip(own, others, strict=True)]
        self.untouched = max(self.untouched, other.untouched)

    def _consistent(self, masks: list[np.ndarray]) -> list[np.ndarray]:
        seen = [k for k, mask in enumerate(masks) if mask.any()]
        if len(seen) < _MIN_VIEWS:
            return masks
        if self._small is None:
            pixels_per_metre = np.median(self._rig.K[:, 0, 0] / _depths(self._rig, masks))
            self._small = self._rig.undistorted(float(min(1.0, _PIXELS_PER_METRE / max(pixels_per_metre, 1e-9))))
        levels = zip((np.where(mask, np.uint8(255), np.uint8(0)) for mask in masks), self._small.size, strict=True)
        small = [cv2.resize(each, size.tolist(), interpolation=cv2.INTER_AREA) > 127 for each, size in levels]
        if not all(small[k].any() for k in seen):
            return masks
        depth = _depths(self._small, small)
        if (depth[seen] <= 0).any():
            return masks
        views = _Views(self._small, small, seen, depth)
        # A fault of the calibration lasts, and in some poses it looks like one of the masks.
        if views.contradict or self.untouched > _MAX_UNTOUCHED * (1 + len(self.filled)):
            self.untouched += 1
            return masks
        return [_apply(*each) for each in zip(masks, small, views.mended(), strict=True)]


class _Views:
    """A frame's small masks, per camera (height, width) bool, and the excess of each.

    The cameras of ``rig`` are undistorted pinholes; those in ``seen`` see the subject, at a ``depth`` (camera,) [m].
    """

    def __init__(self, rig: CameraRig, masks: list[np.ndarray], seen: list[int], depth: np.ndarray) -> None:
        self._rig, self._masks, self._seen, self._depth = rig, masks, seen, depth
        grown = [self._grown(k, mask) for k, mask in enumerate(masks)]
        self.explained: dict[int, float] = {}
        self._bad: list[int] = []
        self._excess = [np.zeros_like(mask) for mask in masks]
        for k in seen:
            outside = masks[k] & ~self._hull(k, masks[k], grown)
            self.explained[k] = float(1 - outside.sum() / masks[k].sum())
            self._bad += [k] if self.explained[k] < _MIN_EXPLAINED else []
            disc = self._disc(k, _MIN_WIDTH)
            core = cv2.erode(outside.view(np.uint8), disc)
            self._excess[k] = outside & cv2.dilate(core, cv2.dilate(np.pad(disc, 2), disc)).view(bool)

    @property
    def contradict(self) -> bool:
        """Whether too many views contradict each other for a fault of one mask: then the calibration is at fault.

        A piece too much leaves one mask unexplained; a part that is missing leaves all but the one that lacks it, and
        that one is explained to the last.
        """
        lacking = len(self._bad) == len(self._seen) - 1 and max(self.explained.values()) > _FULLY_EXPLAINED
        return len(self._bad) > 1 and not lacking

    def mended(self) -> list[np.ndarray]:
        """The masks, filled and cut."""
        return [self._mended(k) if k in self._seen else mask for k, mask in enumerate(self._masks)]

    def _mended(self, k: int) -> np.ndarray:
        mask, others = self._masks[k], [j for j in self._seen if j != k]
        made = mask | self._enclosed_holes(k)
        # A part that only this view lacks: the others' excesses meet there, and all of its own mask is explained.
        if self.explained[k] > _FULLY_EXPLAINED and all(self._excess[j].any() for j in others):
            made = made | self._hull(k, ~mask, self._excess)
        # A part that only this view has: no other's excess meets it, and no two others see it.
        count, label = cv2.connectedComponents(self._excess[k].view(np.uint8), connectivity=8)
        if count > 1 and len(self._bad) == 1:
            excess = [self._grown(j, each) for j, each in enumerate(self._excess)]
            met = self._hull(k, self._excess[k], excess, least=1, tolerate=len(others))
            supported = self._hull(k, self._excess[k], self._masks, tolerate=1)
            for piece in range(1, count):
                alone = label == piece
                if not met[alone].any() and supported[alone].mean() < 1 - _MIN_UNSUPPORTED:
                    made = made & ~alone
        return made

    def _enclosed_holes(self, k: int) -> np.ndarray:
        """The holes of a mask that can only be in the trunk: the others' hull is so thick there."""
        mask, holes = self._masks[k], fill_enclosed(self._masks[k]) & ~self._masks[k]
        count, label = cv2.connectedComponents(holes.view(np.uint8), connectivity=4)
        filled = np.zeros_like(mask)
        for hole in range(1, count):
            inside = label == hole
            wide = cv2.erode(inside.view(np.uint8), self._disc(k, _MIN_HOLE)).any()
            if wide and np.median(self._thickness(k, inside, self._masks)) > _THICK:
                filled |= inside
        return filled

    def _hull(self, k: int, where: np.ndarray, masks: list[np.ndarray], **votes: int) -> np.ndarray:
        """(height, width) bool: the pixels of ``where`` behind which the other views' masks meet."""
        behind = np.zeros_like(where)
        behind[where] = self._thickness(k, where, masks, **votes) > 0
        return behind

    def _thickness(self, k: int, where: np.ndarray, masks: list[np.ndarray], **votes: int) -> np.ndarray:
        """As :func:`hull_thickness`, with its ``least`` and ``tolerate`` as ``votes``."""
        others, pixels = [j for j in self._seen if j != k], np.argwhere(where)[:, ::-1]
        return hull_thickness(self._rig, masks, k, others, pixels, float(self._depth[k]), **votes)

    def _grown(self, k: int, mask: np.ndarray) -> np.ndarray:
        return cv2.dilate(mask.view(np.uint8), self._disc(k, 2 * _MARGIN)).view(bool)

    def _disc(self, k: int, diameter: float) -> np.ndarray:
        pixels = max(1, round(diameter * float(self._rig.K[k, 0, 0] / self._depth[k]))) | 1
        return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (pixels, pixels))


def _depths(rig: CameraRig, masks: list[np.ndarray]) -> np.ndarray:
    """(camera,) depth of the subject in each camera [m]."""
    return np.asarray((rig.R @ meeting_point(rig, masks) + rig.t)[:, 2])


def _apply(mask: np.ndarray, small: np.ndarray, mended: np.ndarray) -> np.ndarray:
    """What was filled and cut in a small mask, done to the large one."""
    if (mended == small).all():
        return mask
    height, width = mask.shape

    def enlarged(view: np.ndarray) -> np.ndarray:
        return cv2.resize(view.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)

    # Between what is filled and the mask lies a seam of less than a small pixel, and around what is cut another one.
    seam = np.ones((2 * int(np.ceil(width / small.shape[1])) + 1,) * 2, np.uint8)
    filled = cv2.dilate(enlarged(mended & ~small), seam) & enlarged(mended)
    cut = cv2.dilate(enlarged(small & ~mended), seam) & ~enlarged(mended)
    return np.asarray((mask | filled.view(bool)) & ~cut.view(bool))
