"""A body's rest shape as a linear space: what can be solved for together with poses, for any skeleton."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mmocap_warp.body.mirroring import mirrored_joints, mirrored_weights
from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.shape_space import paired_targets

_SLIDER_SIGMA = 0.5
_BONE_SIGMA = 0.02  # prior standard deviation of a bone's length [m]
_GIRTH_SIGMA = 0.01  # prior standard deviation of how far the skin lies out [m]
_LOG_SCALE_SIGMA = 0.3
_SIDES_SHARE = 0.5  # half the difference of both sides' bones or girths, as a share of their own standard deviations
_MIN_COSINE = 0.9  # squared; a slider whose displacement is as near as this to another's is left out
_SKIN_SIGMA = 1e-3  # standard deviation of a vertex in `nearest` [m]: small against the prior's


class _Column(NamedTuple):
    """One parameter: how far it moves the skin (vertex, 3) and the joints (joint, 3) at value 1, before scaling [m]."""

    name: str
    sigma: float
    skin: np.ndarray
    joint: np.ndarray


@dataclass(frozen=True, eq=False)
class RestSpace:
    """Rest bodies around one body: ``scale * (rest + sum of parameter * its displacement)``.

    The parameters ``beta`` (parameter,) float64 are zero for the body itself. They are, in this order,

    - sliders, by name, in units of their shape targets. ``<name>_incr`` and ``<name>_decr`` make one column, the mean
      of both sides; a target that ends otherwise is a slider by itself. Two kinds are left out: sliders that do what
      uniform scaling or an earlier slider does (``height``, or both ends of one range as two targets), and those of
      which one side is missing (``age_incr`` alone), for a linear parameter goes both ways;
    - ``bone.<joint>``, by how much the bone from the parent to the joint is longer [m]. Everything below the joint
      moves along, skin beside the bone in proportion. A bone of no length has no parameter;
    - ``girth.<joint>``, by how much the skin that follows the joint lies further out along its normals [m]. Joints
      stay where they are;
    - ``log_scale``, the natural logarithm of the uniform scale.

    Joints that mirror each other share their parameters, such as ``bone.LKnee+RKnee`` (:func:`mirrored_joints`).
    A rigid body has no parameters: it is as it is.
    Attached things are carried along by the joints that they hang on, and keep their size.
    """

    body: BodyModel  # the body at ``beta = 0``

    @cached_property
    def weight(self) -> np.ndarray:
        """(vertex, joint) skinning weights, the same on both sides."""
        return mirrored_weights(self.body)

    @cached_property
    def _columns(self) -> tuple[_Column, ...]:
        """All parameters but the scale."""
        groups, weight = mirrored_joints(self.body), self.weight
        return (*_sliders(self.body), *_bones(self.body, groups, weight), *_girths(self.body, groups, weight))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What each parameter is called."""
        return () if self.body.rigid else (*(column.name for column in self._columns), "log_scale")

    @cached_property
    def sigma(self) -> np.ndarray:
        """(parameter,) float64, prior standard deviations in the parameters' units: how bodies differ from this one."""
        return np.array([] if self.body.rigid else [*(column.sigma for column in self._columns), _LOG_SCALE_SIGMA])

    @cached_property
    def changes_kind(self) -> np.ndarray:
        """(parameter,) bool: sliders of one side only, such as ``gender_female``. People are seldom in between."""
        one_sided = {name for name, _, negative in paired_targets(self.body.shape_names) if negative is None}
        return np.array([name in one_sided for name in self.names], bool)

    def between_sides(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How the left side may be longer or thicker than the right: no parameter of the space, which is symmetric.

        By (difference,) standard deviations [m], and by how far each moves the vertices (difference, vertex, 3) and the
        joints (difference, joint, 3) at 1.
        """
        body, joints = self.body, self.body.skeleton.joints
        pairs = [[joints[one] for one in group] for group in mirrored_joints(body).values() if len(group) == 2]
        alone: dict[str, tuple[int, ...]] = {name: (joints.index(name),) for pair in pairs for name in pair}
        columns: dict[str, _Column] = {}
        if alone and not body.rigid:
            columns = {one.name: one for one in (*_bones(body, alone, self.weight), *_girths(body, alone, self.weight))}
        both = [[columns.get(f"{kind}.{name}") for name in pair] for kind in ("bone", "girth") for pair in pairs]
        two_sided = [(left, right) for left, right in both if left and right]
        return (
            np.array([_SIDES_SHARE * left.sigma for left, _ in two_sided]),
            np.array([left.skin - right.skin for left, right in two_sided]).reshape(-1, *body.skin.rest.shape),
            np.array([left.joint - right.joint for left, right in two_sided]).reshape(-1, *body.joint_rest.shape),
        )

    @cached_property
    def _moved(self) -> tuple[np.ndarray, np.ndarray]:
        """(parameter - 1, vertex, 3), of the full mesh, and (parameter - 1, joint, 3)."""
        return np.stack([each.skin for each in self._columns]), np.stack([each.joint for each in self._columns])

    @cached_property
    def _unscaled(self) -> tuple[np.ndarray, np.ndarray]:
        """(vertex, 3) and (joint, 3) float64; see :attr:`BodyModel.unscaled`."""
        by_vertex, by_joint = (each.astype(np.float64) for each in self.body.unscaled)
        return by_vertex, by_joint

    @cached_property
    def _parts(self) -> dict[bytes | None, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """What :meth:`_part` found, by the vertices that were asked for."""
        return {None: (self._moved[0], self.body.skin.rest.astype(np.float64), self._unscaled[0])}

    def _part(self, vertex: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of some vertices what the parameters move (parameter - 1, vertex, 3), the rest and what is not scaled."""
        key = None if vertex is None else vertex.tobytes()
        if key not in self._parts:
            skin, rest, unscaled = self._parts[None]
            self._parts[key] = np.ascontiguousarray(skin[:, vertex]), rest[vertex], unscaled[vertex]
        return self._parts[key]

    def at(self, beta: np.ndarray, vertex: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The rest body of parameters (parameter,), float64 [m]: vertices (vertex, 3) and joint centres (joint, 3).

        Of the full mesh's vertices those of ``vertex`` are wanted, such as ``body.tracking_vertex``; all where omitted.
        """
        if self.body.rigid:
            rest = self.body.skin.rest if vertex is None else self.body.skin.rest[vertex]
            return rest.astype(np.float64), self.body.joint_rest.astype(np.float64)
        skin, rest, by_vertex = self._part(vertex)
        joints = self._combine(beta, self.body.joint_rest, self._moved[1], self._unscaled[1])
        return self._combine(beta, rest, skin, by_vertex), joints

    def _combine(self, beta: np.ndarray, rest: np.ndarray, column: np.ndarray, unscaled: np.ndarray) -> np.ndarray:
        scale = np.exp(beta[-1])
        grown = scale * (rest.astype(np.float64) + np.tensordot(beta[:-1], column, 1))
        return grown + (1 - scale) * unscaled if self.body.skeleton.attached else grown

    def basis(self, beta: np.ndarray, vertex: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of :meth:`at` by the parameters: (parameter, vertex, 3) and (parameter, joint, 3), float64."""
        rest, joint = self.at(beta, vertex)
        if self.body.rigid:
            return np.zeros((0, *rest.shape)), np.zeros((0, *joint.shape))
        by_skin, _, by_vertex = self._part(vertex)
        scale = np.exp(beta[-1])
        by_joint = np.concatenate([scale * self._moved[1], (joint - self._unscaled[1])[None]])
        return np.concatenate([scale * by_skin, (rest - by_vertex)[None]]), by_joint

    def model(self, beta: np.ndarray) -> BodyModel:
        """The body of some parameters. As with ``BodyModel.shaped`` its shape targets are the old ones, scaled."""
        if self.body.rigid:
            return self.body
        rest, joint = self.at(beta)
        return self.body.with_rest(rest.astype(np.float32), joint.astype(np.float32), np.float32(np.exp(beta[-1])))

    def nearest(self, body: BodyModel) -> np.ndarray:
        """Parameters (parameter,) float64 of the member nearest to another body of the same mesh.

        Least squares over all vertices, seen from the root joint because a pose says where that is, with a weak pull to
        ``beta = 0`` by :attr:`sigma`. Raises a ValueError for other joints or another mesh.
        """
        mine, other = self.body, body
        if other.skeleton.joints != mine.skeleton.joints or not np.array_equal(other.skin.face, mine.skin.face):
            raise ValueError(f"body must have the joints and the mesh of {mine.name!r}, {other.name!r} has others")
        if mine.rigid:
            return np.zeros(0)
        # linear in scale * beta and the scale
        by_vertex, _ = self._unscaled
        own = mine.skin.rest.astype(np.float64) - by_vertex - mine.joint_rest[0]
        skin, joint = self._moved
        column = np.concatenate([skin - joint[:, :1], own[None]]).reshape(len(self.names), -1)
        target = (other.skin.rest.astype(np.float64) - by_vertex - other.joint_rest[0]).ravel()
        normal = column @ column.T / _SKIN_SIGMA**2 + np.diag(self.sigma**-2)
        toward = column @ target / _SKIN_SIGMA**2
        toward[-1] += self.sigma[-1] ** -2  # the scale is pulled to one
        solved = np.linalg.solve(normal, toward)
        return np.append(solved[:-1] / solved[-1], np.log(solved[-1]))


def _sliders(body: BodyModel) -> Iterator[_Column]:
    vertex, joint = body.shape_vertex.astype(np.float64), body.shape_joint.astype(np.float64)
    number = {name: i for i, name in enumerate(body.shape_names)}
    scaled = body.skin.rest.astype(np.float64) - body.joint_rest[0]
    known = [(scaled, np.vdot(scaled, scaled))]  # uniform scaling, then the sliders so far, with their squares
    for name, positive, negative in paired_targets(body.shape_names):
        if negative is None and positive.endswith(("_incr", "_decr")):
            continue
        skin, centre = vertex[number[positive]], joint[number[positive]]
        if negative is not None:
            skin, centre = (skin - vertex[number[negative]]) / 2, (centre - joint[number[negative]]) / 2
        moved = skin - centre[0]
        square = np.vdot(moved, moved)
        if any(np.vdot(moved, one) ** 2 > _MIN_COSINE * square * its_square for one, its_square in known):
            continue
        known.append((moved, square))
        yield _Column(name, _SLIDER_SIGMA, skin, centre)


def _bones(body: BodyModel, groups: dict[str, tuple[int, ...]], weight: np.ndarray) -> Iterator[_Column]:
    rest, place = body.skin.rest.astype(np.float64), body.joint_rest.astype(np.float64)
    below = body.skeleton.below
    for name, group in groups.items():
        parents = [body.skeleton.parent[joint] for joint in group]
        bones = [place[joint] - place[parent] for joint, parent in zip(group, parents, strict=True)]
        lengths = [float(np.linalg.norm(bone)) for bone in bones]
        grows = not (body.skeleton.is_attached[group[0]] or body.skeleton.slides[group[0]])
        if min(parents) < 0 or min(lengths) == 0 or not grows:
            continue
        skin, centre = np.zeros_like(rest), np.zeros_like(place)
        for joint, parent, bone, length in zip(group, parents, bones, lengths, strict=True):
            direction = bone / length
            along = np.clip((rest - place[parent]) @ direction / length, 0, 1)
            skin += (weight[:, below[joint]].sum(axis=1) + weight[:, parent] * along)[:, None] * direction
            centre[below[joint]] += direction
        yield _Column(f"bone.{name}", _BONE_SIGMA * body.relative_size, skin, centre)


def _girths(body: BodyModel, groups: dict[str, tuple[int, ...]], weight: np.ndarray) -> Iterator[_Column]:
    normal = vertex_normals(body.skin.rest.astype(np.float64), body.skin.face)
    tracking = body.tracking_vertex[~normal[body.tracking_vertex].any(axis=1)]  # of a surface laid around open skin
    if len(tracking):
        closed = vertex_normals(body.skin.rest.astype(np.float64), body.tracking_vertex[body.tracking_face])
        normal[tracking] = closed[tracking]
    for name, group in groups.items():
        follows = weight[:, list(group)].sum(axis=1)
        if follows.any() and not body.skeleton.is_attached[group[0]]:
            skin = follows[:, None] * normal
            yield _Column(f"girth.{name}", _GIRTH_SIGMA * body.relative_size, skin, np.zeros(body.joint_rest.shape))


def vertex_normals(rest: np.ndarray, face: np.ndarray) -> np.ndarray:
    """(vertex, 3), outward and of length one; zero where a vertex has no face of any area.

    Diagonals of a quad span its normal, whichever corner it begins with: mirrored faces have mirrored normals.
    """
    corner = rest[face]
    of_face = np.cross(corner[:, 2] - corner[:, 0], corner[:, -1] - corner[:, 1])
    normal = np.zeros_like(rest)
    for side in range(face.shape[1]):
        np.add.at(normal, face[:, side], of_face)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
