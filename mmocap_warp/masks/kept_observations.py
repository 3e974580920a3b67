"""Observations put aside, to be looked at again without reading and cleaning their images again."""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Self

import numpy as np

from mmocap_warp.masks.observation import Observation

_IN_MEMORY = 2**26  # bytes; what is more goes to a temporary file
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
            self._file.flush()  # or it is told only when it is too late to read the masks again
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
