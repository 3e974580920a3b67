"""Cameras as USD: a ``UsdGeomCamera`` per view that any viewer looks through, with the exact calibration beside it.

A viewer's camera is the undistorted pinhole. Its lens values are single precision and reproject to about 1e-4 px; the
calibration itself is kept as ``mmocap:`` attributes in double precision, so a rig reads back as it was written.
"""

from __future__ import annotations

import math

import numpy as np
from pxr import Gf, Tf, Usd, UsdGeom

from mmocap_warp.cameras.rig import UP_AXES, CameraRig, check_rig
from mmocap_warp.formats.usd.attributes import author_value, gf_matrix
from mmocap_warp.formats.usd.usd_file import PrimReader

_FILM_WIDTH = 0.036  # [m], of a full-frame camera; only its ratio to the focal length matters
_LENS_UNIT = 10.0  # USD gives apertures and focal lengths in tenths of a scene unit
_FISHEYE = "fisheye"
_CLIPPING = (0.05, 100.0)  # [m]
_REMEDY = "write the result again with `mmocap track`"


def define_cameras(stage: Usd.Stage, path: str, rig: CameraRig) -> None:
    """Author a rig as camera prims below a scope at ``path``; the scope's parent is the rig's world, in metres."""
    scope = UsdGeom.Scope.Define(stage, path)
    prim_names = _prim_names(rig.names)
    author_value(scope.GetPrim(), "mmocap:cameras", prim_names)
    author_value(scope.GetPrim(), "mmocap:up", rig.up)
    for k, prim_name in enumerate(prim_names):
        camera = UsdGeom.Camera.Define(stage, f"{path}/{prim_name}")
        pinhole, size = rig.pinhole(k)
        _set_lens(camera, pinhole, *map(int, size))
        camera.AddTransformOp().Set(_world_from_camera(rig, k))
        prim = camera.GetPrim()
        author_value(prim, "mmocap:name", rig.names[k])
        author_value(prim, "mmocap:size", np.asarray(rig.size[k]))
        author_value(prim, "mmocap:intrinsics", rig.K[k])
        author_value(prim, "mmocap:rotation", rig.R[k])
        author_value(prim, "mmocap:translation", rig.t[k])
        author_value(prim, "mmocap:distortion", rig.distortion[k])
        if rig.names[k] in rig.fisheye:
            author_value(prim, "mmocap:lens", _FISHEYE)


def cameras_from_prim(prim: Usd.Prim, source: object) -> CameraRig:
    """The rig that :func:`define_cameras` authored at the scope ``prim``; ``source`` is named in errors.

    Raises:
        InputError: a camera or one of its values is missing, or a fisheye that is none.
    """
    scope = PrimReader(prim, source, _REMEDY)
    cameras = [scope.child(name) for name in scope.texts("mmocap:cameras")]

    scope.require(bool(cameras), "mmocap:cameras names none")

    def stacked(name: str, *shape: int) -> np.ndarray:
        return np.stack([camera.array(name, (math.prod(shape),), np.float64).reshape(shape) for camera in cameras])

    up = scope.typed("mmocap:up", str)
    scope.require(up in UP_AXES, f"mmocap:up = '{up}' is none of {', '.join(UP_AXES)}")
    rig = CameraRig(
        names=tuple(camera.typed("mmocap:name", str) for camera in cameras),
        K=stacked("mmocap:intrinsics", 3, 3),
        R=stacked("mmocap:rotation", 3, 3),
        t=stacked("mmocap:translation", 3),
        size=stacked("mmocap:size", 2).astype(int),
        distortion=stacked("mmocap:distortion", 5),
        up=up,
        fisheye=tuple(camera.typed("mmocap:name", str) for camera in cameras if _is_fisheye(camera)),
    )
    return check_rig(rig, source) if rig.fisheye else rig


def _is_fisheye(camera: PrimReader) -> bool:
    return camera.prim.HasAttribute("mmocap:lens") and camera.typed("mmocap:lens", str) == _FISHEYE


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


def _world_from_camera(rig: CameraRig, k: int) -> Gf.Matrix4d:
    """USD's cameras look along -z with y up."""
    matrix = np.eye(4)
    matrix[:3, :3] = rig.R[k].T @ np.diag([1.0, -1.0, -1.0])
    matrix[:3, 3] = rig.centres[k]
    return gf_matrix(matrix)


def _prim_names(names: tuple[str, ...]) -> list[str]:
    """A valid and distinct prim name for each camera."""
    chosen: list[str] = []
    for name in names:
        valid = Tf.MakeValidIdentifier(name)
        chosen.append(valid if valid not in chosen else f"{valid}_{len(chosen)}")
    return chosen
