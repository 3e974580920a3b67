"""Cameras as USD: a ``UsdGeomCamera`` per view that any viewer looks through, with the exact calibration beside it.

A viewer's camera is the undistorted pinhole. Its lens values are single precision and reproject to about 1e-4 px; the
calibration itself is kept as ``mmocap:`` attributes in double precision, so a rig reads back as it was written.
"""

import math
from pathlib import Path

import numpy as np
from pxr import Gf, Tf, Usd, UsdGeom

from mmocap_warp.cameras.rig import UP_AXES, Camera, CameraRig, check_rig, rig_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.calibration_text import Sizes, image_size_of
from mmocap_warp.formats.usd.usd_file import PrimReader, author, read_stage, reads_usd, set_world_up, write_stage
from mmocap_warp.whole_file import file_name

_FILM_WIDTH = 0.036  # [m], of a full-frame camera; only its ratio to the focal length matters
_LENS_UNIT = 10.0  # USD gives apertures and focal lengths in tenths of a scene unit
_FROM_USD = np.diag([1.0, -1.0, -1.0])  # USD's cameras look along -z with y up
_CALIBRATION = {  # a rig's arrays: their attributes, and their shapes for a camera
    "size": ("mmocap:size", (2,)),
    "K": ("mmocap:intrinsics", (3, 3)),
    "R": ("mmocap:rotation", (3, 3)),
    "t": ("mmocap:translation", (3,)),
    "distortion": ("mmocap:distortion", (5,)),
}
_FISHEYE = "fisheye"
_CLIPPING = (0.05, 100.0)  # [m]
_REMEDY = "write the result again with `mmocap track`"


def define_cameras(stage: Usd.Stage, path: str, rig: CameraRig) -> None:
    """Author a rig as camera prims below a scope at ``path``; the scope's parent is the rig's world, in metres."""
    scope = UsdGeom.Scope.Define(stage, path)
    prim_names: list[str] = []  # valid and distinct
    for name in rig.names:
        valid = Tf.MakeValidIdentifier(name)
        prim_names.append(valid if valid not in prim_names else f"{valid}_{len(prim_names)}")
    author(scope.GetPrim(), "mmocap:cameras", prim_names)
    author(scope.GetPrim(), "mmocap:up", rig.up)
    for k, prim_name in enumerate(prim_names):
        camera = UsdGeom.Camera.Define(stage, f"{path}/{prim_name}")
        pinhole, size = rig.pinhole(k)
        _set_lens(camera, pinhole, *map(int, size))
        placement = np.eye(4)
        placement[:3, :3], placement[:3, 3] = rig.R[k].T @ _FROM_USD, rig.centres[k]
        camera.AddTransformOp().Set(Gf.Matrix4d(placement.T))
        prim = camera.GetPrim()
        author(prim, "mmocap:name", rig.names[k])
        for name, (attribute, _) in _CALIBRATION.items():
            author(prim, attribute, np.asarray(getattr(rig, name)[k]))
        if rig.names[k] in rig.fisheye:
            author(prim, "mmocap:lens", _FISHEYE)


def cameras_from_prim(prim: Usd.Prim, source: object) -> CameraRig:
    """The rig that :func:`define_cameras` authored at the scope ``prim``; ``source`` is named in errors."""
    if not prim:
        raise InputError(source, "has no cameras", _REMEDY)
    scope = PrimReader(prim, source, _REMEDY)
    cameras = [scope.child(name) for name in scope.texts("mmocap:cameras")]
    scope.require(bool(cameras), "mmocap:cameras names none")

    up = scope.typed("mmocap:up", str)
    scope.require(up in UP_AXES, f"mmocap:up = '{up}' is none of {', '.join(UP_AXES)}")
    names = tuple(file_name(camera.typed("mmocap:name", str), source) for camera in cameras)
    arrays = {}
    for name in ("K", "R", "t", "size", "distortion"):
        key, shape = _CALIBRATION[name]
        rows = [camera.array(key, (math.prod(shape),), np.float64).reshape(shape) for camera in cameras]
        arrays[name] = np.stack(rows)
    lenses = [camera.typed("mmocap:lens", str, unsaid="") for camera in cameras]
    fisheye = tuple(name for name, lens in zip(names, lenses, strict=True) if lens == _FISHEYE)
    rig = CameraRig(names, **arrays | {"size": arrays["size"].astype(int)}, up=up, fisheye=fisheye)
    return check_rig(rig, source) if rig.fisheye else rig


def _set_lens(camera: UsdGeom.Camera, K: np.ndarray, width: int, height: int) -> None:
    """Film size and focal length of a pinhole.

    USD measures the image between its edges, half a pixel outside the centres of the border pixels. It has one focal
    length, so the film's height carries the pixel's aspect ratio.
    """
    across = _LENS_UNIT * _FILM_WIDTH / width  # lens units per pixel
    down = across * K[0, 0] / K[1, 1]
    camera.CreateFocalLengthAttr(K[0, 0] * across)
    camera.CreateHorizontalApertureAttr(width * across)
    camera.CreateVerticalApertureAttr(height * down)
    camera.CreateHorizontalApertureOffsetAttr((width / 2 - (K[0, 2] + 0.5)) * across)
    camera.CreateVerticalApertureOffsetAttr(((K[1, 2] + 0.5) - height / 2) * down)
    camera.CreateClippingRangeAttr(Gf.Vec2f(*_CLIPPING))
    camera.CreateFStopAttr(0.0)  # everything is sharp


