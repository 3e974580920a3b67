"""``.c3d`` of motion capture systems: positions of markers, and of what the system's own model computed from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mmocap_warp.errors import InputError, missing_package
from mmocap_warp.formats.motion.read_trc import PointTracks
from mmocap_warp.formats.tried_first import tried_first

_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}


@tried_first
def read_c3d(path: str | Path) -> PointTracks:
    """Read all points; of a label such as ``Subject:LFHD`` the name is what follows the colon.

    A point is unknown where the file marks it so, or puts it exactly at the origin, as Vicon does.
    Frames are numbered as in the file's header; they are read with ``ezc3d``, which is installed with the extra
    ``humaneva``.

    Raises:
        InputError: ``ezc3d`` is not installed, the file is missing or no ``.c3d``, it holds no points, or its units
            are not known.
    """
    try:
        import ezc3d
    except ImportError:
        raise missing_package(path, "ezc3d", "read", "humaneva", "pip install ezc3d") from None
    if not Path(path).is_file():
        raise InputError(path, "no such file", "check the path")
    try:
        file = ezc3d.c3d(str(path))
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(path, f"cannot be read as .c3d ({error})", "copy it again from its source") from None
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
