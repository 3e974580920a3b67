"""WebM, which is Matroska (RFC 9559): the frames of a file, and a file of frames."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

_EBML, _SEGMENT, _CLUSTER, _BLOCK_GROUP = 0x1A45DFA3, 0x18538067, 0x1F43B675, 0xA0
_SIMPLE_BLOCK, _BLOCK, _TIMESTAMP = 0xA3, 0xA1, 0xE7
_SEEK_HEAD, _INFO, _TRACKS, _CUES = 0x114D9B74, 0x1549A966, 0x1654AE6B, 0x1C53BB6B
_OPENED = (_SEGMENT, _CLUSTER, _BLOCK_GROUP)  # what holds blocks, or what holds that
_BLOCK_HEADER = 4  # bytes: the track's number, the time, flags
_LONGEST_CLUSTER = 30_000  # milliseconds; a block says in 16 bits how much later it is than its cluster


def read_frames(path: Path) -> Iterator[bytes]:
    """The encoded frames of a file with one track, up to where the file was cut short."""
    with path.open("rb") as file:
        while (name := _read_number(file, keep_length=True)) is not None:
            size = _read_number(file)
            if size is None:
                return
            if name in (_SIMPLE_BLOCK, _BLOCK):
                block = file.read(size)
                if len(block) < size:
                    return
                yield block[_BLOCK_HEADER:]
            elif name not in _OPENED:
                file.seek(size, 1)


def write_vp8(path: Path, frames: Iterable[bytes], count: int, size: tuple[int, int], fps: float) -> int:
    """Write VP8 frames at equal distances in time, with an index of those that can be jumped to.

    Args:
        path: the file.
        frames: as the encoder gave them.
        count: how many they should be.
        size: width and height [px].
        fps: frames per second.

    Returns:
        How many they were.

    Raises:
        OSError: what any writing may raise.
    """
    written, index = 0, b""
    cluster, since = b"", 0
    with path.open("wb") as file:
        header = _number(0x4286, 1) + _number(0x42F7, 1) + _number(0x42F2, 4) + _number(0x42F3, 8)
        file.write(_element(_EBML, header + _element(0x4282, b"webm") + _number(0x4287, 2) + _number(0x4285, 2)))
        file.write(_element(_SEGMENT, b""))  # how long it is, is written in the end
        start = file.tell()
        file.write(_seek_head(0) + _info(count, fps) + _track(size, fps))
        for frame in frames:
            time = round(1000 * written / fps)
            is_key = not frame[0] & 1
            if is_key or time - since > _LONGEST_CLUSTER:
                file.write(cluster and _element(_CLUSTER, cluster))
                cluster, since = _number(_TIMESTAMP, time), time
            if is_key:
                place = _element(0xB7, _number(0xF7, 1) + _number(0xF1, file.tell() - start))
                index += _element(0xBB, _number(0xB3, time) + place)
            cluster += _element(_SIMPLE_BLOCK, struct.pack(">BhB", 0x81, time - since, 0x80 * is_key) + frame)
            written += 1
        file.write(cluster and _element(_CLUSTER, cluster))
        cues = file.tell() - start
        length = cues + file.write(_element(_CUES, index))
        file.seek(start)
        file.write(_seek_head(cues))
        file.seek(start - 8)
        file.write(_length(length))
    return written


def _seek_head(cues: int) -> bytes:
    """Where the index is; as long for any place."""
    place = _element(0x53AB, _CUES.to_bytes(4, "big")) + _element(0x53AC, cues.to_bytes(8, "big"))
    return _element(_SEEK_HEAD, _element(0x4DBB, place))


def _info(count: int, fps: float) -> bytes:
    """Times are in milliseconds; how long the whole is."""
    duration = _element(0x4489, struct.pack(">d", 1000 * count / fps))
    names = _element(0x4D80, b"mmocap-warp") + _element(0x5741, b"mmocap-warp")
    return _element(_INFO, _number(0x2AD7B1, 1_000_000) + duration + names)


def _track(size: tuple[int, int], fps: float) -> bytes:
    """The only track: video."""
    video = _element(0xE0, _number(0xB0, size[0]) + _number(0xBA, size[1]))
    of_frame = _number(0x23E383, round(Fraction(10**9) / Fraction(fps)))  # nanoseconds
    kind = _number(0xD7, 1) + _number(0x73C5, 1) + _number(0x83, 1) + _number(0x9C, 0) + _element(0x86, b"V_VP8")
    return _element(_TRACKS, _element(0xAE, kind + of_frame + video))


def _element(name: int, content: bytes) -> bytes:
    return name.to_bytes((name.bit_length() + 7) // 8, "big") + _length(len(content)) + content


def _number(name: int, value: int) -> bytes:
    """An element that holds a number."""
    return _element(name, value.to_bytes(max(1, (value.bit_length() + 7) // 8), "big"))


def _length(size: int) -> bytes:
    """A size, always in eight bytes."""
    return (1 << 56 | size).to_bytes(8, "big")


def _read_number(file: BinaryIO, *, keep_length: bool = False) -> int | None:
    """A number whose first byte says how many bytes it has; None at the end. A name keeps the bit that says so."""
    first = file.read(1)
    if not first or not first[0]:
        return None
    more = 8 - first[0].bit_length()
    rest = file.read(more)
    if len(rest) < more:
        return None
    value = int.from_bytes(first + rest, "big")
    return value if keep_length else value & ((1 << 7 * (more + 1)) - 1)
