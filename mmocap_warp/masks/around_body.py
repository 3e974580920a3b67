"""Masks from colour and a body's place: where no background can be subtracted, but the body has been tracked.

GrabCut (Rother, Kolmogorov and Blake 2004) learns the colours of what is surely the subject and surely not, and draws
the contour between them where the image has an edge.
"""

from __future__ import annotations

import cv2
import numpy as np

_INNER, _OUTER = 0.03, 0.03  # [m]: deeper in the body is surely subject, further from it surely not
_ROUNDS = 3
_MARGIN = 2.0  # of the outer distance: colours of the background are learnt this far around the body


def mask_around_body(image: np.ndarray, body: np.ndarray, pixels_per_metre: float) -> np.ndarray:
    """What of an image is the subject whose body is seen at ``body``.

    Args:
        image: (height, width, 3) BGR uint8.
        body: (height, width) bool, the tracked body's silhouette.
        pixels_per_metre: at the body.

    Returns:
        (height, width) bool; ``body`` itself where it is too small to learn colours from.
    """
    rows, columns = (np.flatnonzero(body.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return body.copy()
    inside = cv2.distanceTransform(body.astype(np.uint8), cv2.DIST_L2, 5)
    outside = cv2.distanceTransform(1 - body.astype(np.uint8), cv2.DIST_L2, 5)
    known = np.where(body, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    known[inside > min(_INNER * pixels_per_metre, 0.5 * float(inside.max()))] = cv2.GC_FGD
    known[outside > _OUTER * pixels_per_metre] = cv2.GC_BGD
    reach = int(np.ceil((1 + _MARGIN) * _OUTER * pixels_per_metre))
    window = np.s_[
        max(int(rows[0]) - reach, 0) : int(rows[-1]) + reach + 1,
        max(int(columns[0]) - reach, 0) : int(columns[-1]) + reach + 1,
    ]
    part = np.ascontiguousarray(known[window])
    if not (part == cv2.GC_BGD).any():
        return body.copy()
    cv2.setRNGSeed(0)  # it starts from random clusters of colours
    models = np.zeros((2, 1, 65))
    whole = (0, 0, *part.shape[::-1])
    cv2.grabCut(np.ascontiguousarray(image[window]), part, whole, models[0], models[1], _ROUNDS, cv2.GC_INIT_WITH_MASK)
    found = np.zeros_like(body)
    found[window] = (part == cv2.GC_FGD) | (part == cv2.GC_PR_FGD)
    return found
