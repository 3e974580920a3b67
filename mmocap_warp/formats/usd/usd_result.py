"""Results as USD: the fitted body, animated, and a camera per view; all runs and what they cost as attributes.

Layout, with the recording's frame number as time code::

    /World                   turned upright where the cameras' up axis is neither +Y nor +Z
    /World/<body>            the subject as ``usd_body`` writes it
    /World/<body>/Animation  the best run as a SkelAnimation
    /World/Cameras/<view>    see ``usd_camera``
    /World/Tracking          mmocap:resultVersion, frames, runs, bestRun, seconds, config and versions (JSON); what it
                             has per frame is in docs/formats.md
"""

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from pxr import Kind, Tf, Usd, UsdGeom, UsdSkel, UsdUtils, Vt

from mmocap_warp.body.model import Subject, joint_transforms
from mmocap_warp.body.posing import Poser, blocks
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.usd import usd_file
from mmocap_warp.formats.usd.usd_body import body_prim, define_body, define_subject, set_pose, subject_from_prim
from mmocap_warp.formats.usd.usd_camera import cameras_from_prim, define_cameras
from mmocap_warp.formats.usd.usd_skeleton import joint_paths
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.whole_file import whole_file

VERSION = 2
"""Of the layout above; raised when a file of the older layout can no longer be read."""

PEOPLE = "mmocap:people"
"""The attribute of ``/World`` that a file of several people has; ``usd_people`` writes it."""
PRIMS_OF_ALL = ("Cameras", "Tracking")
"""Names of prims of ``/World`` that are no body's."""

_SAMPLED = {name: f"mmocap:{name}" for name in ("pose", "cost", "iou", "evaluations")}  # attributes by arrays
_OPTIONAL = {"raw_pose": "mmocap:rawPose", "angle_sigma": "mmocap:angleSigma", "joint_sigma": "mmocap:jointSigma"}
_OPTIONAL["view_shift"] = "mmocap:viewShift"
_SAMPLED |= _OPTIONAL
_REMEDY = "give a result that `mmocap track` wrote"
_FRAMES_AT_ONCE = 32


def write_result(path: str | Path, result: Result) -> None:
    """Write a result to a ``.usd``, ``.usda`` or ``.usdc`` file; reading it gives it back exactly."""
    stage = new_world(result.cameras.up)
    body = define_subject(stage, f"/World/{result.subject.body.name}", result.subject)
    animate(stage, body, result.subject, result.pose[result.best_run], result.frame_numbers, result.fps)
    define_cameras(stage, "/World/Cameras", result.cameras)
    tracking = UsdGeom.Scope.Define(stage, "/World/Tracking").GetPrim()
    about = {"resultVersion": VERSION, "frames": result.frame_numbers, "runs": len(result.pose)}
    about |= {"bestRun": result.best_run, "seconds": float(result.seconds)}
    about |= {name: json.dumps(getattr(result, name)) for name in ("config", "versions")}
    for name, value in about.items():
        usd_file.author(tracking, f"mmocap:{name}", value)
    for i, time in enumerate(result.frame_numbers.astype(float).tolist()):
        for name, attribute in _SAMPLED.items():
            if (values := getattr(result, name)) is not None:
                usd_file.author(tracking, attribute, values[:, i], time)
        usd_file.author(tracking, "mmocap:status", [STATUS[status] for status in result.status[:, i]], time)
    usd_file.write_stage(path, stage)


@usd_file.reads_usd
def holds_result(path: str | Path) -> bool:
    """Whether a file is a result, and not, say, a subject."""
    stage = usd_file.read_stage(path)  # a prim lives only as long as its stage
    return _tracking(stage) is not None


def _tracking(stage: Usd.Stage) -> Usd.Prim | None:
    prim = stage.GetPrimAtPath("/World/Tracking")
    return prim if prim and prim.HasAttribute("mmocap:resultVersion") else None


