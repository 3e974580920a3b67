"""Cleaning a mask: specks, thin gaps, small holes, and components that are not the subject."""

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from mmocap_warp.masks.mask_settings import ForegroundSettings

_RIVAL_AREA_RATIO = 0.6  # of two components' areas: two people at different distances are still alike


def clean_mask(
    mask: np.ndarray, settings: ForegroundSettings, scale: float = 1.0, body: np.ndarray | None = None
) -> np.ndarray:
    """A mask (height, width) bool after the settings' steps in their order: those of :func:`mend_mask`, then keep.

    Lengths and areas count pixels of the calibrated image, relative to which the mask has a ``scale``. ``body``,
    likewise bool, is where the body was last: for ``keep = "nearest"``, without it the largest.
    """
    return keep_mended(mend_mask(mask, settings, scale), settings, scale, None if body is None else lambda: body)


def mend_mask(mask: np.ndarray, settings: ForegroundSettings, scale: float) -> np.ndarray:
    """The steps of :func:`clean_mask` that know no body: median, open, close, fill holes, drop small components."""
    m: Any = mask.view(np.uint8).copy()
    # Each step works on no more of the image than it can change, where there may be foreground.
    if settings.median:
        part, side = around(m, 1), _odd(settings.median * scale)
        depth = cv2.CV_8U if side * side < 256 else cv2.CV_32F
        sums = cv2.boxFilter(m[part], depth, (side, side), normalize=False, borderType=cv2.BORDER_REPLICATE)
        m[part] = cv2.threshold(sums, side * side // 2, 1, cv2.THRESH_BINARY)[1]
    for size, opens in ((settings.open, 1), (settings.close, 0)):
        if size:
            part, side = around(m, _odd(size * scale)), _odd(size * scale)
            m[part] ^= opens
            m[part] = closed(m[part], side)
            m[part] ^= opens
    if settings.fill_holes or settings.min_area:
        area, shorter_side = settings.fill_holes * scale**2, max(1, min(cv2.boundingRect(m)[2:]))
        # What is left of the background beside the foreground is no hole, because that strip is too large for one.
        inside = m[around(m, 1 + math.ceil(area / shorter_side) if area else 0)]
        if area:
            inside |= small_components(1 - inside, area, connectivity=4)
        if settings.min_area:
            inside ^= small_components(inside, settings.min_area * scale**2, connectivity=8)
    return m.view(bool)


def keep_mended(
    mask: np.ndarray, settings: ForegroundSettings, scale: float, body: Callable[[], np.ndarray] | None
) -> np.ndarray:
    """The components to keep of what :func:`mend_mask` made; ``body`` says where the body was last if it is asked."""
    if settings.keep == "all":
        return mask
    return keep_subject(mask, settings.join * scale, body if settings.keep == "nearest" else None)


def small_components(pixels: np.ndarray, area: float, connectivity: int) -> np.ndarray | int:
    """(height, width) uint8 0/1: of ``pixels`` (likewise) the components of less than ``area`` pixels; 0 for none."""
    count, label = cv2.connectedComponents(pixels, connectivity=connectivity)
    if count == 2:
        return pixels if cv2.countNonZero(pixels) < area else 0
    # Areas alone are counted four times as quickly here as with OpenCV's other statistics.
    small = np.bincount(label.ravel(), minlength=count) < area
    small[0] = False
    return small.view(np.uint8).take(np.asarray(label)) if small.any() else 0


def keep_subject(mask: np.ndarray, join: float, last: Callable[[], np.ndarray] | None) -> np.ndarray:
    """The components of a mask that overlap where a body was last, or the nearest to it; without a body, the largest.

    An empty body counts as none. Pieces up to ``join`` pixels apart count as one component.
    """
    if (pieces := _components(mask, join)) is None:
        return mask
    label, areas = pieces
    body = last() if last else None
    if body is None or not body.any():
        return label == int(areas.argmax())
    overlap = np.bincount(label[body], minlength=len(areas))
    overlap[0] = 0
    if overlap.any():
        return (overlap > 0)[label]
    distance = cv2.distanceTransform((~body).astype(np.uint8), cv2.DIST_L2, 5)
    return label == min(range(1, len(areas)), key=lambda i: float(distance[label == i].min()))


def rivals(mask: np.ndarray, join: float) -> tuple[int, int] | None:
    """Areas of a mask's two largest components, where they are about equal: two people; else None.

    ``join`` is as in :func:`keep_subject`.
    """
    if (pieces := _components(mask, join)) is None:
        return None
    smaller, larger = np.sort(pieces[1])[-2:].tolist()
    return (larger, smaller) if smaller > _RIVAL_AREA_RATIO * larger else None


def _components(mask: np.ndarray, join: float) -> tuple[np.ndarray, np.ndarray] | None:
    """The component of each pixel, 0 for the background, and their areas [px]; None where there is at most one.

    A mask that is in one piece is not joined any further: its components are those of the mask itself.
    """
    part = around(mask.view(np.uint8), _odd(join))
    pixels = mask.view(np.uint8)[part]
    count, there = cv2.connectedComponents(pixels, connectivity=8)
    if count > 2 and join >= 1:
        count, there = cv2.connectedComponents(cv2.dilate(pixels, _disc(join)), connectivity=8)
        there *= pixels
    if count <= 2:
        return None
    areas, label = np.bincount(there.ravel(), minlength=count), np.zeros(mask.shape, np.int32)
    areas[0] = 0
    label[part] = there
    return label, areas


def around(mask: np.ndarray, margin: int) -> tuple[slice, slice]:
    """Rows and columns of what lies up to ``margin`` pixels around the foreground of a mask (height, width) uint8.

    They begin at even numbers, so that components are found in the order in which they are in the whole image.
    """
    left, top, width, height = cv2.boundingRect(mask)
    rows, columns = (
        slice(max(0, first - margin) & ~1, max(1, first + length + margin))
        for first, length in ((top, height), (left, width))
    )
    return rows, columns


def _odd(length: float) -> int:
    """The odd number of pixels next to ``length``, at least 3."""
    return max(3, 2 * round((length - 1) / 2) + 1)


def dilated(mask: np.ndarray, diameter: int) -> np.ndarray:
    """A mask (height, width) uint8 0/1 dilated by a disc of an odd number of pixels; the image's border grows nothing.

    OpenCV looks at all pixels of the disc. Here each of its rows goes on from a shorter one.
    """
    disc, radius, (height, width) = _disc(diameter), diameter // 2, mask.shape
    padded = np.pad(mask, radius)
    runs, result, reach = padded.copy(), np.zeros_like(mask), 0
    reaches = disc.sum(axis=1) // 2
    for row in np.argsort(reaches, kind="stable").tolist():
        while reach < reaches[row]:
            reach += 1
            runs[:, reach:] |= padded[:, :-reach]
            runs[:, :-reach] |= padded[:, reach:]
        result |= runs[row : row + height, radius : radius + width]
    return result


def closed(mask: np.ndarray, diameter: int) -> np.ndarray:
    """A mask as :func:`dilated` takes it, dilated and then eroded: gaps narrower than the disc are filled."""
    return 1 - dilated(1 - dilated(mask, diameter), diameter)


def _disc(diameter: float) -> np.ndarray:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_odd(diameter), _odd(diameter)))
