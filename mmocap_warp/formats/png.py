"""Writing ``.png`` pictures and masks."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import write_whole

_MASK_SETTINGS = (cv2.IMWRITE_PNG_BILEVEL, 1, cv2.IMWRITE_PNG_COMPRESSION, 9)


def write_png(path: str | Path, image: np.ndarray) -> None:
    """Write a gray or BGR picture (uint8), or a mask (bool, as white on black of one bit), whole or not at all.

    Raises:
        InputError: the name does not end in ``.png``, or its folder cannot be written.
        ValueError: an image that PNG cannot hold.
    """
    path = Path(path)
    if path.suffix != ".png":
        raise InputError(path, "is not a PNG file name", "end it in .png")
    write_whole(path, encode_png(image))


def encode_png(image: np.ndarray) -> bytes:
    """What :func:`write_png` writes.

    Raises:
        ValueError: an image that PNG cannot hold.
    """
    if image.dtype == bool:
        good, data = cv2.imencode(".png", image.astype(np.uint8) * 255, _MASK_SETTINGS)
    else:
        good, data = cv2.imencode(".png", image)
    if not good:
        raise ValueError(f"image of shape {image.shape} and type {image.dtype} cannot be encoded")
    return data.tobytes()
