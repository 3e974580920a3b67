"""The world's up axis in USD, whose stages know only +Y and +Z."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from mmocap_warp.formats.usd.attributes import gf_matrix


def set_world_up(stage: Usd.Stage, world: UsdGeom.Xformable, up: str) -> None:
    """Set the stage's metres and up axis, and turn ``world`` where that is needed to show its contents upright.

    Args:
        stage: the stage.
        world: the prim above everything that is given in the cameras' world.
        up: the world's up axis: ``+x``, ``-x``, ``+y``, ``-y``, ``+z`` or ``-z``. The stage's is the same where it is
            +y or +z, else +z.
    """
    stage_up = {"+y": "y"}.get(up, "z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, stage_up.upper())
    if up != f"+{stage_up}":
        turn = np.eye(4)
        turn[:3, :3] = _rotation_onto(stage_up, up)
        world.AddTransformOp().Set(gf_matrix(turn))


def _rotation_onto(stage_up: str, up: str) -> np.ndarray:
    """(3, 3) rotation that takes the signed axis ``up`` to the positive axis ``stage_up``, along other axes."""
    source, target = "xyz".index(up[1]), "xyz".index(stage_up)
    turn = np.roll(np.eye(3), target - source, axis=0)  # cyclic, hence proper: axis `source` becomes `target`
    if up[0] == "-":
        flip = -np.ones(3)
        flip[(target + 1) % 3] = 1.0
        turn = np.diag(flip) @ turn
    return turn
