"""MultiCal's ``calibration.json``: ``cameras`` with their lenses, and ``camera_poses``.

A pose is world to camera, and the world is that of a master camera; ``a_to_b`` leads from camera b's axes to a's. A
fisheye is known by its four coefficients, one a row, as OpenCV gives them. Lengths are in the unit of the boards.
"""

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.cameras.rig import Camera, CameraRig, lens_of, rig_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.calibration_text import MOST_BYTES, Sizes, stated_metres
from mmocap_warp.formats.toml_table import is_number
from mmocap_warp.whole_file import read_json

_REMEDY = "give the calibration.json that multical calibrate writes"
_TO = "_to_"
_FISHEYE, _MAX_COEFFICIENTS = 4, 14


def read_multical(path: str | Path, units: str | None = None, up: str = "+z", sizes: Sizes = None) -> CameraRig:
    """Read a calibration. ``sizes`` is not needed."""
    file = read_json(path, _REMEDY, MOST_BYTES)
    if not {"cameras", "camera_poses"} <= set(file):
        raise InputError(path, "has no 'cameras' and 'camera_poses', by which MultiCal's calibration is known", _REMEDY)
    lenses = _check_object(file["cameras"], "cameras", path)
    poses = _world_poses(_check_object(file["camera_poses"], "camera_poses", path), lenses.keys(), path)
    metres = stated_metres(units, path)
    cameras = []
    for name, lens in lenses.items():
        if name not in poses:
            raise InputError(path, f"camera '{name}' has no pose", "calibrate where it stands, too, or take it out")
        pose = poses[name]
        cameras.append(_read_lens(lens, name, path)._replace(R=pose[:3, :3], t=pose[:3, 3] * metres))
    return rig_of(cameras, up, path)


def read_multical_lenses(path: str | Path, up: str, sizes: dict[str, tuple[int, int]]) -> CameraRig | None:
    """Read MultiCal's ``intrinsic.json``: cameras at the origin, or None for a file that has ``camera_poses``."""
    file = read_json(path, _REMEDY, MOST_BYTES)
    if "camera_poses" in file or "cameras" not in file:
        return None
    lenses = _check_object(file["cameras"], "cameras", path)
    return rig_of([_read_lens(lens, name, path) for name, lens in lenses.items()], up, path, placed=False)


def _read_lens(lens: Any, name: str, path: str | Path) -> Camera:
    where = f"{path}: camera '{name}'"
    values = _check_object(lens, "it", where)
    K = _numbers(values, "K", (9,), where).reshape(3, 3)
    width, height = _numbers(values, "image_size", (2,), where)
    coefficients = _numbers(values, "dist", tuple(range(4, _MAX_COEFFICIENTS + 1)), where)
    fisheye = len(coefficients) == _FISHEYE
    in_rows = all(isinstance(row, list) for row in values["dist"])
    if (fisheye and not in_rows) or coefficients[5:].any():
        problem = "its lens is neither MultiCal's standard one (5 coefficients) nor its fisheye (4, one a row)"
        raise InputError(where, problem, "calibrate it with one of these models")
    return lens_of(name, K, (int(width), int(height)), coefficients[:5], fisheye)


def _world_poses(poses: dict[str, Any], names: Collection[str], path: str | Path) -> dict[str, np.ndarray]:
    """(4, 4) world to camera, by camera; those that are given relative to another are multiplied by its pose."""
    known: dict[str, np.ndarray] = {}
    relative: dict[str, list[tuple[str, np.ndarray]]] = {name: [] for name in names}
    for key, value in poses.items():
        pose, where = np.eye(4), f"{path}: camera_poses '{key}'"
        fields = _check_object(value, "it", where)
        pose[:3, :3] = _numbers(fields, "R", (9,), where).reshape(3, 3)
        pose[:3, 3] = _numbers(fields, "T", (3,), where)
        if key in names:
            known[key] = pose
            continue
        camera, base = _pair(key, names, where)
        relative[base].append((camera, pose))
    reached = list(known)
    while reached:
        base = reached.pop()
        for camera, pose in relative[base]:
            if camera not in known:
                known[camera] = pose @ known[base]
                reached.append(camera)
    return known


def _pair(key: str, names: Collection[str], where: str) -> tuple[str, str]:
    """The two cameras of ``a_to_b``; their names may hold the same word."""
    parts = key.split(_TO)
    for k in range(1, len(parts)):
        camera, base = _TO.join(parts[:k]), _TO.join(parts[k:])
        if camera in names and base in names:
            return camera, base
    raise InputError(where, "names no camera of the file", _REMEDY)


def _check_object(value: Any, what: str, where: object) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(where, f"{what} is not a JSON object", _REMEDY)
    return value


def _numbers(values: dict[str, Any], key: str, count: tuple[int, ...], where: str) -> np.ndarray:
    """A list of finite numbers, whether in rows or not."""
    value = values.get(key)
    rows = value if isinstance(value, list) else []
    flat = [number for row in rows for number in (row if isinstance(row, list) else [row])]
    if len(flat) not in count or not all(map(is_number, flat)):
        length = " or ".join(map(str, count)) if len(count) < 3 else f"{count[0]} to {count[-1]}"
        raise InputError(where, f"{key} is not {length} numbers", _REMEDY)
    if not np.isfinite(flat).all():
        raise InputError(where, f"{key} holds a value that is not finite", _REMEDY)
    return np.array(flat, float)
