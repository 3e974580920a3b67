"""The paper's Eq. 20 in two readings: how far markers are from the points of the skin that they were put on.

A marker is put on the nearest point of the skin once and rides on it from there. What lies between marker and skin at
that moment is dropped, so it counts as error. Where the body has a marker of the same name, that one's place says which
skin may be meant: that of the joints that move it. So a hand at the hip does not take the hip's marker. Any other
marker goes to the nearest skin of all. The readings differ in whose skin it is:

- as printed, it is the body's in its initial position: the pose that tracking was given for its first frame, the same
  for all runs. A marker that is not seen in that frame cannot be put there, and is left out.
- from the run's own first answer, it is the body's in that run's answer in the frame where the marker is first seen.
  What this answer is off by there is not counted, which flatters.

The floor of a reading is what the tracked body scores at the true angles, its joints as near the true ones as a shift
brings them: where tracking has no error of its own.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.posing import POSES_AT_ONCE, blocks, joint_positions, skin_positions
from mmocap_warp.result.pose_errors import nanmean
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth


@dataclass(frozen=True)
class SkinPoints:
    """Points attached to a mesh, each at fixed barycentric coordinates of one triangle."""

    corners: np.ndarray  # (point, 3) int, vertices of each point's triangle
    weights: np.ndarray  # (point, 3) float64, barycentric coordinates

    def positions(self, vertices: np.ndarray) -> np.ndarray:
        """Where the points are on a posed mesh: (..., vertex, 3) to (..., point, 3) [m]."""
        return np.einsum("pi,...pia->...pa", self.weights, vertices[..., self.corners, :].astype(np.float64))


def triangulated(faces: np.ndarray) -> np.ndarray:
    """(face, 3) triangles of a mesh of triangles or quads."""
    return faces if faces.shape[1] == 3 else np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])


def attach(points: np.ndarray, vertices: np.ndarray, face: np.ndarray, allowed: np.ndarray | None = None) -> SkinPoints:
    """Attach points to the nearest place on a posed mesh; what lies between a point and the skin is dropped.

    Args:
        points: (point, 3) [m].
        vertices: (vertex, 3), the mesh in the pose in which the points were seen [m].
        face: (face, 3) or (face, 4) vertex indices.
        allowed: (point, vertex) bool, where on the skin each may be: on triangles with such a corner; None for
            anywhere.

    Raises:
        ValueError: a point has no triangle where it may be.
    """
    triangles = triangulated(face)
    corner = vertices[triangles].astype(np.float64)
    centre = corner.mean(axis=1)
    radius = np.linalg.norm(corner - centre[:, None], axis=2).max(axis=1)
    everywhere, (a, b, c) = np.arange(len(triangles)), triangles.T
    # Of all triangles, those which may hold a point's nearest place.
    candidates = []
    for i, point in enumerate(points):
        among = everywhere if allowed is None else np.flatnonzero(allowed[i][a] | allowed[i][b] | allowed[i][c])
        if not len(among):
            raise ValueError(f"allowed leaves no triangle for point {i}")
        away = np.linalg.norm(centre[among] - point, axis=1)
        candidates.append(among[away - radius[among] <= away.min()])
    # The nearest of the places on these, for all points at once.
    triangle = np.concatenate(candidates) if candidates else everywhere[:0]
    point = np.repeat(points, [len(each) for each in candidates], axis=0)
    on_each = _nearest_places(point, corner[triangle])
    distance = ((on_each - point) ** 2).sum(axis=1)
    begin = np.cumsum([0, *map(len, candidates)])
    closest = [first + np.argmin(distance[first:last]) for first, last in pairwise(begin)]
    nearest, place = triangle[closest], on_each[closest]
    weights = np.maximum(_barycentric(place, corner[nearest]), 0.0)  # a place on an edge is outside by a rounding
    return SkinPoints(triangles[nearest], weights / weights.sum(axis=1, keepdims=True))


_ZERO = 1e-13  # square metres, and their squares: so near the border of two cases a point may be in either


def _nearest_places(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(triangle, 3) the place on each triangle (triangle, 3, 3) that is nearest to its point (triangle, 3) [m].

    It is a corner, on an edge or inside: C. Ericson, *Real-Time Collision Detection* (2005), section 5.1.5, has these
    cases and names.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, ac, bc = b - a, c - a, c - b
    (d1, d2), (d3, d4), (d5, d6) = [(_dot(ab, point - corner), _dot(ac, point - corner)) for corner in (a, b, c)]
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    with np.errstate(divide="ignore", invalid="ignore"):  # in the cases that a triangle is not in
        one_edge = np.clip((ac * (point - a)).sum(axis=1) / np.maximum((ac**2).sum(axis=1), 1e-300), 0.0, 1.0)
        on_ab, on_ac, on_bc = d1 / (d1 - d3), d2 / (d2 - d6), (d4 - d3) / ((d4 - d3) + (d5 - d6))
        share = 1.0 / (va + vb + vc)
        inside = a + ab * (vb * share)[:, None] + ac * (vc * share)[:, None]
    cases = (
        ((ab == 0.0).all(axis=1), a + one_edge[:, None] * ac),  # a triangle that is an edge only
        ((d1 < _ZERO) & (d2 < _ZERO), a),
        ((d3 > -_ZERO) & (d4 <= d3), b),
        ((vc < _ZERO) & (d1 > -_ZERO) & (d3 < _ZERO), a + on_ab[:, None] * ab),
        ((d6 > -_ZERO) & (d5 <= d6), c),
        ((vb < _ZERO) & (d2 > -_ZERO) & (d6 < _ZERO), a + on_ac[:, None] * ac),
        ((va < _ZERO) & (d4 - d3 > -_ZERO) & (d5 - d6 > -_ZERO), b + on_bc[:, None] * bc),
    )
    return np.select([case[:, None] for case, _ in cases], [place for _, place in cases], inside)


def _barycentric(place: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(place, 3) barycentric coordinates of places (place, 3) in triangles (place, 3, 3), by Cramer's rule."""
    edge = corners[:, 1:] - corners[:, :1]
    ab, ac, ap = edge[:, 0], edge[:, 1], place - corners[:, 0]
    across = 1.0 / (_dot(ab, ab) * _dot(ac, ac) - _dot(ab, ac) * _dot(ab, ac))
    w = (_dot(ab, ab) * _dot(ac, ap) - _dot(ab, ac) * _dot(ab, ap)) * across
    v = (_dot(ac, ac) * _dot(ab, ap) - _dot(ab, ac) * _dot(ac, ap)) * across
    return np.stack([1 - v - w, v, w], axis=1)


