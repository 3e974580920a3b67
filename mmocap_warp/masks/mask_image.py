"""Deciding what is foreground in an image file that somebody calls a mask."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np


def decode_mask(image: np.ndarray | Labels, identity: int = 0, soft: bool = False) -> np.ndarray:
    """(height, width) bool: the mask of an image read unchanged: gray, 1-bit, of labels, RGB or RGBA, of whole numbers.

    An alpha channel that is not opaque everywhere decides. Else the brightest channel does, so that palette colours
    such as dark red count. Of an image with two levels, 0 and any other (0/255, 0/1, a palette label), the other is
    foreground; with more levels (soft or compressed masks), foreground is what exceeds half the range. In ``soft``
    images, such as a video's that was compressed, this holds for two levels too. Where an ``identity`` other than 0 is
    given, it is the label or gray level of the object that is meant.
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


_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PALETTE_TYPE = 3  # of a PNG's header: pixels are indices of a palette


@dataclass(frozen=True)
class Labels:
    """A frame's objects."""

    image: np.ndarray  # (height, width) unsigned integers, the identity that each pixel belongs to; 0 is background

    @property
    def shape(self) -> tuple[int, ...]:
        """(height, width)."""
        return self.image.shape

    @cached_property
    def identities(self) -> dict[int, int]:
        """The pixels of each identity that is there."""
        count = np.bincount(self.image.ravel())
        return {int(identity): int(count[identity]) for identity in np.flatnonzero(count) if identity}

    def mask(self, identity: int) -> np.ndarray:
        """(height, width) bool: one object, or all of them for 0."""
        return self.image == identity if identity else self.image != 0


def identities_of(images: Iterable[np.ndarray | Labels]) -> set[int]:
    """All identities in some images: labels, or at most 16 levels of each gray image."""
    identities: set[int] = set()
    for image in images:
        labels = image if isinstance(image, Labels) else Labels(image if image.ndim == 2 else image[..., 0])
        identities.update(list(labels.identities)[:16])
    return identities


def palette_labels(data: bytes) -> Labels | None:
    """The objects of a PNG whose colours are identities, as SAM 2 and DAVIS write them; None for any other image.

    A palette's index is the identity; index 0 is background, and black. Another palette, one of grays, or one with
    transparency belongs to an ordinary picture that was saved in little space.
    """
    chunks = _png_chunks(data)
    if not chunks:
        return None
    (first_kind, header), content = chunks[0], dict(chunks)
    has_palette = first_kind == b"IHDR" and len(header) == 13 and header[9] == _PALETTE_TYPE
    palette = content.get(b"PLTE", b"")
    if not has_palette or b"tRNS" in content or not palette or len(palette) % 3:
        return None
    colours = np.frombuffer(palette, np.uint8).reshape(-1, 3)
    if (colours == colours[:, :1]).all():
        return None
    index = _indices(chunks)
    if colours[0].any() or index is None or int(index.max()) >= len(colours):
        return None
    return Labels(index)


def _png_chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    """Kinds and contents in order, up to the end or to where the file is damaged; none where it is no PNG."""
    if not data.startswith(_SIGNATURE):
        return []
    chunks, at = [], len(_SIGNATURE)
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return chunks


def _indices(chunks: list[tuple[bytes, bytes]]) -> np.ndarray | None:
    """(height, width) uint8: OpenCV decodes the image with a palette in which each index is its own gray."""
    grays = np.repeat(np.arange(256, dtype=np.uint8), 3)[: 3 << chunks[0][1][8]].tobytes()
    data = _SIGNATURE
    for kind, body in chunks:
        if kind in (b"IHDR", b"PLTE", b"IDAT", b"IEND"):
            body = grays if kind == b"PLTE" else body
            data += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:  # its header states a size beyond all bounds
        image = None
    return None if image is None else np.asarray(image)
