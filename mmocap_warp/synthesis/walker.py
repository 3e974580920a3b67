"""Who walks in the built-in scene: a body that no shape of the tracker's own body equals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.formats.usd.body import read_body
from mmocap_warp.scenes import ROOT

BASE = "adult_woman"
SHAPE: dict[str, float] = {
    "weight_incr": 0.35,
    "muscle_incr": 0.25,
    "leg_length_incr": 0.30,
    "arm_length_decr": 0.20,
    "shoulder_width_incr": 0.40,
    "waist_incr": 0.30,
}
STRETCH = (1.02, 0.99, 1.03)
"""Across, up and forward; unequal, so that the tracker's shape targets and scale cannot reach it exactly."""


def walker() -> BodyModel:
    """The shipped woman, heavier, stronger, longer of leg, broader of shoulder, then stretched unequally."""
    return stretched(read_body(ROOT / "bodies" / f"{BASE}.usdc").shaped(SHAPE), "walker", STRETCH)


def stretched(body: BodyModel, name: str, stretch: tuple[float, float, float]) -> BodyModel:
    """A body, named anew, that is ``stretch`` times as wide, as tall and as deep; its joints keep their axes."""
    factors = np.array(stretch, np.float32)
    return replace(
        body,
        name=name,
        joint_rest=body.joint_rest * factors,
        skin=replace(body.skin, rest=body.skin.rest * factors),
        shape_vertex=body.shape_vertex * factors,
        shape_joint=body.shape_joint * factors,
    )
