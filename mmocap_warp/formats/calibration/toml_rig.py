"""Calibrations in TOML: that of aniposelib and Pose2Sim, a table for each camera, and Caliscope's own camera array,
whose tables are below ``cameras`` and whose lengths are metres."""

from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.cameras.rig import METRES, Camera, CameraRig, lens_of, rig_of
from mmocap_warp.formats.calibration.calibration_text import Sizes
from mmocap_warp.formats.toml_table import Table, is_number, load_toml, quoted, toml_value
from mmocap_warp.whole_file import write_whole

_UNREAD = ("cam_id", "port", "rotation_count", "error", "exposure", "grid_count", "name")
"""What Caliscope's table of a camera may hold beside its calibration; ``rotation_count`` only turns what it shows."""

_OF_FREEMOCAP = ("world_position", "world_orientation")  # which follow from the calibration


def read_toml_rig(path: str | Path, units: str | None = None, up: str = "+z", sizes: Sizes = None) -> CameraRig:
    """Read a calibration; ``units`` are those of its translations: Pose2Sim writes "m", which is the default;
    aniposelib writes its board's, often "mm"; Caliscope's are metres. ``sizes`` is not needed.

    Each table holds ``name`` (else the table's own), ``size``, ``matrix``, ``distortions`` (4 or 5), ``rotation``
    (Rodrigues, world to camera), ``translation`` and optionally ``fisheye``, with which the 4 ``distortions`` are those
    of OpenCV's fisheye model; ``[metadata]`` is not read. Caliscope's cameras are named ``cam_<number>``, as in its
    file for other programs; those without a place, and those that it was told to ignore, are left out.
    """
    file, tables = _camera_tables(path)
    file.finish()
    cameras = _take_cameras(file, tables, 1.0 if file.name else METRES[units or "m"])
    if file.name and not cameras:
        remedy = "calibrate where the cameras stand, too, with Caliscope (its extrinsic calibration)"
        raise file.error("no camera has a rotation and a translation", remedy)
    return rig_of(cameras, up, path)


def read_toml_lenses(path: str | Path, up: str, sizes: dict[str, tuple[int, int]]) -> CameraRig | None:
    """Read lenses alone: cameras at the origin, or None where a camera has a rotation or a translation."""
    file, tables = _camera_tables(path)
    if not tables or any(table.has("rotation") or table.has("translation") for table in tables.values()):
        return None
    file.finish()
    return rig_of(_take_cameras(file, tables, None), up, path, placed=False)


def _camera_tables(path: str | Path) -> tuple[Table, dict[str, Table]]:
    """The table that holds a table for each camera, and these: Caliscope's ``cameras``, or else the file itself."""
    file = load_toml(path)
    if isinstance(file.peek("cameras"), dict):
        file = file.take_table("cameras")
    tables = file.take_tables()
    tables.pop("metadata", None)
    return file, tables


def _take_cameras(file: Table, tables: dict[str, Table], metres: float | None) -> list[Camera]:
    """The cameras with their places in units of ``metres``; without them where ``metres`` is None."""
    cameras = []
    for key, table in tables.items():
        name = f"cam_{key}" if file.name else table.take("name", str, key)
        if file.name:
            needed = ("rotation", "translation") if metres is not None else ("matrix",)
            if table.take("ignore", bool, False) or not any(map(table.has, needed)):
                continue
        for unread in _UNREAD if file.name else _OF_FREEMOCAP:
            table.take_any(unread, (str, int, float, bool, list), None)
        cameras.append(_take_camera(table, name, metres))
        table.finish()
    return cameras


def _take_camera(table: Table, name: str, metres: float | None) -> Camera:
    width, height = table.take_numbers("size", (2,))
    fisheye = table.take("fisheye", bool, False)
    K = _take_matrix(table, "matrix", "give [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    coefficients = _take_flat(table, "distortions", (4,) if fisheye else (4, 5))
    lens = lens_of(name, K, (int(width), int(height)), coefficients, fisheye)
    if metres is None:
        return lens
    return lens._replace(t=np.array(_take_flat(table, "translation", (3,))) * metres, R=_take_rotation(table))


def write_toml_rig(path: str | Path, rig: CameraRig, offsets: dict[str, float] | None = None) -> None:
    """Write ``rig`` in metres, to be read by :func:`read_toml_rig`, Pose2Sim and aniposelib.

    By ``offsets`` [s] cameras show later than others what happens, by name. They stand in ``[metadata]`` for people to
    read: times are the scene file's.
    """
    lines = []
    for k, name in enumerate(rig.names):
        fisheye = name in rig.fisheye
        values = {"name": name, "size": [float(v) for v in rig.size[k]], "matrix": rig.K[k].tolist()}
        values |= {"distortions": rig.distortion[k, : 4 if fisheye else 5].tolist()}
        values |= {"rotation": cv2.Rodrigues(rig.R[k])[0].ravel().tolist(), "translation": rig.t[k].tolist()}
        values |= {"fisheye": fisheye}
        lines += [f"[{quoted(name)}]", *(f"{key} = {toml_value(value)}" for key, value in values.items()), ""]
    lines += ["[metadata]", "adjusted = false", "error = 0.0"]
    if offsets:
        lines.append(f"offsets = {{ {', '.join(f'{quoted(name)} = {value}' for name, value in offsets.items())} }}")
    lines.append("")
    write_whole(Path(path), "\n".join(lines).encode())


def _take_matrix(table: Table, key: str, remedy: str) -> np.ndarray:
    rows = table.take(key, list)
    good = len(rows) == 3 and all(isinstance(row, list) and len(row) == 3 for row in rows)
    if not good or not all(is_number(v) for row in rows for v in row):
        raise table.error(f"{key} is not 3 rows of 3 numbers", remedy)
    return np.array(rows, float)


def _take_flat(table: Table, key: str, count: tuple[int, ...]) -> list[float]:
    """Numbers as OpenCV's row or column, too: within one more list, or each in one of its own."""
    value = table.peek(key)
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        table.replace(key, [number for row in value for number in row])
    return table.take_numbers(key, count)


def _take_rotation(table: Table) -> np.ndarray:
    value = table.peek("rotation")
    if isinstance(value, list) and len(value) == 3 and all(isinstance(row, list) and len(row) == 3 for row in value):
        return _take_matrix(table, "rotation", "give a Rodrigues vector, world to camera")
    return cv2.Rodrigues(np.array(_take_flat(table, "rotation", (3,))))[0]
