"""Calibrations in USD files: this program's own cameras exactly, and any other's as their lens and place say.

A camera of USD has no image size, so that of the recording is taken; its film must have the same shape.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom

from mmocap_warp.cameras.rig import Camera, CameraRig, check_rig, rig_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.image_size import told_size
from mmocap_warp.formats.usd.usd_camera import cameras_from_prim, define_cameras
from mmocap_warp.formats.usd.usd_file import read_stage, reads_usd, write_stage
from mmocap_warp.formats.usd.world import set_world_up

_SAME_SHAPE = 0.01
"""Share by which the film's shape may differ from the image's; programs disagree on what is shown of such a one."""
_LARGEST = 1e9  # of a camera's numbers
_FROM_USD = np.diag([1.0, -1.0, -1.0])  # its cameras look along -z with y up
_REMEDY = "export the cameras again, standing still"


def read_usd_cameras(
    path: str | Path, units: str | None = None, up: str = "+z", sizes: dict[str, tuple[int, int]] | None = None
) -> CameraRig:
    """Read the cameras of a USD file, named as their prims, or those of one of this program's results.

    The file says its unit and its vertical; ``units`` and ``up`` are not needed. ``sizes`` holds (width, height) of
    the images of cameras that are not this program's own.

    Raises:
        InputError: not USD, no cameras, cameras that move, an image size that nobody has said or that has not the
            film's shape, or not a calibration (see ``check_rig``).
    """
    own, others, stage_up = _read(path)
    if own is not None:
        return own
    cameras = [_with_size(camera, told_size(sizes, camera.name, path, _no_size(camera)), path) for camera in others]
    return rig_of(cameras, stage_up, path)


def _no_size(camera: Camera) -> str:
    return f"does not say how large the images of camera '{camera.name}' are"


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
    if _moves(prim):
        raise InputError(path, f"{prim.GetPath()} moves", _REMEDY)
    focal, across, down, right, upward = (
        attribute.Get(Usd.TimeCode.EarliestTime())
        for attribute in (
            camera.GetFocalLengthAttr(),
            camera.GetHorizontalApertureAttr(),
            camera.GetVerticalApertureAttr(),
            camera.GetHorizontalApertureOffsetAttr(),
            camera.GetVerticalApertureOffsetAttr(),
        )
    )
    known = all(isinstance(value, float) and abs(value) < _LARGEST for value in (focal, across, down, right, upward))
    if camera.GetProjectionAttr().Get() != UsdGeom.Tokens.perspective or not (
        known and min(focal, across, down) > 1 / _LARGEST
    ):
        raise InputError(path, f"{prim.GetPath()} is no pinhole", "give it perspective, a film and a focal length")
    K = np.array([[focal / across, 0, 0.5 - right / across], [0, focal / down, 0.5 + upward / down], [0, 0, 1]])
    world = np.array(UsdGeom.Xformable(camera).ComputeLocalToWorldTransform(Usd.TimeCode.EarliestTime())).T
    if not np.abs(world).max() < _LARGEST or not metres < _LARGEST:
        raise InputError(path, f"{prim.GetPath()} stands beyond all bounds", _REMEDY)
    axes = world[:3, :3] / np.maximum(np.linalg.norm(world[:3, :3], axis=0), 1e-12)
    R = _FROM_USD @ axes.T
    return Camera(prim.GetName(), K, R, -R @ world[:3, 3] * metres, (1, 1), np.zeros(5))


def _moves(prim: Usd.Prim) -> bool:
    """Whether a prim, or one above it, has another place at another time."""
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable) and UsdGeom.Xformable(prim).TransformMightBeTimeVarying():
            return True
        prim = prim.GetParent()
    return False


def _with_size(camera: Camera, size: tuple[int, int], path: str | Path) -> Camera:
    """The camera in pixels, whose centres are whole numbers; USD measures from the image's edge."""
    K = np.diag([*size, 1.0]) @ camera.K
    K[:2, 2] -= 0.5
    shape = K[0, 0] / K[1, 1]
    if not abs(shape - 1) < _SAME_SHAPE:
        width, height = size
        raise InputError(
            path,
            f"the film of camera '{camera.name}' has not the shape of its images, {width}x{height} (by {shape:.3g})",
            "set its vertical aperture to the images' shape",
        )
    return camera._replace(K=K, size=size)


def write_usd_cameras(path: str | Path, rig: CameraRig) -> None:
    """Write cameras alone, in metres, that read back exactly.

    Raises:
        InputError: the file name is not USD's, or its folder cannot be written.
    """
    stage = Usd.Stage.CreateInMemory()
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    set_world_up(stage, world, rig.up)
    define_cameras(stage, "/World/Cameras", rig)
    write_stage(path, stage)
