"""Reading images one at a time: some frames of a camera, and several cameras at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from itertools import islice
from typing import Protocol, TypeVar

Image = TypeVar("Image", covariant=True)


class ReadInOrder(Protocol[Image]):
    """What a camera's frames have in common, whatever they are read from."""

    def __len__(self) -> int: ...

    def read(self, first: int = 0) -> Iterator[Image]:
        """Frames from ``first`` on."""


def numbered(frames: ReadInOrder[Image] | None, numbers: Iterable[int]) -> Iterator[Image | None]:
    """The frames of these numbers, none below the one before; None where there is none, and one at a time in memory."""
    reader: Iterator[Image] | None = None
    last, image = -1, None
    for number in numbers:
        if frames is None or not 0 <= number < len(frames):
            yield None
            continue
        if reader is None:
            reader, last = frames.read(number), number - 1
        while last < number:
            image, last = next(reader), last + 1
        yield image


def abreast(streams: Sequence[Iterator[Image]], pool: Executor) -> Iterator[list[Image]]:
    """What streams of one length yield, an item of each at a time, read at once; they are read to their ends."""
    while all(items := list(pool.map(lambda stream: list(islice(stream, 1)), streams))):
        yield [item for (item,) in items]
