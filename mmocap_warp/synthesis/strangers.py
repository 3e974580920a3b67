"""People whom no shape of the tracker's body comes near: unequal limbs, a skirt, a child's proportions.

The true bodies of :mod:`mmocap_warp.synthesis.walkers` are shaped by the targets that the tracker's bodies have, and
stretched as a whole. Of these here each segment has a length and a girth of its own, or wears what does not move with
the skin; what a tracker does with them shows how much it owes to that family.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.skirt import SkirtPoser, skirted
from mmocap_warp.synthesis.walkers import Person

Size = tuple[float, float]
"""Of a segment, as factors: its length, and its girth."""

_UP = np.array([0.0, 1.0, 0.0])
_LIMBS: dict[str, str] = {
    side + joint: side + end
    for side in "LR"
    for joint, end in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Hip", "Knee"), ("Knee", "Ankle"))
}
"""The joint at the end of a segment that does not stand upright in the bind pose."""


@dataclass(frozen=True)
class Stranger(Person):
    """One of them.

    Attributes:
        segments: sizes of the segments that hang on joints; those that are not named keep theirs.
        skirt: whether one is worn, see :mod:`mmocap_warp.synthesis.skirt`.
    """

    segments: Mapping[str, Size] = field(default_factory=dict)
    skirt: bool = False

    def true_body(self) -> BodyModel:
        """Who is seen; without shape targets."""
        body = resized(super().true_body(), self.segments)
        return skirted(body) if self.skirt else body

    @property
    def posed_by(self) -> type[ExactPoser]:
        """What poses the true body."""
        return SkirtPoser if self.skirt else ExactPoser


def resized(body: BodyModel, segments: Mapping[str, Size]) -> BodyModel:
    """A body, without shape targets, whose segments have other lengths and girths; joints keep their axes.

    Where a segment goes over into the next, the skin goes over from one size to the other as its weights do.

    Args:
        body: whose sizes are 1.
        segments: by the joint that a segment hangs on; those that are not named keep their size.

    Raises:
        ValueError: a joint that the body does not have.
    """
    skeleton, rest = body.skeleton, body.joint_rest.astype(float)
    factors = np.tile(np.eye(3), (len(rest), 1, 1))
    for name, (length, girth) in segments.items():
        j, along = skeleton.index(name), _UP
        if name in _LIMBS:
            bone = rest[skeleton.index(_LIMBS[name])] - rest[j]
            along = bone / np.linalg.norm(bone)
        factors[j] = girth * np.eye(3) + (length - girth) * np.outer(along, along)
    place = rest.copy()
    for j, parent in enumerate(skeleton.parent):
        if parent >= 0:
            place[j] = place[parent] + factors[parent] @ (rest[j] - rest[parent])
    skin = body.skin
    away = skin.rest.astype(float)[:, None] - rest[skin.joint]  # (vertex, influence, 3)
    moved = place[skin.joint] + np.einsum("viab,vib->via", factors[skin.joint], away)
    weight = skin.weight.astype(float)
    vertex = (weight[..., None] * moved).sum(axis=1) / weight.sum(axis=1, keepdims=True)
    floor = (0.0, vertex[:, 1].min() - skin.rest[:, 1].min(), 0.0)
    return replace(
        body,
        joint_rest=(place - floor).astype(np.float32),
        skin=replace(skin, rest=(vertex - floor).astype(np.float32)),
        shape_names=(),
        shape_vertex=np.zeros((0, *vertex.shape), np.float32),
        shape_joint=np.zeros((0, *rest.shape), np.float32),
    )


def _both(sizes: dict[str, Size]) -> dict[str, Size]:
    """The same on both sides."""
    return {side + joint: size for side in "LR" for joint, size in sizes.items()}


STRANGERS: dict[str, Stranger] = {
    "Uneven": Stranger(
        "Uneven",
        "adult_man",
        {"weight_incr": 0.20},
        (1.0, 1.0, 1.0),
        {"weight_incr": 0.20, "leg_length_decr": 0.20, "torso_length_incr": 0.20},
        1.0,
        segments={
            "Root": (1.00, 1.06),
            "BottomSpine": (1.08, 1.04),
            "UpperSpine": (1.05, 1.08),
            "Neck": (0.95, 0.95),
            "LShoulder": (1.08, 0.95),
            "LElbow": (1.08, 0.95),
            "LWrist": (1.05, 1.05),
            "RShoulder": (0.96, 1.12),
            "RElbow": (0.97, 1.10),
            "LHip": (0.95, 1.10),
            "LKnee": (0.96, 1.08),
            "RHip": (0.97, 0.95),
            "RKnee": (0.98, 1.00),
        },
    ),
    "Skirt": Stranger(
        "Skirt",
        "adult_woman",
        {"muscle_incr": 0.15, "leg_length_incr": 0.20, "shoulder_width_incr": 0.15, "waist_decr": 0.10},
        (1.01, 1.0, 1.015),
        {"leg_length_incr": 0.15, "shoulder_width_incr": 0.10},
        1.0,
        skirt=True,
    ),
    "Child": Stranger(
        "Child",
        "adult_woman",
        {},
        (1.0, 1.0, 1.0),
        {"leg_length_decr": 0.50, "arm_length_decr": 0.50, "torso_length_incr": 0.30},
        0.71,
        segments={
            "Root": (0.66, 0.68),
            "BottomSpine": (0.70, 0.72),
            "UpperSpine": (0.70, 0.68),
            "Neck": (0.98, 0.98),
        }
        | _both(
            {
                "Shoulder": (0.63, 0.63),
                "Elbow": (0.62, 0.64),
                "Wrist": (0.65, 0.65),
                "Hip": (0.60, 0.64),
                "Knee": (0.61, 0.65),
                "Ankle": (0.65, 0.65),
            }
        ),
    ),
}
"""By name."""
