"""Which frames are meant, as people write it (``100``, ``20:80``, ``20:80:2``), and reading images of these frames."""

import re
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from math import gcd
from typing import Any, Protocol, Self, TypeVar

import numpy as np

from mmocap_warp.masks.frames import VideoFile


@dataclass(frozen=True)
class FrameChoice:
    """Some frames of a recording: so many from the start, or a range."""

    count: int | None = None  # how many, from the first of those there are; None for a range
    first: int = 0  # number of the first
    end: int | None = None  # number after the last, or None for all to the last
    stride: int = 1  # every how many-th

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read a count, ``first:end`` or ``first:end:stride``; as in Python, ``first`` and ``end`` may be left out.

        Raises:
            ValueError: none of these, no frame, or a stride of 0.
        """
        if not re.fullmatch(r"\d{1,9}|\d{0,9}:\d{0,9}(:\d{0,9})?", text, re.ASCII):
            raise ValueError(f"frames = {text} is neither a count nor first:end or first:end:stride")
        if ":" not in text:
            return cls(count=int(text))
        first, end, stride = (int(part) if part else None for part in [*text.split(":"), ""][:3])
        choice = cls(None, first or 0, end, 1 if stride is None else stride)
        if choice.stride == 0 or (end is not None and end <= choice.first):
            raise ValueError(f"frames = {text} holds no frame")
        return choice

    def of(self, own: range, numbers: int) -> range:
        """The frames that are meant: a count is of the first of ``own``, a range is among so many ``numbers`` from 0.

        Raises:
            ValueError: more frames than there are, or none.
        """
        if self.count is not None:
            if not 1 <= self.count <= len(own):
                raise ValueError(f"frames = {self} is not in 1 to {len(own)}")
            return own[: self.count]
        chosen = range(self.first, numbers if self.end is None else self.end, self.stride)
        if not chosen or chosen.stop > numbers:
            raise ValueError(f"frames = {self} is not in 0:{numbers}")
        return chosen

    def __str__(self) -> str:
        if self.count is not None:
            return str(self.count)
        stride = f":{self.stride}" if self.stride != 1 else ""
        return f"{self.first}:{'' if self.end is None else self.end}{stride}"


def covering(numbers: list[int]) -> range:
    """The even range with the largest step that holds all of some ascending frame numbers."""
    return range(numbers[0], numbers[-1] + 1, gcd(*np.diff(numbers).tolist()) or 1)


Image = TypeVar("Image", covariant=True)


class ReadInOrder(Protocol[Image]):
    """What a camera's frames have in common, whatever they are read from."""

    def __len__(self) -> int: ...

    def read(self, first: int = 0) -> Iterator[Image]:
        """Frames from ``first`` on."""


def frames_by_number(frames: ReadInOrder[Image] | None, numbers: Iterable[int]) -> Iterator[Image | None]:
    """The frames of these numbers, none below the one before; None where there is none, and one at a time in memory."""
    reader: Iterator[Image] | None = None
    last, image = -1, None
    for number in numbers:
        if frames is None or not 0 <= number < len(frames):
            yield None
            continue
        # Images of a folder can be skipped; a video must be decoded in order.
        if reader is None or (number > last + 1 and not isinstance(frames, VideoFile)):
            reader, last = frames.read(number), number - 1
        while last < number:
            image, last = next(reader), last + 1
        yield image


def read_together(streams: Sequence[Iterator[Image]], each: Callable[..., Iterator[Any]]) -> Iterator[list[Image]]:
    """What streams of one length yield, an item of each at a time; they are read to their ends.

    They are read one after the other if ``each`` is :class:`map`, and at once by that of a pool of threads.
    """
    while all(items := list(each(lambda stream: list(islice(stream, 1)), streams))):
        yield [item for (item,) in items]


_FRAMES_AHEAD = 4  # that are read while one is tracked
Item = TypeVar("Item")


def read_ahead(items: Iterable[Item]) -> Generator[Item]:
    """The same items, such as observations; a thread reads the next ones while the caller works on one."""
    stream, end = iter(items), object()
    with ThreadPoolExecutor(1) as reader:
        waiting = deque(reader.submit(next, stream, end) for _ in range(_FRAMES_AHEAD))
        try:
            while (item := waiting.popleft().result()) is not end:
                waiting.append(reader.submit(next, stream, end))
                yield item  # type: ignore[misc]
        finally:
            for task in waiting:
                task.cancel()
