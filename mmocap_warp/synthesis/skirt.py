"""A skirt that reaches to the knees: it hangs over both legs and flares, and follows the skin of neither.

At each height it goes around all that is there of hips and legs as the tightest convex band would, never narrower
than above, where it hangs from; farther down it stands off more, in folds. It hangs at rest in every pose: it does not
swing.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.synthesis.exact_posing import ExactPoser, led_by

_LEVELS, _SIDES = 16, 48
_VERTICES = _LEVELS * _SIDES + 2  # of the rings from waist to hem, and the middles of the first and the last
_JOINTS_UNDER = ("Root", "BottomSpine", "LHip", "RHip", "LKnee", "RKnee")  # joints that move the skin under the skirt
_HEM = 0.92  # height of the hem, as a share of the way from the root joint down to the knee
_BAND = 1.5  # skin this far above or below a level counts there, in spacings of levels
_LOOSE, _FLARE = 0.008, 0.10  # how far the skirt stands off at the waist, and by how much more at the hem [m]
_FOLD, _FOLDS = 0.016, 7  # half the depth of its folds at the hem [m], and their number


def skirted(body: BodyModel) -> BodyModel:
    """The body with the skirt's vertices and faces after its own; only :class:`SkirtPoser` moves them as a skirt."""
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
    dressed = replace(body, skin=worn, shape_vertex=np.concatenate([body.shape_vertex, bare], axis=1))
    bind = np.zeros((1, body.skeleton.coordinates))
    bind[0, :3] = body.joint_rest[0]
    rest[count:] = SkirtPoser(dressed, np.eye(3)).vertices(bind)[0, count:]
    return dressed


class SkirtPoser(ExactPoser):
    """Poses a body that :func:`skirted` made: its skirt hangs from the posed hips."""

    def vertices(self, poses: np.ndarray) -> np.ndarray:
        """The body's vertices and the skirt's in the world for full poses (n, 51): (n, vertex, 3) float64 [m]."""
        posed = super().vertices(poses)
        for vertices, root in zip(posed, self.joint_transforms(poses)[:, 0, :3], strict=True):
            place, axes = root[:, 3], self._root_base.T @ root[:, :3]
            heading = np.arctan2(axes[0, 2], axes[2, 2])
            under = (vertices[:-_VERTICES][self._covered] - place) @ self._root_base
            vertices[-_VERTICES:] = place + self._skirt_vertices(under, heading) @ self._root_base.T
        return posed

    def _skirt_vertices(self, under: np.ndarray, heading: float) -> np.ndarray:
        """The skirt's vertices, from the skin ``under`` it (vertex, 3); both from the root, in upright axes."""
        index = self._body.skeleton.index
        waist, knee = (self._joint_rest[index(joint), 1] - self._joint_rest[0, 1] for joint in ("BottomSpine", "LKnee"))
        heights = np.linspace(waist, _HEM * knee, _LEVELS)  # of the rings over the root joint, from the waist down [m]
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
        return led_by(self._body, *_JOINTS_UNDER)[:-_VERTICES]


def _convex_band(reach: np.ndarray) -> np.ndarray:
    """Distances from the middle (level, side) of a convex band around what reaches so far in each direction."""
    apart = np.arange(_SIDES) * (2 * np.pi / _SIDES)
    cosine = np.cos(apart[:, None] - apart)
    return np.where(cosine > 0.1, reach[:, None, :] / np.where(cosine > 0.1, cosine, 1.0), np.inf).min(axis=2)


def _faces() -> np.ndarray:
    """(face, 4), counter-clockwise seen from outside: the rings' sides, then a lid on the waist and one on the hem."""
    ring = np.arange(_LEVELS * _SIDES).reshape(_LEVELS, _SIDES)
    after = np.roll(ring, -1, axis=1)
    sides = np.stack([ring[:-1], ring[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    even, two_on = np.arange(0, _SIDES, 2), np.roll(ring, -2, axis=1)
    waist, hem = (np.full(len(even), _LEVELS * _SIDES + i) for i in range(2))
    top = np.stack([waist, ring[0, even], after[0, even], two_on[0, even]], axis=-1)
    bottom = np.stack([hem, two_on[-1, even], after[-1, even], ring[-1, even]], axis=-1)
    return np.concatenate([sides, top, bottom])
