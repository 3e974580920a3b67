"""``.c3d`` of motion capture systems: joint centres and virtual markers in millimetres; no analog channels."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mmocap_warp.errors import missing_package
from mmocap_warp.formats.exports.point_tracks import tracks_of
from mmocap_warp.result.result import Result
from mmocap_warp.whole_file import whole_file

_MILLIMETRES = 1000.0


def write_c3d(result: Result, path: Path) -> None:
    """Write a result in its own world; single precision, about 1e-7 m. The recording's frame 0 is the file's frame 1.

    ``POINT:X_SCREEN`` and ``Y_SCREEN`` say which way is up, for programs that ask.

    Raises:
        InputError: ``ezc3d`` is not installed, or a folder that cannot be written to.
    """
    try:
        import ezc3d
    except ImportError:
        raise missing_package(path, "ezc3d", "written", "formats", "write a .trc") from None
    tracks = tracks_of(result)
    names, points = tracks.points()
    up = result.cameras.up
    file = ezc3d.c3d()
    about = file["parameters"]["POINT"]
    about["UNITS"]["value"], about["RATE"]["value"], about["LABELS"]["value"] = ["mm"], [tracks.rate], list(names)
    file.add_parameter("POINT", "X_SCREEN", ["+Y" if up[1] == "x" else "+X"])
    file.add_parameter("POINT", "Y_SCREEN", [up.upper()])
    file["header"]["points"]["first_frame"] = int(tracks.row_number[0]) - 1  # ezc3d counts from 0
    file["data"]["points"] = np.ones((4, len(names), len(points)))
    file["data"]["points"][:3] = points.transpose(2, 1, 0) * _MILLIMETRES
    with whole_file(path) as unfinished:
        file.write(str(unfinished))
