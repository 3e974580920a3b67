"""A file beside undistorted masks that says what they were made from, so that they are not undistorted twice."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.formats.toml_table import Table, load_toml, toml_value
from mmocap_warp.whole_file import write_whole

MARK_NAME = "masks.toml"
"""Of the file, in the folder of a camera's masks."""


@dataclass(frozen=True)
class MaskMark:
    """What a camera's masks are of.

    Attributes:
        camera: its name.
        size: width and height of the masks [px].
        scale: of the masks relative to the calibrated images.
        calibrated_size: width and height of these [px].
        first_frame: the recording's frame that the first mask is of.
        shift: the camera's offset at that time, in the recording's frames; where it has changed, the masks move along.
        stride: every how many-th frame has a mask.
        repaired: whether the other views had a say in them.
        calibration: hash of what they were undistorted with, see :func:`calibration_hash`.
    """

    camera: str
    size: tuple[int, int]
    scale: float
    calibrated_size: tuple[int, int]
    first_frame: int
    shift: int
    stride: int
    repaired: bool
    calibration: str

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
