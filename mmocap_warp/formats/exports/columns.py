"""A result as a table, a row a frame: time, status, joints, markers and angles; ``.csv`` and ``.parquet`` hold it.

Columns say their unit: ``LKnee.x_m`` is a joint's or a marker's place, ``LKnee.Rx_deg`` an angle of the pose, and
``Ball_place.Tx_m`` a shift of a joint that slides.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.errors import missing_package
from mmocap_warp.formats.exports.point_tracks import tracks_of
from mmocap_warp.result.result import Result
from mmocap_warp.whole_file import whole_file, write_whole


def write_csv(result: Result, path: Path) -> None:
    """Write the table as text; places to 1e-6 m, angles to 1e-6 degrees.

    Raises:
        InputError: a folder that cannot be written to.
    """
    columns = _columns(result)
    cells = [[f"{v:.6f}" if isinstance(v, float) else str(v) for v in column] for column in columns.values()]
    write_whole(path, "".join(",".join(row) + "\n" for row in [list(columns), *zip(*cells, strict=True)]).encode())


def write_parquet(result: Result, path: Path) -> None:
    """Write the table with Arrow, in double precision.

    Raises:
        InputError: ``pyarrow`` is not installed, or a folder that cannot be written to.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise missing_package(path, "pyarrow", "written", "formats", "write a .csv") from None
    table = pyarrow.table(_columns(result))
    with whole_file(path) as unfinished:
        parquet.write_table(table, str(unfinished))


def _columns(result: Result) -> dict[str, list]:
    tracks = tracks_of(result)
    names, points = tracks.points()
    skeleton = tracks.subject.body.skeleton
    values = np.where(skeleton.is_length, tracks.pose, np.degrees(tracks.pose))[:, TRANSLATION:]
    units = np.where(skeleton.is_length, "m", "deg")[TRANSLATION:]
    coordinates = skeleton.coordinate_names[TRANSLATION:]
    columns: dict[str, list] = {
        "frame": tracks.number.tolist(),
        "time_s": tracks.time.tolist(),
        "status": list(tracks.status),
    }
    for i, name in enumerate(names):
        columns |= {f"{name}.{axis}_m": points[:, i, k].tolist() for k, axis in enumerate("xyz")}
    own = zip(coordinates, units, values.T, strict=True)
    return columns | {f"{name}_{unit}": value.tolist() for name, unit, value in own}
