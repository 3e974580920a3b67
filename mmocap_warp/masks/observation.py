"""What was seen at one time: the foreground masks of all cameras, packed 32 pixels to a word."""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Self

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


_IN_MEMORY = 2**26  # bytes; larger amounts go to a temporary file
_LEVEL = 1  # a mask of 640 x 480 takes 1 to 2 KB, in 0.1 ms; higher levels bring little


class KeptObservations:
    """Consecutive frames' masks, compressed, in the order in which they were added; to be used in a ``with``.

    Where the temporary file cannot grow, none are kept.
    """

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(_IN_MEMORY)  # noqa: SIM115  __exit__ closes it
        self._frames: list[tuple[int, Observation]] = []  # its length in the file, and the rest of it
        self._full = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, observation: Observation) -> None:
        """Put the next frame aside."""
        if self._full:
            return
        try:
            length = self._file.write(zlib.compress(observation.words.tobytes(), _LEVEL))
            self._file.flush()  # else a full disk is noticed too late to read the masks again
        except OSError:  # no room
            self._frames.clear()
            self._full = True
            with suppress(OSError):  # closing writes what is left
                self._file.close()
            return
        empty = np.broadcast_to(np.uint32(0), observation.words.shape)  # its shape, and no memory
        self._frames.append((length, replace(observation, words=empty)))

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[Observation]:
        """The frames, each with the bits it was added with. One iteration at a time."""
        self._file.seek(0)
        for length, frame in self._frames:
            words = np.frombuffer(zlib.decompress(self._file.read(length)), "<u4")
            yield replace(frame, words=words.reshape(frame.words.shape))