_SHAPE_TOLERANCE = 0.01
"""Share by which the film's shape may differ from the image's; programs disagree on what is shown of such a one."""
_MAX_NUMBER = 1e9  # of a camera's numbers
_EXPORT_REMEDY = "export the cameras again, standing still, with one lens each"


def read_usd_cameras(path: str | Path, units: str | None = None, up: str = "+z", sizes: Sizes = None) -> CameraRig:
    """Read the cameras of a USD file, named as their prims, or those of one of this program's results.

    The file says its unit and its vertical; ``units`` and ``up`` are not needed. ``sizes`` holds (width, height) of
    the images of cameras that are not this program's own.
    """
    own, others, stage_up = _read(path)
    if own is not None:
        return own
    cameras = []
    for camera in others:
        problem = f"does not say how large the images of camera '{camera.name}' are"
        cameras.append(_in_pixels(camera, image_size_of(sizes, camera.name, path, problem), path))
    return rig_of(cameras, stage_up, path)


@reads_usd
def _read(path: str | Path) -> tuple[CameraRig | None, list[Camera], str]:
    """The rig that this program wrote, or else the cameras as if their image had width and height 1; and up."""
    stage = read_stage(path)
    for prim in stage.Traverse():
        if prim.HasAttribute("mmocap:cameras"):
            return check_rig(cameras_from_prim(prim, path), path), [], ""
    metres = UsdGeom.GetStageMetersPerUnit(stage)
    prims = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera)]
    up = f"+{str(UsdGeom.GetStageUpAxis(stage)).lower()}"
    return None, [_camera(UsdGeom.Camera(prim), metres, path) for prim in prims], up


def _camera(camera: UsdGeom.Camera, metres: float, path: str | Path) -> Camera:
    prim = camera.GetPrim()
    above = (UsdGeom.Xformable.Get(prim.GetStage(), place) for place in prim.GetPath().GetAncestorsRange())
    if any(placed and placed.TransformMightBeTimeVarying() for placed in above):  # itself is one of these
        raise InputError(path, f"{prim.GetPath()} moves", _EXPORT_REMEDY)
    film = "horizontalAperture", "verticalAperture", "horizontalApertureOffset", "verticalApertureOffset"
    stated = [prim.GetAttribute(name) for name in ("focalLength", *film)]
    if any(each.ValueMightBeTimeVarying() for each in stated):
        raise InputError(path, f"{prim.GetPath()} zooms", _EXPORT_REMEDY)
    lens = [each.Get(Usd.TimeCode.EarliestTime()) for each in stated]
    known = all(isinstance(value, float) and abs(value) < _MAX_NUMBER for value in lens)
    is_pinhole = camera.GetProjectionAttr().Get() == UsdGeom.Tokens.perspective
    if not known or not is_pinhole or min(lens[:3]) <= 1 / _MAX_NUMBER:
        remedy = "give it perspective, a film and a focal length"
        raise InputError(path, f"{prim.GetPath()} is not a perspective camera with a film and a focal length", remedy)
    focal, across, down, right, upward = lens
    K = np.array([[focal / across, 0, 0.5 - right / across], [0, focal / down, 0.5 + upward / down], [0, 0, 1]])
    world = np.array(UsdGeom.Xformable(camera).ComputeLocalToWorldTransform(Usd.TimeCode.EarliestTime())).T
    if not np.abs(world).max() < _MAX_NUMBER or not metres < _MAX_NUMBER:
        raise InputError(path, f"{prim.GetPath()} stands implausibly far away", _EXPORT_REMEDY)
    axes = world[:3, :3] / np.maximum(np.linalg.norm(world[:3, :3], axis=0), 1e-12)
    R = _FROM_USD @ axes.T
    return Camera(prim.GetName(), K, R, -R @ world[:3, 3] * metres, (1, 1), np.zeros(5))


def _in_pixels(camera: Camera, size: tuple[int, int], path: str | Path) -> Camera:
    """The camera in pixels, whose centres are whole numbers; USD measures from the image's edge."""
    K = np.diag([*size, 1.0]) @ camera.K
    K[:2, 2] -= 0.5
    shape = K[0, 0] / K[1, 1]
    if not abs(shape - 1) < _SHAPE_TOLERANCE:
        shapes = f"the film of camera '{camera.name}' has not the shape of its images, {size[0]}x{size[1]}"
        raise InputError(path, f"{shapes} (by {shape:.3g})", "set its vertical aperture to the images' shape")
    return camera._replace(K=K, size=size)


def write_usd_cameras(path: str | Path, rig: CameraRig) -> None:
    """Write cameras alone, in metres, that read back exactly."""
    stage = Usd.Stage.CreateInMemory()
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    set_world_up(stage, world, rig.up)
    define_cameras(stage, "/World/Cameras", rig)
    write_stage(path, stage)
