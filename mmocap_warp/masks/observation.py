"""What was seen at one time: the foreground masks of all cameras, packed 32 pixels to a word."""

import tempfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any, Self

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig


def words_per_row(width: int) -> int:
    """Number of 32-pixel words that hold a row of ``width`` pixels."""
    return (width + 31) // 32


def pack_masks(masks: list[np.ndarray]) -> np.ndarray:
    """Pack a mask per camera into words; pixel ``x`` is bit ``x % 32`` (from the lowest) of word ``x // 32``.

    The masks are (height, width) bool, the words (camera, row, word) uint32; smaller masks are padded with background.
    """
    rows = max(mask.shape[0] for mask in masks)
    words = max(words_per_row(mask.shape[1]) for mask in masks)
    packed = np.zeros((len(masks), rows, words * 4), np.uint8)
    for k, mask in enumerate(masks):
        packed[k, : mask.shape[0], : -(-mask.shape[1] // 8)] = np.packbits(mask, axis=-1, bitorder="little")
    return packed.view("<u4")


def unpack_masks(words: np.ndarray, sizes: np.ndarray) -> list[np.ndarray]:
    """The inverse of :func:`pack_masks`; ``sizes`` is (camera, 2): width, height."""
    bits = np.unpackbits(words.view("u1"), axis=-1, bitorder="little").astype(bool)
    return [bits[k, :height, :width] for k, (width, height) in enumerate(sizes)]


@dataclass(frozen=True)
class Observation:
    """The masks of one frame."""

    words: np.ndarray  # (camera, row, word) uint32, see :func:`pack_masks`
    foreground: np.ndarray  # (camera,) int, foreground pixels; 0 means that the view is lost
    # (camera,) float64, by how much later than the frame each mask was taken [s]; None where all are in time.
    late: np.ndarray | None = None
    # (camera, row, word) uint32, pixels that show what may be in front of the subject, none of them foreground.
    hidden: np.ndarray | None = None
    holed: np.ndarray | None = None  # (camera,) bool, views whose masks lack a piece; None where none is known to

    @classmethod
    def from_masks(
        cls, masks: list[np.ndarray], late: np.ndarray | None = None, hidden: list[np.ndarray] | None = None
    ) -> Self:
        """Pack one (height, width) boolean mask per camera, and of ``hidden`` what is no foreground.

        In a view in which none of that is near the mask, it hides nothing: what is hidden goes on where a mask ends.
        """
        words, covered = pack_masks(masks), None
        if hidden is not None:
            hides = pack_masks(hidden)
            near = np.array([_meet(*each) for each in zip(_cells(words), _cells(hides), masks, hidden, strict=True)])
            covered = hides & ~words * near[:, None, None] if near.any() else None
        return cls(words, np.bitwise_count(words).sum(axis=(1, 2), dtype=np.int64), late, covered)

    @property
    def possible(self) -> np.ndarray:
        """(camera, row, word) uint32, where the subject may be: its masks, and what may be in front of it."""
        return self.words if self.hidden is None else self.words | self.hidden

    def unpacked_hidden(self, sizes: np.ndarray) -> list[np.ndarray] | None:
        """``hidden`` as :func:`unpack_masks` gives masks."""
        return None if self.hidden is None else unpack_masks(self.hidden, sizes)

    def without(self, views: np.ndarray) -> Self:
        """The same with nobody in some views (camera,) bool."""
        return replace(self, words=self.words * ~views[:, None, None], foreground=self.foreground * ~views)


def _cells(words: np.ndarray) -> np.ndarray:
    """(camera, row, column) uint8, 1 where a cell of 8 x 8 pixels has foreground."""
    rows = np.bitwise_or.reduceat(words, np.arange(0, words.shape[1], _FAULT), axis=1)
    return (rows.view(np.uint8) > 0).view(np.uint8)


def _meet(cells: np.ndarray, other_cells: np.ndarray, mask: np.ndarray, other: np.ndarray) -> bool:
    """Whether two masks (height, width) bool, of these cells, are as near to each other as their faults are large."""
    if (cells & other_cells).any():
        return True
    if not (cv2.dilate(cells, np.ones((3, 3), np.uint8)) & other_cells).any():
        return False
    beside = np.ones((2 * _FAULT + 1, 2 * _FAULT + 1), np.uint8)
    return bool((cv2.dilate(mask.view(np.uint8), beside).view(bool) & other).any())


def make_views(rig: CameraRig, device: str) -> Any:
    """A rig and a frame's masks, empty at first, in the kernels' struct; a ValueError for too wide an image."""
    from mmocap_warp.kernels.block import WORDS  # Warp, which masks do not need
    from mmocap_warp.kernels.structs import allocated
    from mmocap_warp.kernels.views.projection import Views

    rows, words = int(rig.size[:, 1].max()), words_per_row(int(rig.size[:, 0].max()))
    if 8 * words >= WORDS:
        raise ValueError(f"images must be narrower than {4 * WORDS} px, got {rig.size[:, 0].max()}")
    cameras = {"rotation": rig.R, "translation": rig.t, "lens": lens_values(rig), "size": rig.size.astype(np.int32)}
    return allocated(Views, device, **cameras, observed=(len(rig), rows, words), foreground=len(rig), hidden=(0, 0, 0))


def lens_values(rig: CameraRig) -> np.ndarray:
    """(camera, 4) fx fy cx cy [px]."""
    return np.stack([rig.K[:, 0, 0], rig.K[:, 1, 1], rig.K[:, 0, 2], rig.K[:, 1, 2]], axis=1)


_FAULT = 8  # gaps up to so wide between a mask and what hides the subject are faults [px]; a cell is as large
_IN_MEMORY = 2**26  # bytes; larger amounts go to a temporary file
_LEVEL = 1  # a mask of 640 x 480 takes 1 to 2 KB, in 0.1 ms; higher levels bring little


class KeptObservations:
    """Consecutive frames' masks, compressed, in the order in which they were added; to be used in a ``with``.

    They may be read while others are added. Where the temporary file cannot grow, none are kept.
    """

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(_IN_MEMORY)  # noqa: SIM115  __exit__ closes it
        self._frames: list[tuple[int, Observation]] = []  # its length in the file, and the rest of it
        self._full, self._lock = False, Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, observation: Observation) -> None:
        """Put the next frame aside."""
        if self._full:
            return
        try:
            hidden = b"" if observation.hidden is None else observation.hidden.tobytes()
            packed = zlib.compress(observation.words.tobytes() + hidden, _LEVEL)
            with self._lock:
                self._file.seek(0, 2)  # to its end
                length = self._file.write(packed)
                self._file.flush()  # else a full disk is noticed too late to read the masks again
        except OSError:  # no room
            with self._lock, suppress(OSError):  # closing writes what is left
                self._frames.clear()
                self._full = True
                self._file.close()
            return
        empty = np.broadcast_to(np.uint32(0), observation.words.shape)  # its shape, and no memory
        hides = None if observation.hidden is None else empty
        self._frames.append((length, replace(observation, words=empty, hidden=hides)))

    def through(self, observations: Iterable[Observation]) -> Iterator[Observation]:
        """Give observations on, each put aside before."""
        for observation in observations:
            self.add(observation)
            yield observation

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[Observation]:
        """The frames, each with the bits it was added with."""
        place = 0
        for length, frame in self._frames:
            with self._lock:
                if self._full:
                    return
                self._file.seek(place)
                packed = self._file.read(length)
            place += length
            words = np.frombuffer(zlib.decompress(packed), "<u4").reshape(-1, *frame.words.shape)
            yield replace(frame, words=words[0], hidden=None if frame.hidden is None else words[1])
