"""Writing what browsers show and OpenCV's wheel encodes: ``.png``, animated ``.webp``, and ``.webm`` videos (VP8)."""

import contextlib
import os
import struct
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Self

import cv2
import numpy as np

from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.whole_file import native_path, whole_file, write_whole

_WEBP_QUALITY = 50  # of 100
# Runs compress a mask to 1.3 times what the highest level makes of it, in a twelfth of the time.
_MASK_SETTINGS = [cv2.IMWRITE_PNG_BILEVEL, 1, cv2.IMWRITE_PNG_COMPRESSION, 1]
_MASK_SETTINGS += [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]


def write_png(path: str | Path, image: np.ndarray) -> None:
    """Write what :func:`encode_png` makes of an image, whole or not at all."""
    write_whole(Path(path), encode_png(image))


def make_image_folders(whole: Path, folders: Iterable[Path], digits: int) -> None:
    """Make folders within one for PNGs whose numbers have so many digits or more, and remove those of earlier runs."""
    with input_errors(whole, "cannot be written to ({error})", "choose another folder", OSError):
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
            for earlier in folder.glob("[0-9]" * digits + "*.png"):
                if earlier.stem.isdecimal():
                    earlier.unlink()


def encode_png(image: np.ndarray) -> bytes:
    """A gray or BGR picture (uint8), or a mask (bool, as white on black of one bit), as PNG; or a ValueError."""
    picture, settings = (image.astype(np.uint8) * 255, _MASK_SETTINGS) if image.dtype == bool else (image, [])
    good, data = cv2.imencode(".png", picture, settings)
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
_KEY_INTERVAL = 12  # frames from one that can be jumped to, to the next, as OpenCV asks of the encoder
_VP8 = cv2.VideoWriter.fourcc(*"VP80")
_SEGMENT = b"\x18\x53\x80\x67"  # the element that holds all of a WebM file but its head; eight bytes of length follow
_TRACK_NUMBER = b"\x73\xc5\x88"  # the element that holds a track's number, and that eight bytes follow
_HEAD = 600  # bytes that hold what comes before the first frame


class WebmFile:
    """A video that appears under its name when it is complete; a context manager.

    The last frame is as sharp as the first, whatever the true rate is. OpenCV has no setting for quality, and asks the
    encoder for so many bits a second that some ten megabytes a second are written. So it is told a far higher rate,
    ``_ENCODER_RATE``, at which a frame takes up to .35 bits a pixel (measured); at 15,000 it would be .18, and a legend
    over a noisy room loses half of its sharpness within twelve frames. OpenCV writes IVF, whose frames it then puts
    into WebM with their true times.
    """

    def __init__(self, path: str | Path, fps: float) -> None:
        self._path, self._fps = Path(path), fps
        self._writer: cv2.VideoWriter | None = None
        self._size, self._frames = (0, 0), 0

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            self._unfinished = stack.enter_context(whole_file(self._path))
            self._encoded = self._unfinished.with_name(f"{self._unfinished.stem}.encoded.ivf")
            stack.callback(self._encoded.unlink, missing_ok=True)
            self._close = stack.pop_all()
        return self

    def write(self, frame: np.ndarray) -> None:
        """Append a BGR frame; all have one size."""
        if self._writer is None:
            self._size = (frame.shape[1] & ~1, frame.shape[0] & ~1)  # OpenCV leaves out an odd row or column
            file, size = native_path(self._encoded), frame.shape[1::-1]
            self._writer = cv2.VideoWriter(file, cv2.CAP_FFMPEG, _VP8, _ENCODER_RATE, size)
        if not self._writer.isOpened():
            raise InputError(self._path, "cannot be written", "check its folder's permissions and free space")
        self._writer.write(frame)
        self._frames += 1

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        with self._close:
            if self._writer is not None:
                self._writer.release()
            if error is not None:
                raise error
            if self._frames > _write_webm(self._unfinished, _read_ivf(self._encoded), self._size, self._fps):
                raise OSError("no space left")  # OpenCV says nothing of it


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


def _write_webm(path: Path, frames: Iterable[bytes], size: tuple[int, int], fps: float) -> int:
    """Write VP8 frames of a width and height at equal distances in time; returns how many are in a file that is whole.

    The same frames give the same bytes.
    """
    # Without an interval OpenCV marks all frames as such that can be jumped to, and no browser shows them.
    settings = [cv2.VIDEOWRITER_PROP_RAW_VIDEO, 1, cv2.VIDEOWRITER_PROP_KEY_INTERVAL, _KEY_INTERVAL]
    with _quiet_stderr():  # OpenCV grumbles about every codec tag in WebM
        video = cv2.VideoWriter(native_path(path), cv2.CAP_FFMPEG, _VP8, fps, size, settings)
    count = 0
    for frame in frames:
        count += 1
        video.set(cv2.VIDEOWRITER_PROP_KEY_FLAG, float(not frame[0] & 1))
        video.write(np.frombuffer(frame, np.uint8)[None])
    video.release()
    with path.open("r+b") as file:
        head = file.read(_HEAD)
        if _TRACK_NUMBER in head:  # OpenCV's is random
            number = head.index(_TRACK_NUMBER) + len(_TRACK_NUMBER)
            file.seek(0)
            file.write(head.replace(head[number : number + 8], bytes(7) + b"\1"))
    start = head.find(_SEGMENT) + 12
    length = int.from_bytes(head[start - 8 : start], "big") & (1 << 56) - 1
    return count if path.stat().st_size == start + length else 0


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
