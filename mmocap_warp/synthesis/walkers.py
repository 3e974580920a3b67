"""Who moves: three people, three strangers, and the bodies that a tracker is given for them.

The true bodies are shipped bodies with other shape weights, then stretched unequally, so that no shape of the
tracker's body equals them. The tracker's bodies have the main proportions right, as a person who sets sliders by hand
(or a fit to a first frame) gets them, and lack the rest. S3, the worst tracked subject of the paper, is modelled worst.

Of the strangers each segment has a length and a girth of its own, or they wear what does not move with the skin: what a
tracker does with them shows how much it owes to the family of its bodies.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.garment import GARMENTS, GarmentPoser, dressed

_UP = np.array([0.0, 1.0, 0.0])
_LIMBS: dict[str, str] = {
    side + joint: side + end
    for side in "LR"
    for joint, end in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Hip", "Knee"), ("Knee", "Ankle"))
}
"""The joint at the end of a segment that does not stand upright in the bind pose."""


@dataclass(frozen=True)
class Person:
    """One subject."""

    name: str  # such as ``S1``
    base: str  # the shipped body that both bodies are shaped from
    shape: dict[str, float]  # true shape weights
    stretch: tuple[float, float, float]  # across, up and forward, of the true body
    modelled: dict[str, float]  # shape weights of the tracker's body
    scale: float  # of the tracker's body
    # By joint, length and girth of what hangs on it, where the true body's differ; None for none.
    segments: Mapping[str, Sequence[float]] | None = None
    garment: str | None = None  # what the true body wears, of :data:`mmocap_warp.synthesis.garment.GARMENTS`

    def true_body(self) -> BodyModel:
        """Who is seen; without shape targets where segments were resized."""
        body = stretched(self._shaped_body(self.shape), f"{self.name}_true", self.stretch)
        if self.segments is not None:
            body = resized(body, self.segments)
        return dressed(body, GARMENTS[self.garment]) if self.garment else body

    def tracked_body(self) -> BodyModel:
        """Who is tracked."""
        return self._shaped_body(self.modelled).shaped({}, self.scale)

    @property
    def posed_by(self) -> Callable[[BodyModel, np.ndarray], ExactPoser]:
        """Makes what poses the true body."""
        return partial(GarmentPoser, garment=GARMENTS[self.garment]) if self.garment else ExactPoser

    def _shaped_body(self, weights: dict[str, float]) -> BodyModel:
        """The shipped body with one target after the other: CPUs round sums of several differently."""
        body = load_body(self.base)
        for name, weight in weights.items():
            body = body.shaped({name: weight})
        return body


def _read_people(group: str) -> dict[str, Person]:
    """The people of a group in ``walkers.toml``."""
    people = tomllib.loads(files(__package__).joinpath("walkers.toml").read_text(encoding="utf-8"))[group]
    return {name: Person(name, **(about | {"stretch": tuple(about["stretch"])})) for name, about in people.items()}


PEOPLE: dict[str, Person] = _read_people("people")
"""By name."""

STRANGERS: dict[str, Person] = _read_people("strangers")
"""By name, those whom no shape of the tracker's body comes near."""


def resized(body: BodyModel, segments: Mapping[str, Sequence[float]]) -> BodyModel:
    """A body, without shape targets, whose segments have other lengths and girths; joints keep their axes.

    Where a segment goes over into the next, the skin goes over from one size to the other as its weights do. Segments
    are factors of length and girth by the joint that each hangs on; others keep their size, which is 1. Raises a
    ValueError for a joint that the body does not have.
    """
    skeleton, rest = body.skeleton, body.joint_rest.astype(float)
    # Each segment is stretched along its bone by its length, and across it by its girth.
    factors = np.tile(np.eye(3), (len(rest), 1, 1))
    for name, (length, girth) in segments.items():
        j, along = skeleton.index(name), _UP
        if name in _LIMBS:
            bone = rest[skeleton.index(_LIMBS[name])] - rest[j]
            along = bone / np.linalg.norm(bone)
        factors[j] = girth * np.eye(3) + (length - girth) * np.outer(along, along)
    # Joints from the root on, then the skin, which follows several segments by their weights.
    place = rest.copy()
    for j, parent in enumerate(skeleton.parent):
        if parent >= 0:
            place[j] = place[parent] + factors[parent] @ (rest[j] - rest[parent])
    skin = body.skin
    away = skin.rest.astype(float)[:, None] - rest[skin.joint]  # (vertex, influence, 3)
    moved = place[skin.joint] + np.einsum("viab,vib->via", factors[skin.joint], away)
    weight = skin.weight.astype(float)
    vertex = (weight[..., None] * moved).sum(axis=1) / weight.sum(axis=1, keepdims=True)
    # The feet stay on the floor.
    floor = (0.0, vertex[:, 1].min() - skin.rest[:, 1].min(), 0.0)
    unshaped = replace(body, shape_names=(), shape_vertex=body.shape_vertex[:0], shape_joint=body.shape_joint[:0])
    return unshaped.with_rest((vertex - floor).astype(np.float32), (place - floor).astype(np.float32), np.float32(1))


def stretched(body: BodyModel, name: str, stretch: tuple[float, float, float]) -> BodyModel:
    """A body with a new name, ``stretch`` times as wide, tall and deep; its joints keep their axes."""
    factors = np.array(stretch, np.float32)
    return replace(body.with_rest(body.skin.rest * factors, body.joint_rest * factors, factors), name=name)


_ANGLE_ERROR = np.radians(1.5)  # standard deviation of the angles with which tracking starts
_PLACE_ERROR = 0.005  # standard deviation of the place where tracking starts [m]


def fitted_start(person: Person, root_base: np.ndarray, true_pose: np.ndarray, seed: int) -> Subject:
    """The tracker's body where a fit of the first frame might have left it.

    Its joints lie about the true ones, of ``true_pose`` (coordinate,), as near as they can without turning a bone; then
    every angle of the 39-DOF model is off by 1.5 degrees and the place by 5 mm, as standard deviations. ``root_base``
    (3, 3) is the world from body axes at zero root rotation.
    """
    body, pose = person.tracked_body(), true_pose.astype(np.float64)
    posers = (ExactPoser(each, root_base) for each in (person.true_body(), body))
    true_joints, joints = (poser.joint_transforms(pose[None])[0, :, :3, 3] for poser in posers)
    pose[:3] += (true_joints - joints).mean(axis=0)
    rng = np.random.default_rng(seed)
    free = body.skeleton.searched(39)
    pose[free] += np.where(free < 3, _PLACE_ERROR, _ANGLE_ERROR) * rng.standard_normal(len(free))
    pose = np.round(np.clip(pose, *body.skeleton.coordinate_limits.T), 9)  # the same on any machine
    return Subject(body, root_base, pose, {"made_by": "mmocap_warp.synthesis", "person": person.name, "seed": seed})
