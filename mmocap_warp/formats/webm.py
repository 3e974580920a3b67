"""Writing ``.webm`` videos (VP8), which browsers play and OpenCV's wheel can encode."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.formats.matroska import read_frames, write_vp8
from mmocap_warp.whole_file import whole_file

_MOST_BITS = 1.5 * (2**31 - 1) / 2  # that OpenCV asks an encoder for [1/s]
_BITS_PER_SECOND = 8 * 1.0e6  # of a video, about and at most


class WebmFile:
    """A video that appears under its name when it is complete; a context manager.

    OpenCV has no setting for the rate, and asks the encoder for several megabytes a second: 1.5 bits a pixel, but for
    ``_MOST_BITS`` a second at most. So it is told of far more frames a second than there are, until that bound is what
    we want, and the frames that it encoded are written once more, with their true times.

    Raises:
        InputError: a name that does not end in .webm, no such folder, one that cannot be written to, or a full disk.
    """

    def __init__(self, path: str | Path, fps: float) -> None:
        self._path = Path(path)
        if self._path.suffix != ".webm":
            raise InputError(path, "is not a WebM file name", "end it in .webm")
        self._fps = fps
        self._writer: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self._frames = 0

    def __enter__(self) -> WebmFile:
        with contextlib.ExitStack() as stack:
            self._unfinished = stack.enter_context(whole_file(self._path))
            self._encoded = self._unfinished.with_name(f"{self._unfinished.stem}.encoded.webm")
            stack.callback(self._encoded.unlink, missing_ok=True)
            self._close = stack.pop_all()
        return self

    def write(self, frame: np.ndarray) -> None:
        """Append a BGR frame; all have one size."""
        with _quiet_stderr():  # OpenCV grumbles about every codec tag in WebM, and of a full disk at every frame
            if self._writer is None:
                self._size = (frame.shape[1] & ~1, frame.shape[0] & ~1)  # OpenCV leaves out an odd row or column
                rate = round(self._fps * _MOST_BITS / _BITS_PER_SECOND)
                self._writer = cv2.VideoWriter(
                    str(self._encoded), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"VP80"), rate, frame.shape[1::-1]
                )
            if not self._writer.isOpened():
                raise InputError(self._path, "cannot be written", "check its folder's permissions and free space")
            self._writer.write(frame)
        self._frames += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._close:
            if self._writer is not None:
                with _quiet_stderr():
                    self._writer.release()
            if error is not None:
                raise error
            written = write_vp8(self._unfinished, read_frames(self._encoded), self._frames, self._size, self._fps)
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