def _dot(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(n,) inner products of vectors (n, 3)."""
    return np.dot(left * right, np.ones(3))


_MIN_SHARE = 0.01  # a joint moves a marker that follows it by this share or more


@dataclass(frozen=True)
class MarkerErrors:
    """Eq. 20 of every run and frame: the mean distance over the markers seen in a frame."""

    as_printed: np.ndarray  # (run, common frame) float64 [m], NaN where no marker counts
    from_own_answer: np.ndarray  # likewise
    # (common frame,) float64 [m]; NaN also where the truth has no poses of a body like the tracked.
    as_printed_floor: np.ndarray
    from_own_answer_floor: np.ndarray  # likewise
    left_out: int  # markers that are seen, but not in the first frame that was tracked: they do not count as printed


def marker_errors(result: Result, truth: Truth, mine: np.ndarray, theirs: np.ndarray) -> MarkerErrors:
    """Both readings and their floors over the frames ``mine`` of the result, which are ``theirs`` of the truth."""
    seen, pose = truth.markers[theirs], result.pose[:, mine]
    known = np.isfinite(seen).all(axis=2)
    from_the_start = mine[0] + result.left_out_before == 0
    start = known[0] if from_the_start else np.zeros(known.shape[1], bool)  # known in the first frame that was tracked
    initial, allowed = result.subject, allowed_skin(result.subject.body, truth.marker_names)
    # As printed, markers are put on the given subject in its own pose, that of the first frame.
    (vertices,) = skin_positions(initial, initial.pose[None], np.arange(len(initial.body.skin.rest)))
    points = attach(seen[0, start], vertices, initial.body.skin.face, allowed[start])

    def both(subject: Subject, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(run, frame) [m] of a subject in poses (run, frame, coordinate): as printed, and from its own answer."""
        as_printed = np.array([_distance(subject, one, seen[:, start], points) for one in pose])
        return as_printed, _from_own_answer(subject, pose, seen, allowed)

    motion = _true_motion(result, truth, theirs)
    floors = np.full((2, len(mine)), np.nan) if motion is None else np.concatenate(both(*motion))
    left_out = int((known.any(axis=0) & ~start).sum())
    return MarkerErrors(*both(initial, pose), floors[0], floors[1], left_out)


def allowed_skin(body: BodyModel, names: tuple[str, ...]) -> np.ndarray:
    """Where on a body's skin markers of these names may be: (marker, vertex) bool, everywhere for an unknown name.

    On what is attached to the body there are none.
    """
    skin = body.skin
    own = dict(zip(body.marker_names, body.marker_vertex, strict=True))
    allowed = np.tile(body.own_vertex, (len(names), 1))
    for row, name in enumerate(names):
        if name in own:
            moved_by = skin.joint[own[name]][skin.weight[own[name]] >= _MIN_SHARE]
            allowed[row] = np.isin(skin.heaviest_joint, moved_by)
    return allowed


def _true_motion(result: Result, truth: Truth, theirs: np.ndarray) -> tuple[Subject, np.ndarray] | None:
    """The tracked body in the true one's axes, and its poses (1, common frame, coordinate) at the true angles."""
    skeleton = result.subject.body.skeleton
    if truth.pose is None or truth.root_base is None or not truth.has_poses_of(skeleton):
        return None
    subject, pose = replace(result.subject, root_base=truth.root_base), truth.pose[theirs]
    apart = truth.joints[theirs, : len(skeleton.joints)] - joint_positions(subject, pose)
    pose[:, :3] += np.nan_to_num(nanmean(apart, axis=1))  # joints that are unknown do not count
    return subject, pose[None]


def _from_own_answer(subject: Subject, pose: np.ndarray, seen: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """(run, frame) [m]: each run puts a marker on its own skin in the frame where the marker is first seen.

    ``subject`` moves through ``pose`` (run, frame, coordinate). Markers are ``seen`` (frame, marker, 3) [m], or NaN,
    and may be put where ``allowed`` (marker, vertex) bool says.
    """
    everywhere = np.arange(len(subject.body.skin.rest))
    known = np.isfinite(seen).all(axis=2)
    ever = np.flatnonzero(known.any(axis=0))
    first = known.argmax(axis=0)[ever]  # frame of each marker that is ever seen
    starts = np.unique(first)
    error = np.empty(pose.shape[:2])
    for run, one in enumerate(pose):
        corners, weights = np.empty((len(ever), 3), int), np.empty((len(ever), 3))
        for start, vertices in zip(starts, skin_positions(subject, one[starts], everywhere), strict=True):
            some = first == start
            attached = attach(seen[start, ever[some]], vertices, subject.body.skin.face, allowed[ever[some]])
            corners[some], weights[some] = attached.corners, attached.weights
        error[run] = _distance(subject, one, seen[:, ever], SkinPoints(corners, weights))
    return error


def _distance(subject: Subject, pose: np.ndarray, seen: np.ndarray, points: SkinPoints) -> np.ndarray:
    """(frame,) [m]: mean distance of the markers ``seen`` (frame, point, 3) from ``points`` of the skin in ``pose``."""
    error = np.full(len(pose), np.nan)
    if not len(points.corners):
        return error
    vertex, corner = np.unique(points.corners, return_inverse=True)
    riding = SkinPoints(corner.reshape(points.corners.shape), points.weights)
    for block in blocks(len(pose), POSES_AT_ONCE):
        place = riding.positions(skin_positions(subject, pose[block], vertex))
        error[block] = nanmean(np.linalg.norm(seen[block] - place, axis=2), axis=1)
    return error
