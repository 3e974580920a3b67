"""A skirt or a coat: it hangs over trunk and legs and flares, and follows the skin of neither.

At each height it goes around all that is there of trunk and legs as the tightest convex band would, never narrower than
above, where it hangs from; farther down it stands off more, in folds. One that swings lags behind the body as a damped
pendulum does; others hang at rest in every pose.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.synthesis.exact_posing import ExactPoser, led_by

_LEVELS, _SIDES = 16, 48
_VERTICES = _LEVELS * _SIDES + 2  # after the body's own: of the rings from top to hem, and the middles of both ends

_BAND = 1.5  # skin this far above or below a level counts there, in spacings of levels
_LOOSE, _FLARE = 0.008, 0.10  # how far it stands off at the top, and by how much more at the hem [m]
_FOLD, _FOLDS = 0.016, 7  # half the depth of its folds at the hem [m], and their number
_RATE, _DAMPING = 5.5, 0.3  # of the pendulum: half a metre of cloth [rad/s], and the share of critical damping
_SECONDS, _MOST_SWING = 1.5, 0.09  # how long it remembers a movement [s], and how far the hem goes at most [m]


@dataclass(frozen=True)
class Garment:
    """What is worn."""

    top: str  # the joint at whose height it begins
    hem: float  # where it ends, as a share of the way from the root joint down to the knee
    under: tuple[str, ...]  # the joints that move the skin under it
    swings: bool
    sleeves: tuple[str, ...] = ()  # the joints whose skin it is


_LEGS = ("LHip", "RHip", "LKnee", "RKnee")
_CHEST, _ARMS = ("BottomSpine", "UpperSpine"), ("LShoulder", "RShoulder", "LElbow", "RElbow")
GARMENTS: dict[str, Garment] = {
    "skirt": Garment("BottomSpine", 0.92, ("Root", "BottomSpine", *_LEGS), swings=False),
    "swinging skirt": Garment("BottomSpine", 0.92, ("Root", "BottomSpine", *_LEGS), swings=True),
    "coat": Garment("UpperSpine", 1.3, ("Root", *_CHEST, *_LEGS), True, (*_CHEST, *_ARMS)),
}
"""By name."""


def dressed(body: BodyModel, garment: Garment) -> BodyModel:
    """The body with a garment's vertices and faces after its own; only :class:`GarmentPoser` moves them as cloth."""
    skin, count = body.skin, len(body.skin.rest)
    joint, weight = np.zeros((_VERTICES, 4), np.int32), np.zeros((_VERTICES, 4), np.float32)
    weight[:, 0] = 1.0
    rest = np.concatenate([skin.rest, np.tile(body.joint_rest[:1], (_VERTICES, 1))])
    worn = replace(
        skin,
        rest=rest,
        face=np.concatenate([skin.face, (count + _faces()).astype(skin.face.dtype)]),
        joint=np.concatenate([skin.joint, joint]),
        weight=np.concatenate([skin.weight, weight]),
    )
    bare = np.zeros((len(body.shape_names), _VERTICES, 3), np.float32)
    clothed = replace(body, skin=worn, shape_vertex=np.concatenate([body.shape_vertex, bare], axis=1))
    bind = np.zeros((1, body.skeleton.coordinates))
    bind[0, :3] = body.joint_rest[0]
    rest[count:] = GarmentPoser(clothed, np.eye(3), garment).vertices(bind)[0, count:]
    return clothed


def worn_vertices(body: BodyModel, garment: Garment) -> np.ndarray:
    """(vertex,) bool: what of a body that was :func:`dressed` is the garment's."""
    cloth = np.arange(len(body.skin.rest)) >= len(body.skin.rest) - _VERTICES
    return cloth | led_by(body, *garment.sleeves)


