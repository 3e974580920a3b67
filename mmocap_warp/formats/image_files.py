"""Writing what browsers show and OpenCV's wheel encodes: ``.png``, animated ``.webp``, and ``.webm`` videos (VP8)."""

import contextlib
import os
import struct
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
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
_GROUP = 24  # frames that an encoder takes: to start one takes as long as three frames
_VP8 = cv2.VideoWriter.fourcc(*"VP80")
_SEGMENT = b"\x18\x53\x80\x67"  # the element that holds all of a WebM file but its head; eight bytes of length follow
_TRACK_NUMBER = b"\x73\xc5\x88"  # the element that holds a track's number, and that eight bytes follow
_HEAD = 600  # bytes that hold what comes before the first frame
_ENCODERS = 4  # groups that are encoded at a time, at most: their pictures are in memory


class WebmFile:
    """A video that appears under its name when it is complete; a context manager.

    The last frame is as sharp as the first, whatever the true rate is. OpenCV has no setting for quality, and asks the
    encoder for so many bits a second that some ten megabytes a second are written. So it is told a far higher rate,
    ``_ENCODER_RATE``, at which a frame takes up to .35 bits a pixel (measured); at 15,000 it would be .18, and a legend
    over a noisy room loses half of its sharpness within twelve frames. Groups of frames are encoded side by side, by as
    many threads as OpenCV may use, into IVF files, and put together with their true times.
    """

    def __init__(self, path: str | Path, fps: float) -> None:
        self._path, self._fps = Path(path), fps
        self._threads = max(1, min(_ENCODERS, cv2.getNumThreads()))
        self._waiting: list[np.ndarray] = []
        self._encoded: deque[Future[list[bytes]]] = deque()
        self._video: cv2.VideoWriter | None = None
        self._groups = 0

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            self._unfinished = stack.enter_context(whole_file(self._path))
            self._pool = stack.enter_context(ThreadPoolExecutor(self._threads))
            self._close = stack.pop_all()
        return self

    def write(self, frame: np.ndarray) -> None:
        """Append a BGR frame, which must stay as it is; all have one size."""
        self._waiting.append(frame)
        if len(self._waiting) == _GROUP:
            self._encode()

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        with self._close:
            if error is not None:
                raise error
            if self._waiting:
                self._encode()
            self._append_encoded(0)
            if self._video is not None:
                self._video.release()
                # The track has a random number, twice in the head: the same video is to be the same bytes.
                with self._unfinished.open("r+b") as file:
                    head = file.read(_HEAD)
                    number = head.find(_TRACK_NUMBER) + len(_TRACK_NUMBER)
                    file.seek(0)
                    file.write(head.replace(head[number : number + 8], bytes(7) + b"\1"))
                # OpenCV says nothing of a full disk; the file's segment knows how long it is.
                start = head.find(_SEGMENT) + 12
                length = int.from_bytes(head[start - 8 : start], "big") & (1 << 56) - 1
                if self._unfinished.stat().st_size != start + length:
                    raise OSError("no space left")

    def _encode(self) -> None:
        """Let a thread encode the frames that wait."""
        if self._video is None:
            height, width = self._waiting[0].shape[:2]
            size = (width & ~1, height & ~1)
            # Without an interval OpenCV marks all frames as such that can be jumped to, and no browser shows them.
            encoded = [cv2.VIDEOWRITER_PROP_RAW_VIDEO, 1, cv2.VIDEOWRITER_PROP_KEY_INTERVAL, _GROUP]
            name = native_path(self._unfinished)
            with _quiet_stderr():  # OpenCV grumbles about every codec tag in WebM
                self._video = cv2.VideoWriter(name, cv2.CAP_FFMPEG, _VP8, self._fps, size, encoded)
            if not self._video.isOpened():
                raise InputError(self._path, "cannot be written", "check its folder's permissions and free space")
        file = self._unfinished.with_name(f"{self._unfinished.stem}.{self._groups}.ivf")
        self._encoded.append(self._pool.submit(_encoded, self._waiting, file))
        self._waiting, self._groups = [], self._groups + 1
        self._append_encoded(max(1, self._threads - 1))  # the next group is drawn meanwhile

    def _append_encoded(self, most: int) -> None:
        """Append groups in their order, until no more than ``most`` are being encoded."""
        while self._video and len(self._encoded) > most:
            for frame in self._encoded.popleft().result():
                self._video.set(cv2.VIDEOWRITER_PROP_KEY_FLAG, float(not frame[0] & 1))
                self._video.write(np.frombuffer(frame, np.uint8)[None])


def _encoded(frames: Sequence[np.ndarray], file: Path) -> list[bytes]:
    """Frames as VP8, which OpenCV writes to a file only: IVF, whose head has 32 bytes, and 12 before each frame."""
    try:
        writer = cv2.VideoWriter(native_path(file), cv2.CAP_FFMPEG, _VP8, _ENCODER_RATE, frames[0].shape[1::-1])
        for frame in frames:
            writer.write(frame)
        writer.release()
        data, at, packets = file.read_bytes(), 32, []
        while at + 12 < len(data):
            (size,) = struct.unpack_from("<I", data, at)
            packets.append(data[at + 12 : at + 12 + size])
            at += 12 + size
    finally:
        file.unlink(missing_ok=True)
    if len(packets) < len(frames) or at > len(data):
        raise OSError("no space left")
    return packets


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