@usd_file.reads_usd
def read_result(path: str | Path) -> Result:
    """Read a result that :func:`write_result` wrote."""
    stage = usd_file.read_stage(path)
    prim = _tracking(stage)
    if prim is None:
        several = bool(stage.GetAttributeAtPath(f"/World.{PEOPLE}"))
        problem = "holds several people" if several else "holds no tracking result (no /World/Tracking)"
        raise InputError(path, problem, "give the file of one of them, beside it" if several else _REMEDY)
    read = usd_file.PrimReader(prim, path, _REMEDY)
    version = read.value("mmocap:resultVersion")
    read.require(version == VERSION, f"this result has version {version}, this program reads {VERSION}")
    cameras = cameras_from_prim(stage.GetPrimAtPath("/World/Cameras"), path)
    frames = read.array("mmocap:frames", (None,), np.int64)
    times, runs = frames.astype(float).tolist(), read.typed("mmocap:runs", int)
    subject = subject_from_prim(body_prim(stage, path), path)
    skeleton = subject.body.skeleton

    # Arrays (run, frame, ...), of which the file has (frame, run, ...).
    of_pose = {name: (skeleton.coordinates,) for name in ("pose", "raw_pose", "angle_sigma")}
    of_view = dict.fromkeys(("iou", "view_shift"), (len(cameras),))
    shapes = of_pose | of_view | {"joint_sigma": (len(skeleton.joints), 3)}
    arrays: dict[str, Any] = {}
    for name, attribute in _SAMPLED.items():
        if name not in _OPTIONAL or prim.HasAttribute(attribute):
            arrays[name] = np.moveaxis(read.sampled_array(attribute, times, (runs, *shapes.get(name, ()))), 1, 0)
    read.require(np.isfinite(arrays["pose"]).all(), "mmocap:pose is not finite")
    with input_errors(path, "{error}", _REMEDY, ValueError):
        return Result(
            subject=subject, cameras=cameras, fps=stage.GetTimeCodesPerSecond(), frame_numbers=frames,
            status=_status(read, times, runs), seconds=read.typed("mmocap:seconds", float),
            config=read.json_object("mmocap:config"), versions=read.json_object("mmocap:versions"), **arrays,
        )  # fmt: skip


def _status(read: usd_file.PrimReader, times: list[float], runs: int) -> np.ndarray:
    """(run, frame) int8; a frame may name one status for all runs, as results of one status a frame do."""
    values = read.samples("mmocap:status", times)
    names = [[value] * runs if isinstance(value, str) else list(value) for value in values]
    unknown = {name for frame in names for name in frame} - set(STATUS)
    read.require(not unknown, f"mmocap:status knows {STATUS}, not {sorted(unknown)}")
    wrong = [len(frame) for frame in names if len(frame) != runs]
    read.require(not wrong, f"mmocap:status names {wrong[:1]} runs in a frame, not {runs}")
    return np.array([[STATUS.index(name) for name in frame] for frame in names], np.int8).T


def animate(
    stage: Usd.Stage, root: UsdSkel.Root, subject: Subject, pose: np.ndarray, frame_numbers: np.ndarray, fps: float
) -> None:
    """Let a ``subject`` that was authored at ``root`` move through poses (frame, coordinate); set the stage's range.

    Frame numbers (frame,) are the time codes, of which ``fps`` pass in a second.
    """
    times = np.asarray(frame_numbers, float).tolist()
    usd_file.set_time_range(stage, frame_numbers, fps)
    animation = UsdSkel.Animation.Define(stage, root.GetPath().AppendChild("Animation"))
    animation.CreateJointsAttr(joint_paths(subject.body.skeleton))
    skeleton = stage.GetPrimAtPath(root.GetPath().AppendChild("Skeleton"))
    UsdSkel.BindingAPI(skeleton).CreateAnimationSourceRel().SetTargets([animation.GetPath()])

    extent, poser = root.CreateExtentAttr(), Poser(subject.body, subject.root_base)
    lowest, highest, before = np.full(3, np.inf), np.full(3, -np.inf), None
    for block in blocks(len(pose), _FRAMES_AT_ONCE):  # the skin of all frames would fill the memory
        local, _ = joint_transforms(subject, pose[block])
        coordinate = poser.vertices(pose[block]).transpose(0, 2, 1).copy()  # an axis a row: NumPy is far faster then
        low, high = coordinate.min(axis=2), coordinate.max(axis=2)
        for number, time in enumerate(times[block]):
            before = set_pose(animation, local[number], Usd.TimeCode(time), before)
            extent.Set(_bounds(low[number], high[number]), time)
        lowest, highest = np.minimum(lowest, low.min(axis=0)), np.maximum(highest, high.max(axis=0))
    extent.Set(_bounds(lowest, highest))  # for viewers that ask for no particular time


