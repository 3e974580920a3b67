"""The skin's points frame by frame as USD, for programs that know no UsdSkel: a mesh without a skeleton."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import UsdGeom, Vt

from mmocap_warp.formats.usd.usd_animation import new_world, set_time_range, write_animation
from mmocap_warp.formats.usd.usd_camera import define_cameras
from mmocap_warp.result.result import Result


def export_point_cache(result: Result, path: str | Path) -> None:
    """Write the best run's skin, with its points at every frame, and the cameras, in the result's world.

    A frame of a body of 13,000 vertices takes 160 KB.

    Args:
        result: the result.
        path: a ``.usd``, ``.usda``, ``.usdc`` or ``.usdz`` file; it appears whole or not at all.

    Raises:
        InputError: another ending, or a folder that cannot be written.
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
