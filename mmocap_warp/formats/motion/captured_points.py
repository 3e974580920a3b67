"""Points over time from ``.trc`` (OpenSim, Pose2Sim) and ``.c3d`` (motion capture systems)."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mmocap_warp.errors import InputError, input_errors, needs_package
from mmocap_warp.formats.sandbox import sandboxed
from mmocap_warp.result.other_world import axes_turn
from mmocap_warp.whole_file import read_text

_MOST = 1e9  # of a rate, and of a frame's number
_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}


@dataclass(frozen=True)
class PointTracks:
    """Named points over time."""

    rate: float  # frames per second
    frame_numbers: np.ndarray  # (frame,) int, as the file numbers them (usually from 1)
    names: tuple[str, ...]  # one per point
    positions: np.ndarray  # (frame, point, 3) float64 [m]; NaN where the file has none


def read_trc(path: str | Path, axes: str = "xyz") -> PointTracks:
    """Read a file; ``axes`` says which of its axes are the world's x, y and z.

    Pose2Sim writes Y-up files: with a Z-up calibration that is ``zxy``. An axis may be negated: ``x-zy``. Raises an
    InputError for an unreadable file, no ``.trc``, or axes that are no right-handed permutation.
    """
    turn = axes_turn(axes) if re.fullmatch("(-?[xyz]){3}", axes) else np.zeros((3, 3))
    if round(float(np.linalg.det(turn))) != 1:
        remedy = "write for example 'zxy' or 'x-zy'"
        raise InputError(path, f"axes = {axes!r} is not a right-handed order of x, y, z", remedy)
    lines = read_text(path, "give an OpenSim .trc file").splitlines()
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise InputError(path, "is not a .trc file (no PathFileType header)", "give an OpenSim .trc file")
    fields = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    names = tuple(name.strip() for name in lines[3].split("\t")[2:] if name.strip())
    problem = "header lacks a DataRate, NumMarkers or Units in m, cm or mm"
    with input_errors(path, problem, "give an OpenSim .trc file", KeyError, ValueError):
        rate, metres = float(fields["DataRate"]), _METRES[fields["Units"].strip()]
        expected = int(fields["NumMarkers"])
    if expected != len(names):
        raise InputError(path, f"line 4 names {len(names)} markers, the header says {expected}", "export it again")
    rows = [_row(line, number, len(names), path) for number, line in enumerate(lines[5:], 6) if line.strip()]
    if not rows:
        raise InputError(path, "holds no frames", "export it again")
    table = np.array(rows)
    if not 0 < rate < _MOST or not (np.abs(table[:, 0]) < _MOST).all():
        raise InputError(path, "has a DataRate or a Frame# that cannot be", "export it again")
    return PointTracks(rate, table[:, 0].astype(int), names, table[:, 1:].reshape(len(rows), -1, 3) @ turn.T * metres)


def _row(line: str, number: int, points: int, path: str | Path) -> list[float]:
    """Frame number and coordinates; an empty cell is a missing point."""
    cells = line.rstrip("\r\n").split("\t")
    cells = [*cells, *[""] * (2 + 3 * points - len(cells))][: 2 + 3 * points]
    with input_errors(f"{path}: line {number}", "holds a cell that is not a number", "export it again", ValueError):
        return [float(cells[0]), *(float(cell) if cell.strip() else np.nan for cell in cells[2:])]


@sandboxed
def read_c3d(path: str | Path) -> PointTracks:
    """Read all points; of a label such as ``Subject:LFHD`` the name is what follows the colon.

    A point is unknown where the file marks it so, or puts it exactly at the origin, as Vicon does.
    Frames are numbered as in the file's header; they are read with ``ezc3d``, which is installed with the extra
    ``humaneva``.

    Raises:
        InputError: ``ezc3d`` is not installed, the file is missing or no ``.c3d``, it holds no points, or its units
            are not known.
    """
    with needs_package(path, "ezc3d", "read", "humaneva", "pip install ezc3d"):
        import ezc3d
    if not Path(path).is_file():
        raise InputError(path, "no such file", "check the path")
    kinds = OSError, RuntimeError, ValueError
    with input_errors(path, "cannot be read as .c3d ({error})", "copy it again from its source", *kinds):
        file = ezc3d.c3d(str(path))
    about, header = file["parameters"]["POINT"], file["header"]["points"]
    if not len(about["LABELS"]["value"]):
        raise InputError(path, "holds no points", "give the .c3d of a captured trial")
    units = "".join(about["UNITS"]["value"]).strip()
    if units not in _METRES:
        raise InputError(path, f"POINT:UNITS is {units!r}", f"export it in one of {', '.join(_METRES)}")
    positions = np.moveaxis(file["data"]["points"][:3], 0, -1).swapaxes(0, 1).astype(np.float64)
    positions[(positions == 0).all(axis=-1)] = np.nan
    names = tuple(label.rpartition(":")[2].strip() for label in about["LABELS"]["value"])
    frames = header["first_frame"] + 1 + np.arange(len(positions))  # ezc3d counts from 0
    return PointTracks(float(header["frame_rate"]), frames, names, positions * _METRES[units])
