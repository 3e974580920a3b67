"""A result as tables of numbers: ``.csv``, ``.parquet``, ``.trc``, ``.mot``, ``.c3d``, ``.npz`` and ``.json``.

A row is a frame. Where a joint set is given, its points stand in the place of the body's joint centres.

Columns of ``.csv`` and ``.parquet`` say their unit: ``LKnee.x_m`` is a joint's or a marker's place, ``LKnee.Rx_deg`` an
angle of the pose, and ``Ball_place.Tx_m`` a shift of a joint that slides. A function raises InputError for a folder
that cannot be written to, or a package that is not installed.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.biomechanics.measure_all import measure
from mmocap_warp.body.joint_sets import RIG, JointSet
from mmocap_warp.body.model import Subject, bind_transforms, joint_transforms
from mmocap_warp.body.posing import skin_positions
from mmocap_warp.body.rotations import near_zyx_angles
from mmocap_warp.body.skeleton import ROOT_ANGLES, TRANSLATION
from mmocap_warp.errors import InputError, needs_package
from mmocap_warp.result.excerpt import evenly
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.whole_file import csv_text, whole_file, write_whole

_MOST_C3D = 65_535  # a frame's number and the number of frames have 16 bits


def write_csv(result: Result, path: Path, joint_set: JointSet | None = None) -> None:
    """Write the table as text; places to 1e-6 m, angles to 1e-6 degrees."""
    columns = _columns(result, joint_set)
    cells = [[f"{v:.6f}" if isinstance(v, float) else str(v) for v in column] for column in columns.values()]
    write_whole(path, csv_text([list(columns), *zip(*cells, strict=True)]).encode())


def write_parquet(result: Result, path: Path, joint_set: JointSet | None = None) -> None:
    """Write the table with Arrow, in double precision."""
    with needs_package(path, "pyarrow", "written", "formats", "write a .csv"):
        import pyarrow
        from pyarrow import parquet
    table = pyarrow.table(_columns(result, joint_set))
    with whole_file(path) as unfinished:
        parquet.write_table(table, str(unfinished))


def _columns(result: Result, joint_set: JointSet | None) -> dict[str, list]:
    tracks = best_run_tracks(result)
    names, points = tracks.points(joint_set)
    skeleton = tracks.subject.body.skeleton
    values = np.where(skeleton.is_length, tracks.pose, np.degrees(tracks.pose))[:, TRANSLATION:]
    units = np.where(skeleton.is_length, "m", "deg")[TRANSLATION:]
    columns = {"frame": tracks.number.tolist(), "time_s": tracks.time.tolist(), "status": list(tracks.status)}
    for i, name in enumerate(names):
        columns |= {f"{name}.{axis}_m": points[:, i, k].tolist() for k, axis in enumerate("xyz")}
    own = zip(skeleton.coordinate_names[TRANSLATION:], units, values.T, strict=True)
    return columns | {f"{name}_{unit}": value.tolist() for name, unit, value in own}


def write_trc(result: Result, path: Path, joint_set: JointSet | None = None) -> None:
    """Write OpenSim's markers of a result, which is Y up: joint centres and virtual markers in metres, to 1e-6 m.

    Times are the recording's, and its frame 0 is the file's frame 1.
    """
    tracks = best_run_tracks(result)
    names, points = tracks.points(joint_set)
    if odd := [name for name in names if not name.isprintable()]:
        remedy = "name it without tabs and line ends, or write a .csv"
        raise InputError(path, f"cannot hold the name {odd[0]!r}", remedy)
    first, frames, rate = tracks.row_number[0], len(points), f"{tracks.rate:.6f}"
    about = {"DataRate": rate, "CameraRate": rate, "NumFrames": frames, "NumMarkers": len(names), "Units": "m"}
    about |= {"OrigDataRate": rate, "OrigDataStartFrame": first, "OrigNumFrames": frames}
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


def write_mot(result: Result, path: Path, joint_set: JointSet | None = None) -> None:
    """Write OpenSim's motion of a result, which is Y up: angles to 1e-6 degrees, the root's place to 1e-6 m.

    By a joint set, the angles are those that ``measure`` takes by its centres. Else they are this body's own: joint
    ``j`` turns by ``Rz @ Ry @ Rx`` from its bind pose in the axes of its frame. At zero, the root stands with its left
    along x, upright along y and facing along z, so that the file alone says how the body stands in the world. Those of
    an OpenSim model come out of its inverse kinematics, from the ``.trc``. Times are the recording's.
    """
    tracks, skeleton = best_run_tracks(result), result.subject.body.skeleton
    if joint_set is None:
        # The root's angles begin at the world's axes here, and in the result at the subject's heading.
        pose = tracks.pose.copy()
        pose[:, ROOT_ANGLES] = steady_angles(tracks.bind[0, :3, :3].T @ tracks.world[:, 0, :3, :3])
        names, values = skeleton.coordinate_names, np.where(skeleton.is_length, pose, np.degrees(pose)).T
    else:
        angles = measure(evenly(result), result.best_run, joint_set=joint_set).shown.angles
        own = [(f"{joint}_{name}", each) for joint, by_name in angles.items() for name, each in by_name.items()]
        names, values = tuple(name for name, _ in own), np.array([each for _, each in own])
    rows = ["\t".join(f"{value:.6f}" for value in row) for row in np.column_stack([tracks.time, *values])]
    head = [path.stem, "version=1", f"nRows={len(rows)}", f"nColumns={1 + len(names)}", "inDegrees=yes", "endheader"]
    write_whole(path, "\n".join([*head, "\t".join(["time", *names]).replace(".", "_"), *rows, ""]).encode())


def write_c3d(result: Result, path: Path, joint_set: JointSet | None = None) -> None:
    """Write joint centres and virtual markers in the result's own world, in millimetres; no analog channels.

    They have single precision, about 1e-7 m. The recording's frame 0 is the file's frame 1. ``POINT:X_SCREEN`` and
    ``Y_SCREEN`` say which way is up, for programs that ask.
    """
    with needs_package(path, "ezc3d", "written", "formats", "write a .trc"):
        import ezc3d
    tracks = best_run_tracks(result)
    names, points = tracks.points(joint_set)
    up, first = result.cameras.up, int(tracks.row_number[0])
    if max(first, len(points)) > _MOST_C3D:
        raise InputError(path, f"counts to {_MOST_C3D:,} frames, no further", "write a .trc, or fewer --frames")
    file = ezc3d.c3d()
    about = file["parameters"]["POINT"]
    about["UNITS"]["value"], about["RATE"]["value"], about["LABELS"]["value"] = ["mm"], [tracks.rate], list(names)
    file.add_parameter("POINT", "X_SCREEN", ["+Y" if up[1] == "x" else "+X"])
    file.add_parameter("POINT", "Y_SCREEN", [up.upper()])
    file["header"]["points"]["first_frame"] = first - 1  # ezc3d counts from 0
    file["data"]["points"] = np.ones((4, len(names), len(points)))
    file["data"]["points"][:3] = 1000 * points.transpose(2, 1, 0)  # [mm]
    with whole_file(path) as unfinished:
        file.write(str(unfinished))


def write_npz(result: Result, path: Path, joint_set: JointSet | None = None) -> None:
    """Write all that is needed to pose the skin again; ``np.load`` reads it, and docs/formats.md names its arrays.

    A vertex is at ``sum(weight * world[frame, joint] @ inverse(bind[joint]) @ rest)``.
    """
    tracks = best_run_tracks(result)
    body = tracks.subject.body
    names, points = tracks.points(None)
    joints, skin = len(body.skeleton.joints), body.skin
    arrays: dict[str, Any] = {"frame": tracks.number, "time": tracks.time, "rate": tracks.rate}
    arrays |= {"up": result.cameras.up, "status": tracks.status}
    arrays |= {"joint_names": names[:joints], "parent": body.skeleton.parent, "joints": points[:, :joints]}
    arrays |= {"marker_names": np.array(names[joints:], str), "markers": points[:, joints:]}
    arrays |= {"coordinate_names": body.skeleton.coordinate_names, "pose": tracks.pose}
    arrays |= {"root_base": tracks.subject.root_base, "world": tracks.world, "bind": tracks.bind}
    arrays |= {"rest": skin.rest, "face": skin.face, "skin_joint": skin.joint, "skin_weight": skin.weight}
    arrays |= {"attribution": body.attribution}
    if joint_set is not None:
        places = joint_set.positions(tracks.subject, tracks.pose)
        arrays |= {"set_names": np.array(joint_set.names, str), "set": places}
    with whole_file(path) as unfinished:
        np.savez_compressed(unfinished, **arrays)


def write_json(result: Result, path: Path, joint_set: JointSet | None = None) -> None:
    """Write names, frames, times and points as JSON: joint centres and virtual markers, to 1e-6 m."""
    tracks = best_run_tracks(result)
    names, points = tracks.points(joint_set)
    values: dict[str, Any] = {"joint_set": RIG if joint_set is None else joint_set.name, "up": result.cameras.up}
    values |= {"rate": tracks.rate, "names": names, "frame": tracks.number.tolist(), "time_s": tracks.time.tolist()}
    values |= {"status": tracks.status, "points_m": points.round(6).tolist()}
    write_whole(path, json.dumps(values).encode())


@dataclass(frozen=True)
class Tracks:
    """One run at even times, posed in double precision."""

    subject: Subject  # who moves
    rate: float  # frames per second
    time: np.ndarray  # (frame,) [s] since the recording's frame 0
    number: np.ndarray  # (frame,) int, the recording's frame, as the time codes of USD have it
    pose: np.ndarray  # (frame, coordinate) [m, rad]
    status: tuple[str, ...]  # one per frame, of ``STATUS``
    bind: np.ndarray  # (joint, 4, 4), body space from joint in the bind pose; all transforms are for column vectors
    local: np.ndarray  # (frame, joint, 4, 4), parent from joint; the root's is world from root
    world: np.ndarray  # (frame, joint, 4, 4), world from joint

    @property
    def row_number(self) -> np.ndarray:
        """(frame,) int: numbers by ones from 1 at the recording's start, for formats that cannot pass frames over."""
        return int(np.round(self.time[0] * self.rate)) + 1 + np.arange(len(self.time))

    def points(self, joint_set: JointSet | None = None) -> tuple[tuple[str, ...], np.ndarray]:
        """Joint centres, or the points of a set, then the virtual markers: their names, and (frame, point, 3) [m].

        A marker that is called like a joint gets the ending ``_marker``.
        """
        body = self.subject.body
        joints = body.skeleton.joints if joint_set is None else joint_set.names
        markers = tuple(f"{name}_marker" if name in joints else name for name in body.marker_names)
        skin = skin_positions(self.subject, self.pose, body.marker_vertex)
        own = self.world[:, :, :3, 3] if joint_set is None else joint_set.positions(self.subject, self.pose)
        return joints + markers, np.concatenate([own, skin], axis=1)


def best_run_tracks(result: Result) -> Tracks:
    """The best run of a result; frames that are not evenly spaced are resampled at the result's rate."""
    result = evenly(result)
    subject, pose = result.subject, result.pose[result.best_run]
    local, world = joint_transforms(subject, pose)
    return Tracks(
        subject=subject, rate=result.rate, time=result.frame_numbers / result.fps, number=result.frame_numbers,
        pose=pose, status=tuple(STATUS[status] for status in result.status[result.best_run]),
        bind=bind_transforms(subject.body), local=local, world=world,
    )  # fmt: skip


def steady_angles(rotation: np.ndarray) -> np.ndarray:
    """(frame, ..., 3) angles Rx, Ry, Rz [rad] of rotations (frame, ..., 3, 3), near to those of the frame before.

    So no program interpolates a whole turn. The first frame's are near to zero.
    """
    angles = np.zeros(rotation.shape[:-1])
    for frame, each in enumerate(rotation):
        angles[frame] = near_zyx_angles(each, angles[max(frame - 1, 0)])
    return angles
