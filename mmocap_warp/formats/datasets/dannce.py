"""DANNCE's projects and Rat7M: animals among calibrated cameras.

Sources: README.md, dannce/engine/{io,ops}.py and dannce/utils/rat7m/ of github.com/spoonsso/dannce; the pages of Rat7M
at doi.org/10.6084/m9.figshare.c.5295370. They say that there is

- ``*dannce.mat`` with a cell for each camera: ``params`` (K, r, t, RDistort, TDistort), ``sync`` (``data_frame``, the
  camera's frames of the same moments), ``labelData`` (``data_3d``, points that a person marked), ``camnames``; and
  ``videos/Camera1/0.mp4``, named by its first frame;
- or ``mocap-s1-d1.mat`` with structs ``cameras`` (MATLAB's names of the same, and ``frame``) and ``mocap`` (markers by
  name, a row for each moment); and ``s1-d1-camera1-0.mp4``, ``-3500.mp4``, ...

MATLAB multiplies rows: ``[x 1] = [X 1] [r; t] K``, so K and r are transposed, and counts pixels from 1. Lengths are
millimetres, z is up. A skew is part of K, and applied after the distortion.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.cameras.rig import Camera, rig_of
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.datasets import dataset_scene
from mmocap_warp.formats.datasets.dataset_scene import REMEDY, CameraFiles, DatasetScene
from mmocap_warp.result.truth import Truth
from mmocap_warp.whole_file import file_name

_LABEL_FIELDS = ("K", "r", "t", "RDistort", "TDistort")
_RAT7M_FIELDS = ("IntrinsicMatrix", "rotationMatrix", "translationVector", "RadialDistortion", "TangentialDistortion")


def read_dannce(root: Path, first: str = "0") -> DatasetScene:
    """Read the videos that begin with the frame ``first``, of a project of DANNCE or a session of Rat7M."""
    if not first.isdecimal():
        raise InputError("FIRST", f"{first!r} is not the number of a frame", "give that of a video's name, such as 0")
    project = sorted(root.glob("*dannce.mat"))
    path = project[0] if project else dataset_scene.find_files(root, "mocap-s*-d*.mat", "and no *dannce.mat")[0]
    content = dataset_scene.read_mat(path)
    parse, keys = (_project, _LABEL_FIELDS) if project else (_rat7m, _RAT7M_FIELDS)
    names, lenses, frames, (at, point_names, points) = parse(content, path)
    # The sizes of images are those of the videos.
    if project:
        patterns = [f"videos/{file_name(name, path)}/{first}.mp4" for name in names]
    else:
        session = path.stem.removeprefix("mocap-")
        patterns = [f"**/{session}-{file_name(name, path).lower()}-{first}.mp4" for name in names]
    found = [dataset_scene.find_files(root, pattern, "a camera's video")[0] for pattern in patterns]
    videos, fps, _ = dataset_scene.open_videos(found)
    of_cameras = zip(names, lenses, videos, strict=True)
    cameras = [_read_camera(name, lens, keys, path, video.size) for name, lens, video in of_cameras]
    # By how many frames cameras lead the first one, as a rule, in these videos.
    inside = (frames[0] >= int(first)) & (frames[0] < int(first) + len(videos[0]))
    if not inside.any():
        raise InputError(path, f"has no moment in the videos that begin with frame {first}", "give another FIRST")
    lead = [(frame - frames[0])[inside] for frame in frames]
    offsets = np.array([int(np.median(each)) for each in lead])
    notes = [
        f"{name} is up to {np.abs(each - offset).max()} frames out of step with {names[0]}"
        for name, each, offset in zip(names, lead, offsets, strict=True)
        if (each != offset).any()
    ]
    # The scene begins where all cameras have begun.
    offsets -= offsets.min()
    shifted = list(zip(videos, offsets.tolist(), strict=True))
    count = min(len(video) - offset for video, offset in shifted)
    if count < 1:
        raise InputError(path, "says that the videos have no moment in common", REMEDY)
    numbers, rows = np.unique(at - int(first) - offsets[0], return_index=True)
    kept = (numbers >= 0) & (numbers < count)
    truth, points = None, points[rows[kept]] * dataset_scene.MILLIMETRE
    if kept.any():
        truth = Truth(fps, numbers[kept], point_names, points, (), np.zeros((len(points), 0, 3)))
    else:
        notes.append(f"no truth: {path.name} has no points in these frames")
    about = (f"{path.stem}, frames from {first} on, written by mmocap dataset.",)
    files = tuple(CameraFiles(video.path, frame_offset=offset) for video, offset in shifted)
    return DatasetScene(about, path.stem, rig_of(cameras, "+z", path), fps, count, files, truth, tuple(notes))


Content = tuple[list[str], list[dict[str, Any]], list[np.ndarray], tuple[np.ndarray, tuple[str, ...], np.ndarray]]


def _project(content: dict[str, Any], path: Path) -> Content:
    """Names, lenses, and frames of the same moments of each camera; the first one's frames of points, and these."""
    params, sync, labels = (_structs(content.get(key), f"{path}: {key}") for key in ("params", "sync", "labelData"))
    names = [str(name) for name in np.atleast_1d(content.get("camnames", []))]
    names = names or [f"Camera{number}" for number in range(1, len(params) + 1)]
    if not len(params) == len(sync) == len(names):
        raise InputError(path, f"has {len(params)} params, {len(sync)} sync and {len(names)} camnames", REMEDY)
    frames = _frames((values.get("data_frame") for values in sync), path)
    if not labels:
        return names, params, frames, (np.zeros(0, int), (), np.zeros((0, 0, 3)))
    at = _frames([labels[0].get("data_frame")], path)[0]
    points = _points(labels[0].get("data_3d"), (len(at), -1, 3), f"{path}: labelData data_3d")
    return names, params, frames, (at, tuple(f"point{k + 1:02}" for k in range(points.shape[1])), points)


