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


def attach(
    points: np.ndarray, vertices: np.ndarray, faces: np.ndarray, allowed: np.ndarray | None = None
) -> SkinPoints:
    """Attach points to the nearest place on a posed mesh; what lies between a point and the skin is dropped.

    Args:
        points: (point, 3) [m].
        vertices: (vertex, 3), the mesh in the pose in which the points were seen [m].
        faces: (face, 3) or (face, 4) vertex indices.
        allowed: (point, vertex) bool, where on the skin each may be: on triangles with such a corner; None for
            anywhere.

    Raises:
        ValueError: a point has no triangle where it may be.
    """
    import trimesh  # half a second that most commands need not spend

    triangles = triangulated(faces)
    corner = vertices[triangles].astype(np.float64)
    centre = corner.mean(axis=1)
    radius = np.linalg.norm(corner - centre[:, None], axis=2).max(axis=1)
    everywhere = np.arange(len(triangles))
    place = np.zeros((len(points), 3))
    nearest = np.zeros(len(points), int)
    for i, point in enumerate(points):
        among = everywhere if allowed is None else np.flatnonzero(allowed[i, triangles].any(axis=1))
        if not len(among):
            raise ValueError(f"allowed leaves no triangle for point {i}")
        away = np.linalg.norm(centre[among] - point, axis=1)
        near = among[away - radius[among] <= away.min()]  # no other triangle can hold the nearest place
        on_each = trimesh.triangles.closest_point(corner[near], np.broadcast_to(point, (len(near), 3)))
        closest = np.argmin(((on_each - point) ** 2).sum(axis=1))
        nearest[i], place[i] = near[closest], on_each[closest]
    weights = trimesh.triangles.points_to_barycentric(corner[nearest], place) if len(points) else place
    weights = np.maximum(weights, 0.0)  # a place on an edge is outside by a rounding
    return SkinPoints(triangles[nearest], weights / weights.sum(axis=1, keepdims=True))
