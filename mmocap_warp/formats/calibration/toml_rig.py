"""Calibrations in TOML: the one of aniposelib and Pose2Sim, a table a camera, and Caliscope's own, told by its table
``cameras``."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.cameras.rig import Camera, CameraRig, rig_of
from mmocap_warp.formats.calibration.calibration_text import METRES, refuse_huge
from mmocap_warp.formats.toml_table import Table, is_number, load_toml, quoted
from mmocap_warp.whole_file import write_whole


def read_toml_rig(
    path: str | Path, units: str | None = None, up: str = "+z", sizes: dict[str, tuple[int, int]] | None = None
) -> CameraRig:
    """Read a calibration; ``units`` are those of its translations (Pose2Sim writes "m", which is taken where nobody
    says; aniposelib has its board's, often "mm"; Caliscope's are metres). ``sizes`` is not needed.

    Each table holds ``name`` (else the table's own), ``size``, ``matrix``, ``distortions`` (4 or 5), ``rotation``
    (Rodrigues, world to camera), ``translation`` and optionally ``fisheye``, with which the 4 ``distortions`` are those
    of OpenCV's fisheye model; ``[metadata]`` is not read.

    Raises:
        InputError: see :func:`~mmocap_warp.formats.toml_table.load_toml` and
            :func:`~mmocap_warp.cameras.rig.check_rig`.
    """
    refuse_huge(path)
    file = load_toml(path)
    if isinstance(file.peek("cameras"), dict):
        return rig_of(_take_caliscope_cameras(file), up, path)
    tables = file.take_tables()
    tables.pop("metadata", None)
    file.finish()
    return rig_of([_read_camera(table, METRES[units or "m"]) for table in tables.values()], up, path)


def read_toml_lenses(path: str | Path, up: str, sizes: dict[str, tuple[int, int]]) -> CameraRig | None:
    """Read a file as :func:`read_toml_rig` does, of which no camera has a rotation or a translation.

    Returns:
        Cameras at the origin; None where one has.

    Raises:
        InputError: as there.
    """
    refuse_huge(path)
    file = load_toml(path)
    of_caliscope = isinstance(file.peek("cameras"), dict)
    tables = (file.take_table("cameras") if of_caliscope else file).take_tables()
    tables.pop("metadata", None)
    if not tables or any(table.has("rotation") or table.has("translation") for table in tables.values()):
        return None
    if of_caliscope:
        return rig_of(_take_caliscope_lenses(tables), up, path, placed=False)
    file.finish()
    return rig_of([_read_lens(table) for table in tables.values()], up, path, placed=False)


def _read_lens(table: Table) -> Camera:
    lens = take_lens(table, table.take("name", str, table.name))
    table.finish()
    return lens


def _read_camera(table: Table, metres: float) -> Camera:
    camera = take_camera(table, table.take("name", str, table.name), metres)
    table.finish()
    return camera


def write_toml_rig(path: str | Path, rig: CameraRig, offsets: dict[str, float] | None = None) -> None:
    """Write ``rig`` in metres, to be read by :func:`read_toml_rig`, Pose2Sim and aniposelib.

    Args:
        path: the file.
        rig: the cameras.
        offsets: how much later than others cameras show what happens [s], by name. They stand in ``[metadata]`` for
            people to read: times are the scene file's.
    """
    lines = []
    for k, name in enumerate(rig.names):
        fisheye = name in rig.fisheye
        lines += [
            f"[{quoted(name)}]",
            f"name = {quoted(name)}",
            f"size = {[float(v) for v in rig.size[k]]}",
            f"matrix = {rig.K[k].tolist()}",
            f"distortions = {rig.distortion[k, : 4 if fisheye else 5].tolist()}",
            f"rotation = {cv2.Rodrigues(rig.R[k])[0].ravel().tolist()}",
            f"translation = {rig.t[k].tolist()}",
            f"fisheye = {str(fisheye).lower()}",
            "",
        ]
    lines += ["[metadata]", "adjusted = false", "error = 0.0"]
    if offsets:
        lines.append(f"offsets = {{ {', '.join(f'{quoted(name)} = {value}' for name, value in offsets.items())} }}")
    lines.append("")
    write_whole(Path(path), "\n".join(lines).encode())


_NOT_READ = ("cam_id", "port", "rotation_count", "error", "exposure", "grid_count", "name")
"""What a camera's table may hold beside its calibration; ``rotation_count`` turns what Caliscope shows, no more."""
_CALIBRATE_PLACES = "calibrate where the cameras stand, too, with Caliscope (its extrinsic calibration)"


def _take_caliscope_cameras(file: Table) -> list[Camera]:
    """The cameras that Caliscope knows the place of and was not told to ignore.

    Args:
        file: the file's table, of which ``cameras`` is taken.

    Raises:
        InputError: a value that is missing or wrong, or no camera with a place.
    """
    cameras = []
    tables = file.take_table("cameras")
    for number, table in tables.take_tables().items():
        ignored = table.take("ignore", bool, False)
        if ignored or not (table.has("rotation") or table.has("translation")):
            continue
        _take_unread(table)
        cameras.append(take_camera(table, f"cam_{number}", 1.0))
        table.finish()
    tables.finish()
    if not cameras:
        raise tables.error("no camera has a rotation and a translation", _CALIBRATE_PLACES)
    return cameras


def _take_caliscope_lenses(tables: dict[str, Table]) -> list[Camera]:
    """The lenses of cameras that Caliscope knows no place of, without those that it was told to ignore or has not seen.

    Args:
        tables: of the cameras, by number.

    Raises:
        InputError: a value that is missing or wrong.
    """
    lenses = []
    for number, table in tables.items():
        if not table.take("ignore", bool, False) and table.has("matrix"):
            _take_unread(table)
            lenses.append(take_lens(table, f"cam_{number}"))
            table.finish()
    return lenses


def _take_unread(table: Table) -> None:
    for key in _NOT_READ:
        table.take_any(key, (str, int, float, bool), None)


def take_camera(table: Table, name: str, metres: float) -> Camera:
    """A camera of its lens, see :func:`take_lens`, ``rotation`` (Rodrigues or 3x3, world to camera) and
    ``translation``; lengths are of so many ``metres``.

    Raises:
        InputError: one of them is missing or wrong.
    """
    lens = take_lens(table, name)
    translation = np.array(_take_flat(table, "translation", (3,)))
    return lens._replace(R=_take_rotation(table), t=translation * metres)


def take_lens(table: Table, name: str) -> Camera:
    """A camera without a place, of its ``size``, ``matrix``, ``distortions`` (4 or 5; 4 of a fisheye) and optionally
    ``fisheye``.

    Raises:
        InputError: one of them is missing or wrong.
    """
    width, height = table.take_numbers("size", (2,))
    fisheye = table.take("fisheye", bool, False)
    K = _take_matrix(table, "matrix", "give [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    coefficients = _take_flat(table, "distortions", (4,) if fisheye else (4, 5))
    distortion = np.zeros(5)
    distortion[: len(coefficients)] = coefficients
    return Camera(name, K, np.eye(3), np.zeros(3), (int(width), int(height)), distortion, fisheye)


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
