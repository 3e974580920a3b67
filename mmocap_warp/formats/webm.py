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
from mmocap_warp.whole_file import whole_file


class WebmFile:
    """A video that appears under its name when it is complete; a context manager.

    Raises:
        InputError: a name that does not end in .webm, no such folder, or a folder that cannot be written to.
    """

    def __init__(self, path: str | Path, fps: float) -> None:
        self._path = Path(path)
        if self._path.suffix != ".webm":
            raise InputError(path, "is not a WebM file name", "end it in .webm")
        self._fps = fps
        self._writer: cv2.VideoWriter | None = None

    def __enter__(self) -> WebmFile:
        self._whole = whole_file(self._path)
        self._unfinished = self._whole.__enter__()
        return self

    def write(self, frame: np.ndarray) -> None:
        """Append a BGR frame; all have one size."""
        if self._writer is None:
            size = (frame.shape[1], frame.shape[0])
            with _quiet_stderr():  # OpenCV grumbles about every codec tag in WebM, and writes it all the same
                self._writer = cv2.VideoWriter(
                    str(self._unfinished), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"VP80"), self._fps, size
                )
            if not self._writer.isOpened():
                raise InputError(self._path, "cannot be written", "check its folder's permissions and free space")
        self._writer.write(frame)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.release()
        self._whole.__exit__(kind, error, trace)


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
