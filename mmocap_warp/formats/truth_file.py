"""What is known of a recording's truth: written as USD, and read from USD or ``.trc``.

In USD markers and joints are time-sampled points, which a viewer shows beside the tracked body, in the world of the
cameras, with the frame number as time code and in single precision (about 1e-7 m)::

    /Truth          mmocap:truthVersion, and where known mmocap:pose (double[] per frame) and mmocap:rootBase (a matrix
                    for row vectors)
    /Truth/Markers  Points; ids number the markers that are seen in a frame; mmocap:names
    /Truth/Joints   the same for the joints
"""

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.motion.captured_points import read_trc
from mmocap_warp.formats.usd import usd_file
from mmocap_warp.formats.usd.usd_skeleton import is_rotation
from mmocap_warp.result.truth import Truth


def load_truth(path: str | Path, axes: str = "xyz", first_frame: int = 0) -> Truth:
    """Read the truth of a recording: the project's own USD, or joints from a ``.trc`` file.

    Of a ``.trc``, ``axes`` says which of its axes are the world's x, y and z, and ``first_frame`` is the number of its
    first row, counted at its rate from the recording's start.

    Raises:
        InputError: a missing or wrong file, or axes or a first frame for one that is in the world's own.
    """
    path = Path(path)
    if path.suffix == ".trc":
        tracks = read_trc(path, axes)
        frames = tracks.frame_numbers - tracks.frame_numbers[0] + first_frame
        with input_errors(path, "{error}", "export it again", ValueError):
            return Truth(tracks.rate, frames, (), np.zeros((len(frames), 0, 3)), tracks.names, tracks.positions)
    if path.suffix in usd_file.USD_SUFFIXES:
        if axes != "xyz" or first_frame:
            raise InputError(path, f"cannot have axes = {axes!r} or a first_frame", "leave both out; a .trc needs them")
        return read_truth(path)
    raise InputError(path, f"has the ending {path.suffix!r}, which no truth has", "give a .usda, .usdc or .trc file")


_VERSION = 1
_DOT_SIZE = 0.02  # [m], how large a viewer draws a point
_REMEDY = "write it again with this version of mmocap"


def write_truth(path: str | Path, truth: Truth, up: str = "+z") -> None:
    """Write truth to a ``.usda`` or ``.usdc`` file; ``up`` is the world's up axis, as in ``CameraRig``."""
    stage = Usd.Stage.CreateInMemory()
    usd_file.set_time_range(stage, truth.frame_numbers, truth.fps)
    root = UsdGeom.Xform.Define(stage, "/Truth")
    stage.SetDefaultPrim(root.GetPrim())
    usd_file.set_world_up(stage, root, up)
    usd_file.author(root.GetPrim(), "mmocap:truthVersion", _VERSION)
    usd_file.author(root.GetPrim(), "mmocap:frames", np.asarray(truth.frame_numbers))
    _define_points(stage, "/Truth/Markers", truth.marker_names, truth.markers, truth.frame_numbers)
    _define_points(stage, "/Truth/Joints", truth.joint_names, truth.joints, truth.frame_numbers)
    for frame, pose in zip(truth.frame_numbers, truth.pose if truth.pose is not None else (), strict=False):
        usd_file.author(root.GetPrim(), "mmocap:pose", pose, float(frame))
    if truth.root_base is not None:
        base = Gf.Matrix3d(np.asarray(truth.root_base, float).T)
        usd_file.author(root.GetPrim(), "mmocap:rootBase", base, kind=Sdf.ValueTypeNames.Matrix3d)
    usd_file.write_stage(path, stage)


@usd_file.reads_usd
def read_truth(path: str | Path) -> Truth:
    """Read what :func:`write_truth` wrote."""
    stage = usd_file.read_stage(path)
    prim = stage.GetPrimAtPath("/Truth")
    if not prim:
        raise InputError(path, "holds no truth (no prim /Truth)", "give a file of truth that mmocap wrote")
    root = usd_file.PrimReader(prim, path, _REMEDY)
    version = root.value("mmocap:truthVersion")
    root.require(version == _VERSION, f"this truth has version {version}, this program reads {_VERSION}")
    frames = root.array("mmocap:frames", (None,), np.int64)
    times = frames.astype(float).tolist()
    marker_names, markers = _points_from_prim(root.child("Markers"), times)
    joint_names, joints = _points_from_prim(root.child("Joints"), times)
    pose = root.sampled_array("mmocap:pose", times) if prim.HasAttribute("mmocap:pose") else None
    root_base = None
    if prim.HasAttribute("mmocap:rootBase"):
        root_base = root.array("mmocap:rootBase", (3, 3), np.float64).T
        root.require(is_rotation(root_base), "mmocap:rootBase is not a rotation")
    with input_errors(path, "{error}", _REMEDY, ValueError):
        return Truth(stage.GetTimeCodesPerSecond(), frames, marker_names, markers, joint_names, joints, pose, root_base)


def _define_points(stage: Usd.Stage, path: str, names: tuple[str, ...], places: np.ndarray, frames: np.ndarray) -> None:
    points = UsdGeom.Points.Define(stage, path)
    usd_file.author(points.GetPrim(), "mmocap:names", names)
    points.CreateWidthsAttr([_DOT_SIZE])
    points.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    for frame, seen in zip(frames, places, strict=True):
        known = np.isfinite(seen).all(axis=1)
        where = Vt.Vec3fArray.FromNumpy(seen[known].astype(np.float32))
        points.CreatePointsAttr().Set(where, float(frame))
        points.CreateIdsAttr().Set(Vt.Int64Array.FromNumpy(np.flatnonzero(known)), float(frame))
        points.CreateExtentAttr().Set(UsdGeom.Points.ComputeExtent(where, [_DOT_SIZE] * len(where)), float(frame))


def _points_from_prim(points: usd_file.PrimReader, times: list[float]) -> tuple[tuple[str, ...], np.ndarray]:
    names = tuple(points.texts("mmocap:names"))
    positions = np.full((len(times), len(names), 3), np.nan)
    samples = zip(points.samples("points", times), points.samples("ids", times), strict=True)
    for row, (seen, ids) in enumerate(samples):
        number = np.array(ids, int)
        fits = len(seen) == len(number) and ((number >= 0) & (number < len(names))).all()
        points.require(fits, f"ids do not fit points and names at frame {times[row]:g}")
        positions[row, number] = np.array(seen).reshape(-1, 3)
    return names, positions
