"""Calibrations in TOML: the one of aniposelib and Pose2Sim, a table a camera, and Caliscope's own, told by its table
``cameras``."""

from __future__ import annotations

from pathlib import Path

import cv2

from mmocap_warp.cameras.rig import Camera, CameraRig, rig_of
from mmocap_warp.formats.calibration import caliscope
from mmocap_warp.formats.calibration.text import refuse_huge
from mmocap_warp.formats.calibration.toml_camera import take_camera, take_lens
from mmocap_warp.formats.calibration.units import METRES
from mmocap_warp.formats.toml_table import Table, load_toml, quoted
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
        return rig_of(caliscope.take_cameras(file), up, path)
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
        return rig_of(caliscope.take_lenses(tables), up, path, placed=False)
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
