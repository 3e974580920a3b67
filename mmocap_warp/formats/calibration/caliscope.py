"""Caliscope's own camera array: a table ``[cameras.<number>]`` for each camera, lengths in metres.

A camera is named ``cam_<number>``, as in the file for other programs that Caliscope writes.
"""

from __future__ import annotations

from mmocap_warp.cameras.rig import Camera
from mmocap_warp.formats.calibration.toml_camera import take_camera, take_lens
from mmocap_warp.formats.toml_table import Table

_NOT_READ = ("cam_id", "port", "rotation_count", "error", "exposure", "grid_count", "name")
"""What a camera's table may hold beside its calibration; ``rotation_count`` turns what Caliscope shows, no more."""
_REMEDY = "calibrate where the cameras stand, too, with Caliscope (its extrinsic calibration)"


def take_cameras(file: Table) -> list[Camera]:
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
        raise tables.error("no camera has a rotation and a translation", _REMEDY)
    return cameras


def take_lenses(tables: dict[str, Table]) -> list[Camera]:
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
