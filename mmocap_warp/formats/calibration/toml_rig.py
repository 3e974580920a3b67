"""The TOML calibration of aniposelib and Pose2Sim: a table per camera, rotations as Rodrigues vectors."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.formats.calibration.units import METRES
from mmocap_warp.formats.toml_table import Table, is_number, load_toml
from mmocap_warp.views.rig import Camera, CameraRig, rig_of
from mmocap_warp.whole_file import write_whole


def read_toml_rig(
    path: str | Path, units: str = "m", up: str = "+z", sizes: dict[str, tuple[int, int]] | None = None
) -> CameraRig:
    """Read a calibration; ``units`` are those of its translations (Pose2Sim writes "m", aniposelib often "mm").
    ``sizes`` is not needed.

    Each table holds ``name`` (else the table's own), ``size``, ``matrix``, ``distortions`` (4 or 5), ``rotation``
    (Rodrigues, world to camera), ``translation`` and optionally ``fisheye = false``; ``[metadata]`` is not read.

    Raises:
        InputError: see :func:`~mmocap_warp.formats.toml_table.load_toml` and
            :func:`~mmocap_warp.views.rig.check_rig`; also for fisheye lenses.
    """
    file = load_toml(path)
    tables = file.take_tables()
    tables.pop("metadata", None)
    file.finish()
    return rig_of([_read_camera(table, METRES[units]) for table in tables.values()], up, path)


def _read_camera(table: Table, metres: float) -> Camera:
    name = table.take("name", str, table.name)
    width, height = table.take_numbers("size", (2,))
    rows = table.take("matrix", list)
    good = len(rows) == 3 and all(isinstance(row, list) and len(row) == 3 for row in rows)
    if not good or not all(is_number(v) for row in rows for v in row):
        raise table.error("matrix is not 3 rows of 3 numbers", "give [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    distortion = np.zeros(5)
    coefficients = table.take_numbers("distortions", (4, 5))
    distortion[: len(coefficients)] = coefficients
    rotation = np.array(table.take_numbers("rotation", (3,)))
    translation = np.array(table.take_numbers("translation", (3,)))
    if table.take("fisheye", bool, False):
        raise table.error("fisheye lenses are not supported", "undistort the images first and calibrate the result")
    table.finish()
    R = cv2.Rodrigues(rotation)[0]
    return Camera(name, np.array(rows, float), R, translation * metres, (int(width), int(height)), distortion)


def write_toml_rig(path: str | Path, rig: CameraRig) -> None:
    """Write ``rig`` in metres, to be read by :func:`read_toml_rig`, Pose2Sim and aniposelib."""
    lines = []
    for k, name in enumerate(rig.names):
        lines += [
            f'["{name}"]',
            f'name = "{name}"',
            f"size = {[float(v) for v in rig.size[k]]}",
            f"matrix = {rig.K[k].tolist()}",
            f"distortions = {rig.distortion[k].tolist()}",
            f"rotation = {cv2.Rodrigues(rig.R[k])[0].ravel().tolist()}",
            f"translation = {rig.t[k].tolist()}",
            "fisheye = false",
            "",
        ]
    lines += ["[metadata]", "adjusted = false", "error = 0.0", ""]
    write_whole(Path(path), "\n".join(lines).encode())
