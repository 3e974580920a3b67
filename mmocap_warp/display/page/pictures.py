"""Small pictures of what the cameras saw."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from mmocap_warp.formats.png import encode_png
from mmocap_warp.result.result import Result

_LONGER_SIDE = 240  # longer side of a picture [px]
_JPEG_QUALITY = 60
_MASK_CHARACTERS = 1_600_000  # room for all masks, at about half a kilobyte each
_IMAGE_CHARACTERS = 2_000_000  # room for all images, at about six kilobytes each

Views = Iterable[Sequence[np.ndarray | None]]
"""Per frame, a picture for each camera."""


def small_masks(masks: Views, cameras: int) -> Pictures:
    """Masks of all frames, or of as many as have room, as PNGs of one bit a pixel."""
    return _within(_MASK_CHARACTERS, masks, cameras, lambda mask: encode_png(_small(mask.astype(np.uint8) * 255) > 127))


def small_images(images: Views, cameras: int) -> Pictures:
    """Images of all frames, or of as many as have room, as JPEGs."""
    quality = (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY)
    return _within(_IMAGE_CHARACTERS, images, cameras, lambda image: cv2.imencode(".jpg", _small(image), quality)[1])


def _within(characters: int, views: Views, cameras: int, encoded: Callable[[np.ndarray], Any]) -> Pictures:
    """Encoded pictures of all frames, or of as many as have room."""
    columns: list[list[str | None]] = [[] for _ in range(cameras)]
    for seen in views:
        for column, picture in zip(columns, seen, strict=True):
            column.append(None if picture is None else base64.b64encode(encoded(picture)).decode())
    return Pictures.within(characters, columns)


def _small(picture: np.ndarray) -> np.ndarray:
    height, width = picture.shape[:2]
    scale = min(1.0, _LONGER_SIDE / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


_POSE_BYTES = 2_400_000  # room for all poses before they are base64
_JOINT_BYTES = 14  # a joint's turn and place in one frame


@dataclass(frozen=True)
class Pictures:
    """What the cameras saw in some of a page's frames.

    Attributes:
        of: per camera, base64 of the pictures; None where there is none.
        every: in how many of the page's frames there is one, the first always among them.
    """

    of: list[list[str | None]]
    every: int

    @classmethod
    def within(cls, characters: int, of: list[list[str | None]]) -> Pictures:
        """Pictures of as many frames as have room."""
        total = sum(len(picture or "") for pictures in of for picture in pictures)
        every = max(1, -(-total // characters))
        return cls([pictures[::every] for pictures in of], every)


def pose_step(result: Result) -> int:
    """The stride of the frames whose poses a page has room for."""
    runs, frames, _ = result.pose.shape
    tracks = runs * (1 if result.raw_pose is None else 2)
    return max(1, -(-frames * tracks * len(result.subject.body.skeleton.joints) * _JOINT_BYTES // _POSE_BYTES))


def sentence(rate: float, step: int, masks: Pictures | None, images: Pictures | None) -> str:
    """What a page says that it holds: one frame in ``step``, which are ``rate`` a second."""
    parts = [f"poses of {_frames(step)} ({rate:.3g} a second)"]
    for name, pictures in (("masks", masks), ("images", images)):
        parts += [] if pictures is None else [f"{name} of {_frames(step * pictures.every)}"]
    between = "" if step == 1 else " Between them, the body moves evenly."
    return f"This page holds {', '.join(parts)}.{between}"


def _frames(step: int) -> str:
    return "every frame" if step == 1 else f"one frame in {step}"
