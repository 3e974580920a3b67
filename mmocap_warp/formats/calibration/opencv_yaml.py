"""Calibrations in OpenCV's YAML as EasyMocap writes them: ``intri.yml`` beside ``extri.yml``."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.units import METRES
from mmocap_warp.views.rig import Camera, CameraRig, rig_of


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
    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    intrinsics, extrinsics = _open(folder / "intri.yml"), _open(folder / "extri.yml")
    names_node = intrinsics.getNode("names")
    names = tuple(names_node.at(i).string() for i in range(names_node.size())) if names_node.isSeq() else ()
    cameras = [_read_camera(intrinsics, extrinsics, name, folder, sizes or {}) for name in names]
    cameras = [camera._replace(t=camera.t * METRES[units]) for camera in cameras]
    return rig_of(cameras, up, folder / "intri.yml")


def _open(path: Path) -> cv2.FileStorage:
    if not path.is_file():
        raise InputError(path, "no such file", "intri.yml and extri.yml belong in one folder")
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    except (cv2.error, SystemError):
        storage = None
    if storage is None or not storage.isOpened():
        raise InputError(path, "is not an OpenCV YAML file", "its first line must be %YAML:1.0")
    return storage


def _read_camera(
    intrinsics: cv2.FileStorage,
    extrinsics: cv2.FileStorage,
    name: str,
    folder: Path,
    sizes: dict[str, tuple[int, int]],
) -> Camera:
    def matrix(storage: cv2.FileStorage, file: str, key: str, count: tuple[int, ...]) -> np.ndarray:
        value = storage.getNode(key).mat()
        if value is None or value.size not in count:
            length = " or ".join(map(str, count))
            raise InputError(folder / file, f"{key} is not a matrix of {length} numbers", f"add {key}")
        return np.asarray(value, np.float64)

    K = matrix(intrinsics, "intri.yml", f"K_{name}", (9,)).reshape(3, 3)
    coefficients = matrix(intrinsics, "intri.yml", f"dist_{name}", (4, 5)).ravel()
    distortion = np.zeros(5)
    distortion[: len(coefficients)] = coefficients
    if extrinsics.getNode(f"Rot_{name}").empty():
        R = cv2.Rodrigues(matrix(extrinsics, "extri.yml", f"R_{name}", (3,)).ravel())[0]
    else:
        R = matrix(extrinsics, "extri.yml", f"Rot_{name}", (9,)).reshape(3, 3)
    t = matrix(extrinsics, "extri.yml", f"T_{name}", (3,)).ravel()
    width, height = (intrinsics.getNode(f"{axis}_{name}") for axis in "WH")
    if not (width.empty() or height.empty()):
        size = (int(width.real()), int(height.real()))
    elif name in sizes:
        size = sizes[name]
    else:
        raise InputError(folder / "intri.yml", f"W_{name} and H_{name} are missing", "add the image size in pixels")
    return Camera(name, K, R, t, size, distortion)
