"""What the TOML calibrations of aniposelib, Pose2Sim and Caliscope have in common: how they write a camera."""

from __future__ import annotations

import cv2
import numpy as np

from mmocap_warp.cameras.rig import Camera
from mmocap_warp.formats.toml_table import Table, is_number


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
