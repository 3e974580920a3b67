"""Masks that are kept: a mark beside undistorted ones says what they were made from; subtracted ones are made once.

Subtracting decodes the videos and is the slowest part of reading a recording; tracking, smoothing and drawing want the
same masks again. What is stored is what a camera's subtraction found at one scale, undistorted but not yet cleaned:
cleaning may depend on where the body was tracked. A file is ``.mmocap/<scene>/<camera>@<scale>.tar`` in the scene's
folder, with a PNG of one bit a frame. It is used only if all that its masks were made from is the same, and replaced
otherwise. Where it cannot be written, masks are made each time.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import tarfile
from collections.abc import Generator, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.formats.image_files import encode_png
from mmocap_warp.formats.toml_table import Table, load_toml, toml_value
from mmocap_warp.masks.mask_files import list_tar, read_member
from mmocap_warp.whole_file import whole_file, write_whole

MARK_NAME = "masks.toml"  # of the file, in the folder of a camera's masks


@dataclass(frozen=True)
class MaskMark:
    """What a camera's masks are of."""

    camera: str  # its name
    size: tuple[int, int]  # width and height of the masks [px]
    scale: float  # of the masks relative to the calibrated images
    calibrated_size: tuple[int, int]  # width and height of these [px]
    first_frame: int  # the recording's frame that the first mask is of
    # The camera's offset at that time, in the recording's frames; where it has changed, the masks move along.
    shift: int
    stride: int  # every how many-th frame has a mask
    repaired: bool  # whether the other views had a say in them
    calibration: str  # hash of what they were undistorted with, see :func:`calibration_hash`

    def write(self, folder: Path) -> None:
        """Put it beside the masks of ``folder``."""
        lines = [
            "# Written by mmocap mask: these masks are undistorted. They are read as they are, pixel for pixel the",
            "# pinhole camera of the same name in ../pinholes.toml, and never undistorted again.",
            *(f"{field.name} = {toml_value(getattr(self, field.name))}" for field in fields(self)),
            "",
        ]
        write_whole(folder / MARK_NAME, "\n".join(lines).encode())


def read_mark(masks: Path) -> MaskMark | None:
    """The mark beside a camera's masks, None where there is none: these are in the recorded video's pixels."""
    path = masks / MARK_NAME
    if not os.path.isfile(path):
        return None
    table = load_toml(path)
    kinds = {"str": str, "float": float, "int": int, "bool": bool}
    values: dict[str, Any] = {
        field.name: table.take(field.name, kinds[field.type]) if field.type in kinds else _take_size(table, field.name)
        for field in fields(MaskMark)
    }
    mark = MaskMark(**values)
    table.finish()
    if mark.stride < 1 or mark.first_frame < 0:
        raise table.error("stride is below 1 or first_frame below 0", "make the masks again with mmocap mask")
    if not 0 < mark.scale <= 1:
        raise table.error(f"scale = {mark.scale:g} is not in (0, 1]", "make the masks again with mmocap mask")
    return mark


def calibration_hash(
    rig: CameraRig, k: int, recorded_scale: float, recorded_offset: tuple[float, float], whole_rig: bool
) -> str:
    """A hash of what camera ``k``'s undistorted masks depend on: its lens, and its place in the recorded image.

    Masks of the ``whole_rig`` depend on the other cameras and on where all of them stand, as repaired ones do.
    """
    digest = hashlib.sha256()
    lens = [rig.K[k], rig.distortion[k], rig.size[k], [recorded_scale, *recorded_offset]]
    for values in lens + ([rig.K, rig.distortion, rig.size, rig.R, rig.t] if whole_rig else []):
        digest.update(np.ascontiguousarray(values, np.float64).tobytes())
    if bends := rig.fisheye if whole_rig else set(rig.fisheye) & {rig.names[k]}:
        digest.update(" ".join(bends).encode())
    return digest.hexdigest()


def _take_size(table: Table, key: str) -> tuple[int, int]:
    width, height = table.take_numbers(key, (2,))
    if width < 1 or height < 1:
        raise table.error(f"{key} is not a size", "make the masks again with mmocap mask")
    return int(width), int(height)


_KEY = "made_from"  # the first member's name; it holds the key


def stored_masks(path: Path, key: str, first: int, count: int) -> Iterator[np.ndarray | None] | None:
    """The masks of frames ``first`` to ``first + count - 1`` in a camera's file; None where they are not stored.

    Each is (height, width) bool, or None where the camera has no image. ``key`` says all that they were made from.
    """
    try:
        head, *members = list_tar(path)
        if head.name != _KEY or read_member(path, head).decode() != key:
            return None
        by_frame = {int(Path(member.name).stem): member for member in members}
    except (InputError, ValueError):  # not there, or not whole
        return None

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
    archive = _archive(path, key, count)
    next(archive, None)
    with contextlib.closing(archive):
        for mask in masks:
            with contextlib.suppress(StopIteration):  # all are stored, or there is no room
                archive.send(mask)
            yield mask


def _archive(path: Path, key: str, count: int) -> Generator[None, np.ndarray | None]:
    """Store masks of ``count`` frames as they are sent; it ends after the last one, or where there is no room."""
    with contextlib.suppress(OSError, InputError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as unfinished, tarfile.open(unfinished, "w") as archive:
            _add(archive, _KEY, key.encode())
            for frame in range(count):
                if (mask := (yield)) is not None:
                    _add(archive, f"{frame:06d}.png", encode_png(mask))


def _add(archive: tarfile.TarFile, name: str, data: bytes) -> None:
    member = tarfile.TarInfo(name)
    member.size = len(data)
    archive.addfile(member, io.BytesIO(data))