def _rat7m(content: dict[str, Any], path: Path) -> Content:
    """As of a project."""
    cameras, mocap = content.get("cameras"), content.get("mocap")
    if not isinstance(cameras, dict) or not isinstance(mocap, dict) or not mocap:
        raise InputError(path, "has no structs 'cameras' and 'mocap'", REMEDY)
    names = sorted(cameras)
    values = _structs([cameras[name] for name in names], f"{path}: cameras")
    frames = _frames((each.get("frame") for each in values), path)
    points = [_points(mocap[name], (len(frames[0]), 3), f"{path}: mocap.{name}") for name in mocap]
    return names, values, frames, (frames[0], tuple(mocap), np.stack(points, axis=1))


def _structs(values: Any, where: str) -> list[dict[str, Any]]:
    """The structs of a cell array; one alone is no list."""
    listed = list(values) if isinstance(values, list | np.ndarray) and np.ndim(values) else [values]
    listed = [] if values is None else listed
    if not all(isinstance(each, dict) for each in listed):
        raise InputError(where, "holds something else than structs", REMEDY)
    return listed


def _frames(columns: Iterable[Any], path: Path) -> list[np.ndarray]:
    """Frames of cameras at the same moments."""
    frames = [dataset_scene.finite(column, (-1,), str(path), "a camera's frames").astype(int) for column in columns]
    if len({len(each) for each in frames}) != 1:
        raise InputError(path, "has another number of moments for each camera", REMEDY)
    return frames


def _points(values: Any, shape: tuple[int, ...], where: str) -> np.ndarray:
    """Places of points [mm]; NaN where one is not known."""
    with input_errors(where, "is not three numbers for each moment", REMEDY, TypeError, ValueError):
        points = np.array(values, np.float64).reshape(shape)
    points[~np.isfinite(points).all(axis=-1)] = np.nan
    return points


def _read_camera(name: str, lens: dict[str, Any], keys: tuple[str, ...], path: Path, size: tuple[int, int]) -> Camera:
    where, shapes = f"{path}: camera {name}", ((3, 3), (3, 3), (3,), (-1,), (2,))
    K, r, t, radial, tangential = (
        dataset_scene.finite(lens.get(key), shape, where, key) for key, shape in zip(keys, shapes, strict=True)
    )
    if not 2 <= len(radial) <= 3:
        raise InputError(where, f"{keys[3]} is not 2 or 3 numbers", REMEDY)
    K = K.T - [[0, 0, 1], [0, 0, 1], [0, 0, 0]]  # pixel centres count from 0 here
    k1, k2, k3 = [*radial, 0.0][:3]
    return Camera(name, K, r.T, t * dataset_scene.MILLIMETRE, size, np.array([k1, k2, *tangential, k3]))
