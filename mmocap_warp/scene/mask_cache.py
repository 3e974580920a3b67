"""Subtracted masks, stored beside the scene so that they are made once.

Subtracting decodes the videos and is the slowest part of reading a recording; tracking, smoothing and drawing want the
same masks again. What is stored is what a camera's subtraction found at one scale, undistorted but not yet cleaned:
cleaning may depend on where the body was tracked. A file is ``.mmocap/<scene>/<camera>@<scale>.tar`` in the scene's
folder, with a PNG of one bit a frame. It is used only if all that its masks were made from is the same, and replaced
otherwise. Where it cannot be written, masks are made each time.
"""

from __future__ import annotations

import contextlib
import io
import os
import tarfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.formats.png import encode_png
from mmocap_warp.masks.mask_files import list_tar, read_member

_KEY = "made_from"  # the first member's name; it holds the key


def stored_masks(path: Path, key: str, first: int, count: int) -> Iterator[np.ndarray | None] | None:
    """The masks of frames ``first`` to ``first + count - 1`` in a camera's file; None where they are not stored.

    ``key`` says all that the masks were made from.

    Returns:
        Per frame (height, width) bool, None where the camera has no image.
    """
    try:
        head, *members = list_tar(path)
        if head.name != _KEY or read_member(path, head).decode() != key:
            return None
    except (InputError, ValueError):  # not there, or not whole
        return None
    by_frame = {int(Path(member.name).stem): member for member in members}

    def masks() -> Iterator[np.ndarray | None]:
        for frame in range(first, first + count):
            if frame not in by_frame:
                yield None
                continue
            image = cv2.imdecode(np.frombuffer(read_member(path, by_frame[frame]), np.uint8), cv2.IMREAD_UNCHANGED)
            if image is None:
                raise InputError(path, f"its mask of frame {frame} is damaged", "remove the file; it is made again")
            yield image > 0

    return masks()


def store_masks(path: Path, key: str, count: int, masks: Iterator[np.ndarray | None]) -> Iterator[np.ndarray | None]:
    """Pass ``masks`` on, all ``count`` frames of a camera, and store them at ``path`` once the last one is there.

    If the folder or disk is full, nothing is stored and nothing is said: tracking works without it.
    """
    unfinished = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    archive: tarfile.TarFile | None = None

    def add(name: str, data: bytes) -> None:
        """Add a member; the archive is given up where there is no room for it."""
        nonlocal archive
        if archive is None:
            return
        member = tarfile.TarInfo(name)
        member.size = len(data)
        try:
            archive.addfile(member, io.BytesIO(data))
        except OSError:
            with contextlib.suppress(OSError):
                archive.close()
            archive = None

    try:
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            archive = tarfile.open(unfinished, "w")  # noqa: SIM115
        add(_KEY, key.encode())
        for frame, mask in enumerate(masks):
            if mask is not None and archive is not None:
                add(f"{frame:06d}.png", encode_png(mask))
            if frame + 1 == count and archive is not None:
                with contextlib.suppress(OSError):
                    archive.close()
                    os.replace(unfinished, path)
            yield mask
    finally:
        with contextlib.suppress(OSError):  # a full disk has no room for the archive's end either
            if archive is not None:
                archive.close()
        with contextlib.suppress(OSError):
            unfinished.unlink(missing_ok=True)