def export_animation(result: Result | Mapping[str, Result], path: str | Path) -> None:
    """Write the best run alone: body, skeleton, animation and cameras as any program reads them, in the result's world.

    There is no ``mmocap:`` data in it but which joints slide, where any do. The path ends in ``.usd``, ``.usda``,
    ``.usdc`` or ``.usdz``. Results may be several, by people's names, which their bodies' prims have.
    """
    people = {result.subject.body.name: result} if isinstance(result, Result) else result
    bodies = {name: people[person] for person, name in usd_file.valid_names(people, PRIMS_OF_ALL).items()}
    cameras = next(iter(bodies.values())).cameras
    stage = new_world(cameras.up)
    roots = [define_body(stage, f"/World/{name}", each.subject.body) for name, each in bodies.items()]
    define_cameras(stage, "/World/Cameras", cameras)
    for root, each in zip(roots, bodies.values(), strict=True):
        _keep_what_is_seen(stage, root)
        animate(stage, root, each.subject, each.pose[each.best_run], each.frame_numbers, each.fps)
    _write_animation(stage, path)


def _write_animation(stage: Usd.Stage, path: str | Path) -> None:
    """Write a stage as the ending says, whole or not at all; a ``.usdz`` is an archive of one ``.usdc``."""
    path = Path(path)
    if path.suffix in usd_file.USD_SUFFIXES:
        usd_file.write_stage(path, stage)
        return
    if path.suffix != ".usdz":
        raise InputError(path, "is not a USD file name", "end it in .usda, .usdc or .usdz")
    with whole_file(path) as package, tempfile.TemporaryDirectory(prefix=f".{path.stem}.", dir=path.parent) as folder:
        layer = Path(folder) / f"{path.stem}.usdc"
        usd_file.export_root(stage, layer)
        try:
            packed = UsdUtils.CreateNewUsdzPackage(str(layer), str(package))
            whole = packed and ZipFile(package).testzip() is None  # USD says nothing of a disk that was full at the end
        except (Tf.ErrorException, BadZipFile):
            whole = False
        if not whole:
            raise OSError("the package is not whole; no space left")


def new_world(up: str) -> Usd.Stage:
    """A stage whose contents go below ``/World``, which is turned upright where ``up`` is neither +y nor +z."""
    stage = Usd.Stage.CreateInMemory()
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    Usd.ModelAPI(world).SetKind(Kind.Tokens.assembly)
    usd_file.set_world_up(stage, world, up)
    return stage


def _keep_what_is_seen(stage: Usd.Stage, root: UsdSkel.Root) -> None:
    """Remove the tracking mesh, the shape targets (already in the rest points) and the project's own attributes."""
    skin = stage.GetPrimAtPath(root.GetPath().AppendChild("Skin"))
    for path in (root.GetPath().AppendChild("Tracking"), *(child.GetPath() for child in skin.GetChildren())):
        stage.RemovePrim(path)
    for prim in stage.Traverse():
        for name in prim.GetPropertyNames():
            own = name.startswith("mmocap:") and name != "mmocap:sliding"
            if own or name in ("skel:blendShapes", "skel:blendShapeTargets"):
                prim.RemoveProperty(name)


def _bounds(low: np.ndarray, high: np.ndarray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.stack([low, high]).astype(np.float32))


def export_point_cache(result: Result, path: str | Path) -> None:
    """Write the best run's skin, with its points at every frame, and the cameras, in the result's world.

    A frame of a body of 13,000 vertices takes 160 KB. The path ends in ``.usd``, ``.usda``, ``.usdc`` or ``.usdz``.
    """
    stage = new_world(result.cameras.up)
    skin = result.subject.body.skin
    mesh = UsdGeom.Mesh.Define(stage, f"/World/{result.subject.body.name}")
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(skin.face), skin.face.shape[1]))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(skin.face.ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    usd_file.set_time_range(stage, result.frame_numbers, result.fps)
    points, extent = mesh.CreatePointsAttr(), mesh.CreateExtentAttr()
    for position, number in enumerate(result.frame_numbers.tolist()):  # one at a time: all would fill the memory
        (place,) = result.vertices(frames=[position])
        points.Set(Vt.Vec3fArray.FromNumpy(place), number)
        extent.Set(_bounds(place.min(axis=0), place.max(axis=0)), number)
    define_cameras(stage, "/World/Cameras", result.cameras)
    _write_animation(stage, path)
