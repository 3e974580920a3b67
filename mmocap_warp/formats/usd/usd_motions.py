"""A body's own motions as attributes: ``mmocap:name``, ``mmocap:fps``, and ``mmocap:pose``, frame after frame."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from mmocap_warp.body.model import BodyMotion
from mmocap_warp.formats.usd.usd_file import PrimReader, author

_NAME = "Motions"


def define_motions(stage: Usd.Stage, body: Sdf.Path, motions: Mapping[str, BodyMotion]) -> None:
    """Author motions below a body's prim."""
    if not motions:
        return
    above = UsdGeom.Scope.Define(stage, body.AppendChild(_NAME)).GetPath()
    for number, (name, motion) in enumerate(motions.items()):
        scope = UsdGeom.Scope.Define(stage, above.AppendChild(f"Motion{number}"))
        author(scope, "mmocap:name", Sdf.ValueTypeNames.String, name)
        author(scope, "mmocap:fps", Sdf.ValueTypeNames.Double, float(motion.fps))
        pose = Vt.DoubleArray.FromNumpy(np.ascontiguousarray(motion.pose, float).ravel())
        author(scope, "mmocap:pose", Sdf.ValueTypeNames.DoubleArray, pose)


def motions_of(body: PrimReader, coordinates: int) -> dict[str, BodyMotion]:
    """The motions of a body by name.

    Args:
        body: reads its prim.
        coordinates: how long its poses are.

    Raises:
        InputError: one is incomplete, or of another body.
    """
    motions = {}
    above = body.prim.GetChild(_NAME)
    for prim in above.GetChildren() if above else ():
        read = PrimReader(prim, body.source, body.remedy)
        pose, fps = read.array("mmocap:pose", (None,), np.float64), read.typed("mmocap:fps", float)
        read.require(np.isfinite(pose).all(), "mmocap:pose is not finite")
        read.require(0 < fps < np.inf, f"mmocap:fps is {fps}")
        read.require(
            len(pose) > 0 and len(pose) % coordinates == 0,
            f"mmocap:pose holds {len(pose)} values, which are no poses of {coordinates}",
        )
        motions[read.typed("mmocap:name", str)] = BodyMotion(fps, pose.reshape(-1, coordinates))
    return motions
