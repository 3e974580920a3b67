"""Writing what browsers show and OpenCV's wheel encodes: ``.png``, animated ``.webp``, and ``.webm`` videos (VP8)."""

import contextlib
import os
import struct
import sys
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Self

import cv2
import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import native_path, whole_file, write_whole

_WEBP_QUALITY = 50  # of 100
# Runs compress a mask to 1.3 times what the highest level makes of it, in a twelfth of the time.
_MASK_SETTINGS = [cv2.IMWRITE_PNG_BILEVEL, 1, cv2.IMWRITE_PNG_COMPRESSION, 1]
_MASK_SETTINGS += [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]


def write_png(path: str | Path, image: np.ndarray) -> None:
    """Write a gray or BGR picture (uint8), or a mask (bool, as white on black of one bit), whole or not at all.

    Raises:
        ValueError: an image that PNG cannot hold.
    """
    write_whole(Path(path), encode_png(image))


def encode_png(image: np.ndarray) -> bytes:
    """What :func:`write_png` writes; a ValueError for an image that PNG cannot hold."""
    if image.dtype == bool:
        good, data = cv2.imencode(".png", image.astype(np.uint8) * 255, _MASK_SETTINGS)
    else:
        good, data = cv2.imencode(".png", image)
    if not good:
        raise ValueError(f"image of shape {image.shape} and type {image.dtype} cannot be encoded")
    return data.tobytes()


def write_animation(path: str | Path, frames: Sequence[np.ndarray], seconds: float) -> None:
    """Write BGR pictures of one size as an endless animated ``.webp``, ``seconds`` each, whole or not at all."""
    animation = cv2.Animation()
    animation.frames, animation.durations = list(frames), [round(1000 * seconds)] * len(frames)
    _, data = cv2.imencodeanimation(".webp", animation, (cv2.IMWRITE_WEBP_QUALITY, _WEBP_QUALITY))
    write_whole(Path(path), data.tobytes())


_ENCODER_RATE = 2000
"""Frames a second that the encoder is told of, which says how much room a frame has: about 700 bits a pixel over it."""


class WebmFile:
    """A video that appears under its name when it is complete; a context manager.

    The last frame is as sharp as the first, whatever the true rate is. OpenCV has no setting for quality, and asks the
    encoder for so many bits a second that some ten megabytes a second are written. So it is told a far higher rate,
    ``_ENCODER_RATE``, at which a frame takes up to .35 bits a pixel (measured); at 15,000 it would be .18, and a legend
    over a noisy room loses half of its sharpness within twelve frames. OpenCV writes IVF, whose frames are then written
    once more, with their true times.
    """

    def __init__(self, path: str | Path, fps: float) -> None:
        self._path = Path(path)
        self._fps = fps
        self._writer: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self._frames = 0

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            self._unfinished = stack.enter_context(whole_file(self._path))
            self._encoded = self._unfinished.with_name(f"{self._unfinished.stem}.encoded.ivf")
            stack.callback(self._encoded.unlink, missing_ok=True)
            self._close = stack.pop_all()
        return self

    def write(self, frame: np.ndarray) -> None:
        """Append a BGR frame; all have one size."""
        with _quiet_stderr():  # OpenCV grumbles about every codec tag in WebM, and of a full disk at every frame
            if self._writer is None:
                self._size = (frame.shape[1] & ~1, frame.shape[0] & ~1)  # OpenCV leaves out an odd row or column
                self._writer = cv2.VideoWriter(
                    native_path(self._encoded),
                    cv2.CAP_FFMPEG,
                    cv2.VideoWriter.fourcc(*"VP80"),
                    _ENCODER_RATE,
                    frame.shape[1::-1],
                )
            if not self._writer.isOpened():
                raise InputError(self._path, "cannot be written", "check its folder's permissions and free space")
            self._writer.write(frame)
        self._frames += 1

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        with self._close:
            if self._writer is not None:
                with _quiet_stderr():
                    self._writer.release()
            if error is not None:
                raise error
            written = _write_webm(self._unfinished, _read_ivf(self._encoded), self._frames, self._size, self._fps)
            if written < self._frames:  # OpenCV says nothing of it
                raise OSError(f"only {written} of {self._frames} frames; no space left")


@contextlib.contextmanager
def _quiet_stderr() -> Iterator[None]:
    """Silence what native code prints to the process's standard error."""
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


# Names of Matroska's elements (RFC 9559), of which WebM is made.
_EBML, _SEGMENT, _CLUSTER, _SIMPLE_BLOCK, _TIMESTAMP = 0x1A45DFA3, 0x18538067, 0x1F43B675, 0xA3, 0xE7
_SEEK_HEAD, _INFO, _TRACKS, _CUES = 0x114D9B74, 0x1549A966, 0x1654AE6B, 0x1C53BB6B
_MAX_CLUSTER = 30_000  # milliseconds; a block says in 16 bits how much later it is than its cluster


def _read_ivf(path: Path) -> Iterator[bytes]:
    """The encoded frames of an IVF file, which has a head of 32 bytes and 12 before each frame, to where it is cut."""
    with path.open("rb") as file:
        file.seek(32)
        while len(head := file.read(12)) == 12:
            (size,) = struct.unpack_from("<I", head)
            frame = file.read(size)
            if len(frame) < size:
                return
            yield frame


def _write_webm(path: Path, frames: Iterable[bytes], count: int, size: tuple[int, int], fps: float) -> int:
    """Write VP8 frames at equal distances in time, with an index of those that can be jumped to.

    ``count`` says how many they should be, ``size`` is their width and height [px]. Returns how many they were.
    """
    written, index = 0, b""
    cluster, since = b"", 0
    with path.open("wb") as file:
        # The head, and a segment whose length and index are written at the end.
        header = _number(0x4286, 1) + _number(0x42F7, 1) + _number(0x42F2, 4) + _number(0x42F3, 8)
        file.write(_element(_EBML, header + _element(0x4282, b"webm") + _number(0x4287, 2) + _number(0x4285, 2)))
        file.write(_element(_SEGMENT, b""))  # how long it is, is written in the end
        start = file.tell()
        file.write(_seek_head(0) + _info(count, fps) + _track(size, fps))
        for frame in frames:
            # A cluster begins at each frame that can be jumped to; the index says where.
            time = round(1000 * written / fps)
            is_key = not frame[0] & 1
            if is_key or time - since > _MAX_CLUSTER:
                file.write(cluster and _element(_CLUSTER, cluster))
                cluster, since = _number(_TIMESTAMP, time), time
            if is_key:
                place = _element(0xB7, _number(0xF7, 1) + _number(0xF1, file.tell() - start))
                index += _element(0xBB, _number(0xB3, time) + place)
            cluster += _element(_SIMPLE_BLOCK, struct.pack(">BhB", 0x81, time - since, 0x80 * is_key) + frame)
            written += 1
        file.write(cluster and _element(_CLUSTER, cluster))
        # The index, and what the head could not know.
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
