"""Who moves: three people, and the bodies that a tracker is given for them.

The true bodies are shipped bodies with other shape weights, then stretched unequally, so that no shape of the
tracker's body equals them. The tracker's bodies have the main proportions right, as a person who sets sliders by hand
(or a fit to a first frame) gets them, and lack the rest. S3, the worst tracked subject of the paper, is modelled worst.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.synthesis.exact_posing import ExactPoser


@dataclass(frozen=True)
class Person:
    """One subject.

    Attributes:
        name: such as ``S1``.
        base: the shipped body that both bodies are shaped from.
        shape: true shape weights.
        stretch: across, up and forward, of the true body.
        modelled: shape weights of the tracker's body.
        scale: of the tracker's body.
    """

    name: str
    base: str
    shape: dict[str, float]
    stretch: tuple[float, float, float]
    modelled: dict[str, float]
    scale: float

    def true_body(self) -> BodyModel:
        """Who is seen."""
        return stretched(self._shaped(self.shape), f"{self.name}_true", self.stretch)

    def tracked_body(self) -> BodyModel:
        """Who is tracked."""
        return self._shaped(self.modelled).shaped({}, self.scale)

    @property
    def posed_by(self) -> type[ExactPoser]:
        """What poses the true body."""
        return ExactPoser

    def _shaped(self, weights: dict[str, float]) -> BodyModel:
        """The shipped body with one target after the other: sums of several are rounded differently by CPUs' makes."""
        body = load_body(self.base)
        for name, weight in weights.items():
            body = body.shaped({name: weight})
        return body


PEOPLE: dict[str, Person] = {
    "S1": Person(
        "S1",
        "adult_man",
        {
            "weight_incr": 0.30,
            "muscle_incr": 0.20,
            "leg_length_decr": 0.25,
            "arm_length_incr": 0.20,
            "shoulder_width_incr": 0.25,
            "belly_incr": 0.25,
        },
        (1.01, 0.995, 1.02),
        {"weight_incr": 0.30, "leg_length_decr": 0.15, "arm_length_incr": 0.10, "shoulder_width_incr": 0.20},
        1.0,
    ),
    "S2": Person(
        "S2",
        "adult_woman",
        {
            "muscle_incr": 0.25,
            "leg_length_incr": 0.35,
            "arm_length_decr": 0.15,
            "shoulder_width_incr": 0.30,
            "hip_width_incr": 0.20,
            "waist_incr": 0.25,
        },
        (1.015, 1.02, 1.01),
        {"leg_length_incr": 0.25, "shoulder_width_incr": 0.20, "waist_incr": 0.20},
        1.015,
    ),
    "S3": Person(
        "S3",
        "tall_slim_adult",
        {
            "weight_incr": 0.40,
            "muscle_incr": 0.35,
            "torso_length_incr": 0.30,
            "leg_length_decr": 0.35,
            "arm_length_incr": 0.30,
            "shoulder_width_incr": 0.35,
            "chest_depth_incr": 0.35,
        },
        (1.025, 0.97, 1.04),
        {
            "weight_incr": 0.25,
            "muscle_incr": 0.25,
            "torso_length_incr": 0.15,
            "leg_length_decr": 0.25,
            "arm_length_incr": 0.20,
            "shoulder_width_incr": 0.25,
            "chest_depth_incr": 0.15,
        },
        0.985,
    ),
}
"""By name."""


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


_ANGLE_ERROR = np.radians(1.5)
_PLACE_ERROR = 0.005  # [m]


def fitted_start(person: Person, root_base: np.ndarray, true_pose: np.ndarray, seed: int) -> Subject:
    """The tracker's body where a fit of the first frame might have left it.

    Its joints lie about the true ones as near as they can without turning a bone; then every angle of the 39-DOF model
    is off by 1.5 degrees and the place by 5 mm, as standard deviations.

    Args:
        person: who is tracked.
        root_base: (3, 3), world from body axes at zero root rotation.
        true_pose: (51,), of the true body.
        seed: where the errors' chance comes from.
    """
    body, pose = person.tracked_body(), true_pose.astype(np.float64)
    true_joints, joints = (
        ExactPoser(each, root_base).joint_transforms(pose[None])[0, :, :3, 3] for each in (person.true_body(), body)
    )
    pose[:3] += (true_joints - joints).mean(axis=0)
    rng = np.random.default_rng(seed)
    free = body.skeleton.searched(39)
    pose[free] += np.where(free < 3, _PLACE_ERROR, _ANGLE_ERROR) * rng.standard_normal(len(free))
    pose = np.round(np.clip(pose, *body.skeleton.coordinate_limits.T), 9)  # the same on any machine
    return Subject(body, root_base, pose, {"made_by": "mmocap_warp.synthesis", "person": person.name, "seed": seed})
