"""Calibrations in OpenCV's YAML as EasyMocap writes them: ``intri.yml`` beside ``extri.yml``.

They are read with PyYAML, as text only, and not with OpenCV: its reader trusts the size of a matrix that a damaged file
states, allocates that much, and may never return.
"""

import os
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from mmocap_warp.cameras.rig import METRES, Camera, CameraRig, lens_of, rig_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.calibration_text import Sizes, image_size_of, number_of, read_short_text
from mmocap_warp.whole_file import write_whole

_DTYPES = {"d": np.float64, "f": np.float32, "i": np.int32, "s": np.int16, "w": np.uint16, "c": np.int8, "u": np.uint8}
_HEADER = "%YAML:1.0\n---\n"


def read_opencv_yaml(path: str | Path, units: str | None = None, up: str = "+z", sizes: Sizes = None) -> CameraRig:
    """Read the pair from its folder, or from the path of either file.

    ``names`` lists the cameras; of each, ``K_<name>``, ``dist_<name>`` (4 or 5) and optionally ``H_<name>``,
    ``W_<name>`` come from ``intri.yml``; ``Rot_<name>`` (3x3) or else ``R_<name>`` (Rodrigues) and ``T_<name>`` from
    ``extri.yml``. ``units`` are metres if they are not given. ``sizes`` holds (width, height) of cameras without them.
    """
    folder = Path(path) if os.path.isdir(path) else Path(path).parent
    intrinsics, extrinsics = _File(folder / "intri.yml"), _File(folder / "extri.yml")
    cameras = []
    for name in intrinsics.names():
        lens = _read_lens(intrinsics, name, sizes)
        if f"Rot_{name}" in extrinsics:
            R = extrinsics.matrix(f"Rot_{name}", (9,)).reshape(3, 3)
        else:
            R = cv2.Rodrigues(extrinsics.matrix(f"R_{name}", (3,)))[0]
        cameras.append(lens._replace(R=R, t=extrinsics.matrix(f"T_{name}", (3,)) * METRES[units or "m"]))
    return rig_of(cameras, up, folder / "intri.yml")


def read_yaml_lenses(path: str | Path, up: str, sizes: dict[str, tuple[int, int]]) -> CameraRig | None:
    """Read ``intri.yml`` alone: cameras at the origin, or None where ``extri.yml`` lies beside it."""
    folder = Path(path) if os.path.isdir(path) else Path(path).parent
    if os.path.exists(folder / "extri.yml"):
        return None
    intrinsics = _File(folder / "intri.yml")
    lenses = [_read_lens(intrinsics, name, sizes) for name in intrinsics.names()]
    return rig_of(lenses, up, folder / "intri.yml", placed=False)


class _Text(yaml.BaseLoader):
    """Gives every value as the text it is written as; which kind of number it is, the reader knows."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):  # a few of them, in each other, are worth gigabytes
            raise yaml.YAMLError("it contains an alias (*name), which a calibration must not have")
        return super().compose_node(parent, index)


class _File:
    """A file's entries."""

    def __init__(self, path: Path) -> None:
        self.path = path
        header, _, text = read_short_text(path, "intri.yml and extri.yml in one folder").partition("\n")
        try:
            entries = yaml.load(text, _Text) if header.startswith("%YAML") else None
        except RecursionError:
            raise InputError(path, "is nested too deeply", "write the calibration again") from None
        except yaml.YAMLError as error:
            raise InputError(path, f"is not valid YAML: {' '.join(str(error).split())}", "correct that line") from None
        if not isinstance(entries, dict):
            raise InputError(path, "is not an OpenCV YAML file", "its first line must be %YAML:1.0")
        self._entries: dict[str, Any] = entries

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
        value = number_of(self._entries[key])
        if not 1 <= value <= 1e6:
            raise InputError(self.path, f"{key} = {self._entries[key]!r} is no size", "give the image size in pixels")
        return int(value)

    def matrix(self, key: str, count: tuple[int, ...]) -> np.ndarray:
        """The values of a matrix, row by row, as many as one of ``count`` says."""
        entry = self._entries.get(key)
        entry = entry if isinstance(entry, dict) else {}
        data, kind = entry.get("data"), str(entry.get("dt", "")).lstrip("1")
        stated = number_of(entry.get("rows")) * number_of(entry.get("cols"))
        if not isinstance(data, list) or len(data) not in count or len(data) != stated or kind not in _DTYPES:
            length = " or ".join(map(str, count))
            raise InputError(self.path, f"{key} is not a matrix of {length} numbers", f"write {length} numbers")
        values = [number_of(value) for value in data]
        if not np.isfinite(values).all():
            raise InputError(self.path, f"{key} holds a value that is not finite", "calibrate again or export again")
        with np.errstate(over="ignore"):  # a number too large for its type, which the rig's checks tell
            return np.array(values).astype(_DTYPES[kind]).astype(np.float64)


def _read_lens(intrinsics: _File, name: str, sizes: Sizes) -> Camera:
    K = intrinsics.matrix(f"K_{name}", (9,)).reshape(3, 3)
    coefficients = intrinsics.matrix(f"dist_{name}", (4, 5))
    if f"W_{name}" in intrinsics and f"H_{name}" in intrinsics:
        size = (intrinsics.number(f"W_{name}"), intrinsics.number(f"H_{name}"))
    else:
        size = image_size_of(sizes, name, intrinsics.path, f"W_{name} and H_{name} are missing")
    return lens_of(name, K, size, coefficients)


def write_opencv_yaml(path: str | Path, rig: CameraRig) -> None:
    """Write ``intri.yml`` at ``path`` and ``extri.yml`` beside it, in metres, as EasyMocap and OpenCV read them.

    Raises:
        InputError: a fisheye, which the format cannot tell from another lens; a name that is no key of OpenCV's; files
            that cannot be written.
    """
    if rig.fisheye:
        remedy = "write .toml, cameras.txt or USD, which can"
        raise InputError(path, f"these files cannot say that '{rig.fisheye[0]}' is a fisheye", remedy)
    names = "names:\n" + "".join(f'  - "{name}"\n' for name in rig.names)
    inside, outside = [_HEADER, names], [_HEADER, names]
    for k, name in enumerate(rig.names):
        if re.fullmatch(r"[\w-]+", name, re.ASCII) is None:
            raise InputError(path, f"OpenCV's YAML allows no camera name '{name}'", "use letters, digits, _ and -")
        inside += [_matrix_text(f"K_{name}", rig.K[k]), _matrix_text(f"dist_{name}", rig.distortion[k : k + 1])]
        inside += [f"W_{name}: {rig.size[k, 0]}\n", f"H_{name}: {rig.size[k, 1]}\n"]
        outside += [_matrix_text(f"R_{name}", cv2.Rodrigues(rig.R[k])[0]), _matrix_text(f"Rot_{name}", rig.R[k])]
        outside += [_matrix_text(f"T_{name}", rig.t[k][:, None])]
    write_whole(Path(path).with_name("extri.yml"), "".join(outside).encode())
    write_whole(Path(path), "".join(inside).encode())


def _matrix_text(key: str, values: np.ndarray) -> str:
    rows, columns = values.shape
    data = ", ".join(f"{value!r}" for value in values.ravel().tolist())
    return f"{key}: !!opencv-matrix\n  rows: {rows}\n  cols: {columns}\n  dt: d\n  data: [ {data} ]\n"
