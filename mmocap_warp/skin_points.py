"""Virtual markers: points that ride on a body's skin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SkinPoints:
    """Points attached to a mesh, each at fixed barycentric coordinates of one triangle.

    Attributes:
        corners: (point, 3) int, vertices of each point's triangle.
        weights: (point, 3) float64, barycentric coordinates.
    """

    corners: np.ndarray
    weights: np.ndarray

    def positions(self, vertices: np.ndarray) -> np.ndarray:
        """Where the points are on a posed mesh: (..., vertex, 3) to (..., point, 3) [m]."""
        return np.einsum("pi,...pia->...pa", self.weights, vertices[..., self.corners, :].astype(np.float64))


def triangulated(faces: np.ndarray) -> np.ndarray:
    """(face, 3) triangles of a mesh of triangles or quads."""
    return faces if faces.shape[1] == 3 else np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])


def attach(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> SkinPoints:
    """Attach points to the nearest place on a posed mesh; what lies between a point and the skin is dropped.

    Args:
        points: (point, 3) [m].
        vertices: (vertex, 3), the mesh in the pose in which the points were seen [m].
        faces: (face, 3) or (face, 4) vertex indices.
    """
    triangles = triangulated(faces)
    corner = vertices[triangles].astype(np.float64)
    nearest, weights = np.zeros(len(points), int), np.zeros((len(points), 3))
    for i, point in enumerate(points):
        nearest[i], weights[i] = _nearest(corner, point)
    return SkinPoints(triangles[nearest], weights)


def _nearest(corner: np.ndarray, point: np.ndarray) -> tuple[int, np.ndarray]:
    """The triangle of ``corner`` (triangle, 3, 3) that is nearest to a point, and where on it: barycentric (3,).

    The nearest place of a triangle is the foot of the perpendicular if that lies inside, else it is on an edge.
    """
    places = np.stack([_foot(corner, point), *(_on_edge(corner, point, k) for k in range(3))])
    away = np.einsum("ptk,tka->pta", places, corner) - point
    distance = np.einsum("pta,pta->pt", away, away)
    distance[(places < 0).any(axis=2) | np.isnan(distance)] = np.inf
    place, triangle = np.unravel_index(distance.argmin(), distance.shape)
    return int(triangle), places[place, triangle]


def _foot(corner: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Barycentric coordinates of the point projected onto each triangle's plane; NaN for one without area."""
    u, v, w = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0], point - corner[:, 0]
    uu, uv, vv, uw, vw = (np.einsum("ta,ta->t", a, b) for a, b in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    area = uu * vv - uv * uv
    area = np.where(area > 0, area, np.nan)
    second, third = (vv * uw - uv * vw) / area, (uu * vw - uv * uw) / area
    return np.stack([1 - second - third, second, third], axis=1)


def _on_edge(corner: np.ndarray, point: np.ndarray, k: int) -> np.ndarray:
    """Barycentric coordinates of the nearest place on the edge from corner ``k`` to the one after it."""
    start, edge = corner[:, k], corner[:, (k + 1) % 3] - corner[:, k]
    length = np.maximum(np.einsum("ta,ta->t", edge, edge), np.finfo(float).tiny)
    along = np.clip(np.einsum("ta,ta->t", point - start, edge) / length, 0.0, 1.0)
    place = np.zeros((len(corner), 3))
    place[:, k], place[:, (k + 1) % 3] = 1 - along, along
    return place
