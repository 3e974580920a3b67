"""Poses as a USD skeleton animation, inside a result or as a file of their own."""

from __future__ import annotations

import tempfile
from pathlib import Path
from zipfile import BadZipFile, ZipFile

import numpy as np
from pxr import Kind, Tf, Usd, UsdGeom, UsdSkel, UsdUtils, Vt

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import define_body, local_transforms, set_pose
from mmocap_warp.formats.usd.usd_camera import define_cameras
from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES, export_root, set_time_range, set_world_up, write_stage
from mmocap_warp.formats.usd.usd_skeleton import joint_paths
from mmocap_warp.result.result import Result
from mmocap_warp.whole_file import whole_file


def animate(
    stage: Usd.Stage, root: UsdSkel.Root, subject: Subject, pose: np.ndarray, frame_numbers: np.ndarray, fps: float
) -> None:
    """Let a body that ``usd_body`` authored move through poses, and set the stage's frame rate and range.

    Args:
        stage: the stage.
        root: the body.
        subject: what was authored there.
        pose: (frame, coordinate), poses.
        frame_numbers: (frame,), the time code of each.
        fps: time codes per second.
    """
    times = np.asarray(frame_numbers, float).tolist()
    set_time_range(stage, frame_numbers, fps)
    animation = UsdSkel.Animation.Define(stage, root.GetPath().AppendChild("Animation"))
    animation.CreateJointsAttr(joint_paths(subject.body.skeleton))
    skeleton = stage.GetPrimAtPath(root.GetPath().AppendChild("Skeleton"))
    UsdSkel.BindingAPI(skeleton).CreateAnimationSourceRel().SetTargets([animation.GetPath()])

    extent, poser = root.CreateExtentAttr(), Poser(subject.body, subject.root_base)
    lowest, highest, before = np.full(3, np.inf), np.full(3, -np.inf), None
    for one_pose, time in zip(pose, times, strict=True):  # one at a time: the skin of all frames would fill the memory
        local = local_transforms(subject.body, subject.root_base, one_pose)
        before = set_pose(animation, local, Usd.TimeCode(time), before)
        coordinate = poser.vertices(one_pose)[0].T.copy()  # an axis a row, whose extremes NumPy finds far faster
        low, high = coordinate.min(axis=1), coordinate.max(axis=1)
        extent.Set(_bounds(low, high), time)
        lowest, highest = np.minimum(lowest, low), np.maximum(highest, high)
    extent.Set(_bounds(lowest, highest))  # for viewers that ask for no particular time


def export_animation(result: Result, path: str | Path) -> None:
    """Write the best run alone: body, skeleton, animation and cameras as any program reads them, in the result's world.

    There is no ``mmocap:`` data in it but which joints slide, where any do.

    Args:
        result: the result.
        path: a ``.usd``, ``.usda``, ``.usdc`` or ``.usdz`` file; it appears whole or not at all.
    """
    write_animation(_animation_stage(result), path)


def write_animation(stage: Usd.Stage, path: str | Path) -> None:
    """Write a stage as the ending says, ``.usdz`` too; whole or not at all."""
    path = Path(path)
    if path.suffix != ".usdz" and path.suffix not in USD_SUFFIXES:
        raise InputError(path, "is not a USD file name", "end it in .usda, .usdc or .usdz")
    if path.suffix == ".usdz":
        _write_package(path, stage)
    else:
        write_stage(path, stage)


def new_world(up: str) -> Usd.Stage:
    """A stage whose contents go below ``/World``, which is turned upright where ``up`` is neither +y nor +z."""
    stage = Usd.Stage.CreateInMemory()
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    Usd.ModelAPI(world).SetKind(Kind.Tokens.assembly)
    set_world_up(stage, world, up)
    return stage


def _animation_stage(result: Result) -> Usd.Stage:
    stage = new_world(result.cameras.up)
    root = define_body(stage, f"/World/{result.subject.body.name}", result.subject.body)
    define_cameras(stage, "/World/Cameras", result.cameras)
    _keep_what_is_seen(stage, root)
    animate(stage, root, result.subject, result.pose[result.best_run], result.frame_numbers, result.fps)
    return stage


def _keep_what_is_seen(stage: Usd.Stage, root: UsdSkel.Root) -> None:
    """Remove the tracking mesh, the shape targets (already in the rest points) and the project's own attributes."""
    skin = stage.GetPrimAtPath(root.GetPath().AppendChild("Skin"))
    unseen = [root.GetPath().AppendChild("Tracking"), *(child.GetPath() for child in skin.GetChildren())]
    for path in unseen:
        stage.RemovePrim(path)
    for prim in stage.Traverse():
        for name in prim.GetPropertyNames():
            own = name.startswith("mmocap:") and name != "mmocap:sliding"
            if own or name in ("skel:blendShapes", "skel:blendShapeTargets"):
                prim.RemoveProperty(name)


def _write_package(path: Path, stage: Usd.Stage) -> None:
    """A ``.usdz``: an uncompressed archive of one ``.usdc``."""
    with whole_file(path) as package, tempfile.TemporaryDirectory(prefix=f".{path.stem}.", dir=path.parent) as folder:
        layer = Path(folder) / f"{path.stem}.usdc"
        export_root(stage, layer)
        try:
            packed = UsdUtils.CreateNewUsdzPackage(str(layer), str(package))
            whole = packed and ZipFile(package).testzip() is None  # USD says nothing of a disk that was full at the end
        except (Tf.ErrorException, BadZipFile):
            whole = False
        if not whole:
            raise OSError("the package is not whole; no space left")


def _bounds(low: np.ndarray, high: np.ndarray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.stack([low, high]).astype(np.float32))


def export_point_cache(result: Result, path: str | Path) -> None:
    """Write the best run's skin, with its points at every frame, and the cameras, in the result's world.

    A frame of a body of 13,000 vertices takes 160 KB.

    Args:
        result: the result.
        path: a ``.usd``, ``.usda``, ``.usdc`` or ``.usdz`` file; it appears whole or not at all.
    """
    stage = new_world(result.cameras.up)
    skin = result.subject.body.skin
    mesh = UsdGeom.Mesh.Define(stage, f"/World/{result.subject.body.name}")
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(skin.face), skin.face.shape[1]))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(skin.face.ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    set_time_range(stage, result.frame_numbers, result.fps)
    points, extent = mesh.CreatePointsAttr(), mesh.CreateExtentAttr()
    for position, number in enumerate(result.frame_numbers.tolist()):  # one at a time: all would fill the memory
        (place,) = result.vertices(frames=[position])
        points.Set(Vt.Vec3fArray.FromNumpy(place), number)
        extent.Set(Vt.Vec3fArray.FromNumpy(np.stack([place.min(axis=0), place.max(axis=0)])), number)
    define_cameras(stage, "/World/Cameras", result.cameras)
    write_animation(stage, path)
