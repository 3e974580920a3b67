"""Small pictures of what the cameras saw."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Sequence

import cv2
import numpy as np

from mmocap_warp.display.page.thinning import Pictures
from mmocap_warp.formats.png import encode_png

_LONGER_SIDE = 240  # [px]
_JPEG_QUALITY = 60
_MASK_CHARACTERS = 1_600_000  # of all masks, at about half a kilobyte each
_IMAGE_CHARACTERS = 2_000_000  # of all images, at about six kilobytes each

Views = Iterable[Sequence[np.ndarray | None]]
"""Per frame, a picture for each camera."""


def small_masks(masks: Views, cameras: int) -> Pictures:
    """Masks of all frames, or of as many as have room, as PNGs of one bit a pixel."""
    return Pictures.within(_MASK_CHARACTERS, _per_camera(masks, cameras, _mask))


def small_images(images: Views, cameras: int) -> Pictures:
    """Images of all frames, or of as many as have room, as JPEGs."""
    return Pictures.within(_IMAGE_CHARACTERS, _per_camera(images, cameras, _image))


def _per_camera(views: Views, cameras: int, encoded: Callable[[np.ndarray], bytes]) -> list[list[str | None]]:
    columns: list[list[str | None]] = [[] for _ in range(cameras)]
    for seen in views:
        for column, picture in zip(columns, seen, strict=True):
            column.append(None if picture is None else base64.b64encode(encoded(picture)).decode())
    return columns


def _mask(mask: np.ndarray) -> bytes:
    return encode_png(_small(mask.astype(np.uint8) * 255) > 127)


def _image(image: np.ndarray) -> bytes:
    _, data = cv2.imencode(".jpg", _small(image), (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY))
    return data.tobytes()


def _small(picture: np.ndarray) -> np.ndarray:
    height, width = picture.shape[:2]
    scale = min(1.0, _LONGER_SIDE / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
