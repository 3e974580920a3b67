"""What was seen at one time: the foreground masks of all cameras, packed 32 pixels to a word."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


def words_per_row(width: int) -> int:
    """Number of 32-pixel words that hold a row of ``width`` pixels."""
    return (width + 31) // 32


def pack_masks(masks: list[np.ndarray]) -> np.ndarray:
    """Pack one boolean mask per camera into words; pixel ``x`` is bit ``x % 32`` (from the lowest) of word ``x // 32``.

    Args:
        masks: per camera (height, width) bool; sizes may differ, smaller ones are padded with background.

    Returns:
        (camera, row, word) uint32.
    """
    rows = max(mask.shape[0] for mask in masks)
    words = max(words_per_row(mask.shape[1]) for mask in masks)
    padded = np.zeros((len(masks), rows, words * 32), bool)
    for k, mask in enumerate(masks):
        padded[k, : mask.shape[0], : mask.shape[1]] = mask
    return np.packbits(padded, axis=-1, bitorder="little").view("<u4")


def unpack_masks(words: np.ndarray, sizes: np.ndarray) -> list[np.ndarray]:
    """The inverse of :func:`pack_masks`; ``sizes`` is (camera, 2): width, height."""
    bits = np.unpackbits(words.view("u1"), axis=-1, bitorder="little").astype(bool)
    return [bits[k, :height, :width] for k, (width, height) in enumerate(sizes)]


@dataclass(frozen=True)
class Observation:
    """The masks of one frame.

    Attributes:
        words: (camera, row, word) uint32, see :func:`pack_masks`.
        foreground: (camera,) int, foreground pixels; 0 means that the view is lost.
        late: (camera,) float64, by how much later than the frame each mask was taken [s]; None where all are in time.
    """

    words: np.ndarray
    foreground: np.ndarray
    late: np.ndarray | None = None

    @classmethod
    def from_masks(cls, masks: list[np.ndarray], late: np.ndarray | None = None) -> Observation:
        """Pack one (height, width) boolean mask per camera."""
        return cls(pack_masks(masks), np.array([int(mask.sum()) for mask in masks], np.int64), late)
