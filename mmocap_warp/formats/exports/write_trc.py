"""OpenSim's ``.trc``: joint centres and virtual markers in metres, Y up, as OpenSim's models stand."""

from __future__ import annotations

from pathlib import Path

from mmocap_warp.formats.exports.point_tracks import tracks_of
from mmocap_warp.result.result import Result
from mmocap_warp.whole_file import write_whole


def write_trc(result: Result, path: Path) -> None:
    """Write a result, which is Y up; to 1e-6 m. Times are the recording's, and its frame 0 is the file's frame 1.

    Raises:
        InputError: a folder that cannot be written to.
    """
    tracks = tracks_of(result)
    names, points = tracks.points()
    first, frames, rate = tracks.row_number[0], len(points), f"{tracks.rate:.6f}"
    about = {
        "DataRate": rate,
        "CameraRate": rate,
        "NumFrames": frames,
        "NumMarkers": len(names),
        "Units": "m",
        "OrigDataRate": rate,
        "OrigDataStartFrame": first,
        "OrigNumFrames": frames,
    }
    rows = [
        ["PathFileType", "4", "(X/Y/Z)", path.name],
        [*about],
        [str(value) for value in about.values()],
        ["Frame#", "Time", *(cell for name in names for cell in (name, "", ""))],
        ["", "", *(f"{axis}{number}" for number in range(1, len(names) + 1) for axis in "XYZ")],
        [],
    ]
    for number, time, values in zip(tracks.row_number, tracks.time, points.reshape(frames, -1), strict=True):
        rows.append([str(number), f"{time:.6f}", *(f"{value:.6f}" for value in values)])
    write_whole(path, "".join("\t".join(row) + "\n" for row in rows).encode())
