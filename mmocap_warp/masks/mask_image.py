"""Deciding what is foreground in an image file that somebody calls a mask."""

from __future__ import annotations

import cv2
import numpy as np

from mmocap_warp.masks.label_images import Labels


def decode_mask(image: np.ndarray | Labels, identity: int = 0, soft: bool = False) -> np.ndarray:
    """Boolean mask of an image read unchanged: gray, 1-bit, of labels, RGB or RGBA.

    An alpha channel that is not opaque everywhere decides. Else the brightest channel does, so that palette colours
    such as dark red count. Of an image with two levels, 0 and any other (0/255, 0/1, a palette label), the other is
    foreground; with more levels (soft or compressed masks), foreground is what exceeds half the range.

    Args:
        image: (height, width) or (height, width, 2, 3 or 4), unsigned integers; or several objects' labels.
        identity: of the object that is meant, the label or gray level of its pixels; 0 for all.
        soft: levels are never labels, as in a video that was compressed: what exceeds half the range is foreground.

    Returns:
        (height, width) bool.
    """
    if isinstance(image, Labels):
        return image.mask(identity)
    if identity:
        return (image if image.ndim == 2 else image[..., 0]) == identity
    full = np.iinfo(image.dtype).max
    if image.ndim == 3 and image.shape[2] in (2, 4):
        alpha = image[..., -1]
        image = image[..., :-1] if alpha.min() == full else alpha
    level = image.max(axis=2) if image.ndim == 3 else image
    highest = int(level.max())
    two_levels = not soft and cv2.countNonZero(level) == np.count_nonzero(level == highest)
    return level > (0 if two_levels else full // 2)