class GarmentPoser(ExactPoser):
    """Poses a body that was :func:`dressed`: its garment hangs from the posed trunk."""

    def __init__(self, body: BodyModel, root_base: np.ndarray, garment: Garment) -> None:
        super().__init__(body, root_base)
        self._garment = garment

    def vertices(self, poses: np.ndarray) -> np.ndarray:
        """The body's vertices and the garment's at rest for full poses (n, 51): (n, vertex, 3) float64 in m."""
        posed = super().vertices(poses)
        for vertices, root in zip(posed, self.joint_transforms(poses)[:, 0, :3], strict=True):
            place, axes = root[:, 3], self._root_base.T @ root[:, :3]
            heading = np.arctan2(axes[0, 2], axes[2, 2])
            under = (vertices[:-_VERTICES][self._covered] - place) @ self._root_base
            vertices[-_VERTICES:] = place + self._cloth(under, heading) @ self._root_base.T
        return posed

    def moving(self, poses: np.ndarray, frame: int, fps: float) -> np.ndarray:
        """The vertices in a frame of a motion (frame, 51): (vertex, 3) float64, with the garment swung [m]."""
        vertices = super().moving(poses, frame, fps)
        if self._garment.swings:
            depth = np.append(np.repeat(np.linspace(0.0, 1.0, _LEVELS), _SIDES), (0.0, 1.0))
            vertices[-_VERTICES:] += (depth**2)[:, None] * self._swing(poses, frame, fps)
        return vertices

    def _swing(self, poses: np.ndarray, frame: int, fps: float) -> np.ndarray:
        """(3,) how far the hem is from where it hangs at rest: the answer of a damped pendulum to the past [m]."""
        count = round(_SECONDS * fps)
        velocity = np.diff(poses[max(frame - count - 1, 0) : frame + 1, :3], axis=0)
        # The latest first; before its first frame the body moved as it does there.
        accelerated = np.zeros((count, 3))
        accelerated[: max(len(velocity) - 1, 0)] = np.diff(velocity, axis=0)[::-1] * fps**2
        ago, damped = np.arange(count) / fps, _RATE * np.sqrt(1 - _DAMPING**2)
        answer = np.exp(-_DAMPING * _RATE * ago) * np.sin(damped * ago) / damped / fps
        swing = -answer @ accelerated
        swing -= swing @ self._root_base[:, 1] * self._root_base[:, 1]  # up stays as it is
        return swing / max(1.0, float(np.linalg.norm(swing)) / _MOST_SWING)

    def _cloth(self, under: np.ndarray, heading: float) -> np.ndarray:
        """The garment's vertices, from the skin ``under`` it (vertex, 3); both from the root, in upright axes."""
        index, hem = self._body.skeleton.index, self._garment.hem
        height = self._joint_rest[:, 1] - self._joint_rest[0, 1]
        top, knee = height[index(self._garment.top)], height[index("LKnee")]
        heights = np.linspace(top, hem * knee, _LEVELS)  # of the rings over the root joint, from the top down [m]
        angle = heading + np.arange(_SIDES) * (2 * np.pi / _SIDES)
        directions = np.stack([np.sin(angle), np.cos(angle)])  # (axis, side)
        reach = under[:, [0, 2]] @ directions  # (vertex, side)
        near = np.abs(under[:, 1] - heights[:, None]) < _BAND * (heights[0] - heights[1])
        band = np.stack([reach[each].max(axis=0, initial=0.0) for each in near])
        radius = _convex_band(np.maximum.accumulate(band, axis=0))
        depth = np.linspace(0.0, 1.0, _LEVELS)[:, None]
        radius += _LOOSE + depth * (_FLARE + _FOLD * np.cos(_FOLDS * (angle - heading)))
        rings = np.empty((_LEVELS, _SIDES, 3))
        rings[..., [0, 2]], rings[..., 1] = radius[..., None] * directions.T, heights[:, None]
        return np.concatenate([rings.reshape(-1, 3), np.array([[0.0, heights[0], 0.0], [0.0, heights[-1], 0.0]])])

    @cached_property
    def _covered(self) -> np.ndarray:
        """(vertex,) bool, of the body's own skin."""
        return led_by(self._body, *self._garment.under)[:-_VERTICES]


def _convex_band(reach: np.ndarray) -> np.ndarray:
    """Distances from the middle (level, side) of a convex band around what reaches so far in each direction."""
    apart = np.arange(_SIDES) * (2 * np.pi / _SIDES)
    cosine = np.cos(apart[:, None] - apart)
    return np.where(cosine > 0.1, reach[:, None, :] / np.where(cosine > 0.1, cosine, 1.0), np.inf).min(axis=2)


def _faces() -> np.ndarray:
    """(face, 4), counter-clockwise seen from outside: the rings' sides, then a lid on the top and one on the hem."""
    ring = np.arange(_LEVELS * _SIDES).reshape(_LEVELS, _SIDES)
    after = np.roll(ring, -1, axis=1)
    sides = np.stack([ring[:-1], ring[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    even, two_on = np.arange(0, _SIDES, 2), np.roll(ring, -2, axis=1)
    top, hem = (np.full(len(even), _LEVELS * _SIDES + i) for i in range(2))
    lid = np.stack([top, ring[0, even], after[0, even], two_on[0, even]], axis=-1)
    bottom = np.stack([hem, two_on[-1, even], after[-1, even], ring[-1, even]], axis=-1)
    return np.concatenate([sides, lid, bottom])
