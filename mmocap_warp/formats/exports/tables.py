"""A result as tables of numbers, a row a frame: ``.csv``, ``.parquet``, ``.trc``, ``.mot``, ``.c3d`` and ``.npz``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mmocap_warp.body.rotations import near_zyx_angles
from mmocap_warp.body.skeleton import ROOT_ANGLES, TRANSLATION
from mmocap_warp.errors import missing_package
from mmocap_warp.formats.exports.point_tracks import Tracks, tracks_of
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


def write_mot(result: Result, path: Path) -> None:
    """Write a result, which is Y up; angles to 1e-6 degrees, places to 1e-6 m. Times are the recording's.

    Raises:
        InputError: a folder that cannot be written to.
    """
    tracks = tracks_of(result)
    names = [name.replace(".", "_") for name in tracks.subject.body.skeleton.coordinate_names]
    pose = _from_the_worlds_axes(tracks)
    pose = np.where(tracks.subject.body.skeleton.is_length, pose, np.degrees(pose))
    lines = [
        path.stem,
        "version=1",
        f"nRows={len(pose)}",
        f"nColumns={1 + len(names)}",
        "inDegrees=yes",
        "endheader",
        "\t".join(["time", *names]),
        *("\t".join(f"{value:.6f}" for value in (time, *row)) for time, row in zip(tracks.time, pose, strict=True)),
    ]
    write_whole(path, "\n".join([*lines, ""]).encode())


def _from_the_worlds_axes(tracks: Tracks) -> np.ndarray:
    """The poses, with root angles that begin at the world's axes instead of the subject's heading."""
    pose = tracks.pose.copy()
    rotation = tracks.bind[0, :3, :3].T @ tracks.world[:, 0, :3, :3]
    last = np.zeros(3)
    for frame, turned in enumerate(rotation):
        last = pose[frame, ROOT_ANGLES] = near_zyx_angles(turned, last)
    return pose


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


def write_npz(result: Result, path: Path) -> None:
    """Write a result; ``np.load`` reads it, and docs/formats.md names its arrays.

    Raises:
        InputError: a folder that cannot be written to.
    """
    tracks = tracks_of(result)
    body = tracks.subject.body
    names, points = tracks.points()
    joints = len(body.skeleton.joints)
    with whole_file(path) as unfinished:
        np.savez_compressed(
            unfinished,
            frame=tracks.number,
            time=tracks.time,
            rate=np.array(tracks.rate),
            up=np.array(result.cameras.up),
            status=np.array(tracks.status),
            joint_names=np.array(names[:joints]),
            parent=np.array(body.skeleton.parent),
            joints=points[:, :joints],
            marker_names=np.array(names[joints:], str),
            markers=points[:, joints:],
            coordinate_names=np.array(body.skeleton.coordinate_names),
            pose=tracks.pose,
            root_base=tracks.subject.root_base,
            world=tracks.world,
            bind=tracks.bind,
            rest=body.skin.rest,
            face=body.skin.face,
            skin_joint=body.skin.joint,
            skin_weight=body.skin.weight,
            attribution=np.array(body.attribution),
        )
