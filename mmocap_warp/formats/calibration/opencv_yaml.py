"""Calibrations in OpenCV's YAML as EasyMocap writes them: ``intri.yml`` beside ``extri.yml``.

They are read with PyYAML, as text only, and not with OpenCV: of a damaged file OpenCV's own reader takes the size of a
matrix at its word, allocates that much, and does not always come back.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.units import METRES
from mmocap_warp.views.rig import Camera, CameraRig, rig_of

_MOST_BYTES = 2**20  # a camera takes about a thousand
_TYPES = {"d": np.float64, "f": np.float32, "i": np.int32, "s": np.int16, "w": np.uint16, "c": np.int8, "u": np.uint8}
_NOT_FINITE = {".nan": np.nan, ".inf": np.inf, "-.inf": -np.inf}


def read_opencv_yaml(
    path: str | Path, units: str = "m", up: str = "+z", sizes: dict[str, tuple[int, int]] | None = None
) -> CameraRig:
    """Read the pair from its folder, or from the path of either file.

    ``names`` lists the cameras; of each, ``K_<name>``, ``dist_<name>`` (4 or 5) and optionally ``H_<name>``,
    ``W_<name>`` come from ``intri.yml``; ``Rot_<name>`` (3x3) or else ``R_<name>`` (Rodrigues) and ``T_<name>`` from
    ``extri.yml``. ``sizes`` holds (width, height) of cameras for which the file gives none.

    Raises:
        InputError: unreadable, entries missing, or not a calibration (see ``check_rig``).
    """
    folder = Path(path) if os.path.isdir(path) else Path(path).parent
    intrinsics, extrinsics = _File(folder / "intri.yml"), _File(folder / "extri.yml")
    cameras = [_read_camera(intrinsics, extrinsics, name, sizes or {}) for name in intrinsics.names()]
    cameras = [camera._replace(t=camera.t * METRES[units]) for camera in cameras]
    return rig_of(cameras, up, folder / "intri.yml")


class _Text(yaml.BaseLoader):
    """Gives every value as the text it is written as; which kind of number it is, the reader knows."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):  # a few of them, in each other, are worth gigabytes
            raise yaml.YAMLError("it refers to another of its values, which a calibration does not")
        return super().compose_node(parent, index)


class _File:
    """A file's entries.

    Args:
        path: the file.

    Raises:
        InputError: it is missing or no YAML of OpenCV.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._entries = _entries(path)

    def __contains__(self, key: str) -> bool:
        return key in self._entries

    def names(self) -> list[str]:
        """The cameras."""
        names = self._entries.get("names")
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise InputError(self.path, "names is not a list of cameras", "add names, the cameras one a line")
        return names

    def number(self, key: str) -> int:
        """A whole number from 1 to a million."""
        value = _number(self._entries[key])
        if not 1 <= value <= 1e6:
            raise InputError(self.path, f"{key} = {self._entries[key]!r} is no size", "give the image size in pixels")
        return int(value)

    def matrix(self, key: str, count: tuple[int, ...]) -> np.ndarray:
        """The values of a matrix, row by row, as many as one of ``count`` says."""
        entry = self._entries.get(key)
        entry = entry if isinstance(entry, dict) else {}
        data, kind = entry.get("data"), str(entry.get("dt", "")).lstrip("1")
        stated = _number(entry.get("rows")) * _number(entry.get("cols"))
        if not isinstance(data, list) or len(data) not in count or len(data) != stated or kind not in _TYPES:
            length = " or ".join(map(str, count))
            raise InputError(self.path, f"{key} is not a matrix of {length} numbers", f"add {key}")
        values = [_number(value) for value in data]
        if not np.isfinite(values).all():
            raise InputError(self.path, f"{key} holds a value that is not finite", "calibrate again or export again")
        with np.errstate(over="ignore"):  # a number too large for its type, which the rig's checks tell
            return np.array(values).astype(_TYPES[kind]).astype(np.float64)


def _entries(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(path, f"has over {_MOST_BYTES >> 20} MB", "give a calibration of cameras")
        header, _, text = path.read_text(encoding="utf-8").partition("\n")
        entries = yaml.load(text, _Text) if header.startswith("%YAML") else None
    except FileNotFoundError:
        raise InputError(path, "no such file", "intri.yml and extri.yml belong in one folder") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read ({error})", "give an OpenCV YAML file") from None
    except RecursionError:
        raise InputError(path, "has values within each other, too deep", "write the calibration again") from None
    except yaml.YAMLError as error:
        raise InputError(path, f"is not valid YAML: {' '.join(str(error).split())}", "correct that line") from None
    if not isinstance(entries, dict):
        raise InputError(path, "is not an OpenCV YAML file", "its first line must be %YAML:1.0")
    return entries


def _number(text: Any) -> float:
    """The number that a text is; NaN where it is none."""
    if not isinstance(text, str):
        return np.nan
    try:
        return _NOT_FINITE[text.lower()] if text.lower() in _NOT_FINITE else float(text)
    except ValueError:
        return np.nan


def _read_camera(intrinsics: _File, extrinsics: _File, name: str, sizes: dict[str, tuple[int, int]]) -> Camera:
    K = intrinsics.matrix(f"K_{name}", (9,)).reshape(3, 3)
    coefficients = intrinsics.matrix(f"dist_{name}", (4, 5))
    distortion = np.zeros(5)
    distortion[: len(coefficients)] = coefficients
    if f"Rot_{name}" in extrinsics:
        R = extrinsics.matrix(f"Rot_{name}", (9,)).reshape(3, 3)
    else:
        R = cv2.Rodrigues(extrinsics.matrix(f"R_{name}", (3,)))[0]
    t = extrinsics.matrix(f"T_{name}", (3,))
    if f"W_{name}" in intrinsics and f"H_{name}" in intrinsics:
        size = (intrinsics.number(f"W_{name}"), intrinsics.number(f"H_{name}"))
    elif name in sizes:
        size = sizes[name]
    else:
        raise InputError(intrinsics.path, f"W_{name} and H_{name} are missing", "add the image size in pixels")
    return Camera(name, K, R, t, size, distortion)
