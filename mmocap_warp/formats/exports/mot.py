"""OpenSim's ``.mot``: the body's joint angles in degrees and its root's place in metres, Y up.

The angles are this body's own: joint ``j`` turns by ``Rz @ Ry @ Rx`` from its bind pose in the axes of its frame. At
zero, the root stands with its left along x, upright along y and facing along z, so that the file alone says how the
body stands in the world. They are no angles of an OpenSim model: these come out of OpenSim's inverse kinematics, from
the ``.trc``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mmocap_warp.body.rotations import near_zyx_angles
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.formats.exports.point_tracks import Tracks, tracks_of
from mmocap_warp.result.result import Result
from mmocap_warp.whole_file import write_whole


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
