"""Coarsen a closed mesh while keeping its own vertices, so that what is stored per vertex carries over."""

from __future__ import annotations

import numpy as np


def decimate(vertex: np.ndarray, face: np.ndarray, triangles: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed mesh of about ``triangles`` triangles over a subset of a closed mesh's vertices.

    Quadric decimation (Garland and Heckbert 1997), then each new vertex moves to the nearest old one.

    Args:
        vertex: (vertex, 3) positions.
        face: (face, 3) int, closed and consistently wound.
        triangles: how many to aim at.

    Returns:
        the kept vertices, (n,) int32, ascending, and triangles over them, (m, 3) int32.

    Raises:
        ValueError: the result is not closed; another number of triangles may do.
    """
    from fast_simplification import simplify  # an extra, needed only to make bodies

    coarse, triangle = simplify(vertex.astype(np.float32), face.astype(np.int32), target_count=triangles)
    nearest = np.array([((vertex - point) ** 2).sum(axis=1).argmin() for point in coarse])
    kept, renumbered = np.unique(nearest, return_inverse=True)
    triangle = renumbered[triangle]
    collapsed = (triangle == np.roll(triangle, 1, axis=1)).any(axis=1)
    triangle = triangle[~collapsed]
    if not is_closed(triangle):
        raise ValueError(f"decimation to {triangles} triangles left the mesh open; ask for another number")
    return kept.astype(np.int32), triangle.astype(np.int32)


def is_closed(face: np.ndarray) -> bool:
    """Whether every edge joins exactly two faces that run along it in opposite senses.

    Args:
        face: (face, corner) int.
    """
    edge = np.stack([face, np.roll(face, -1, axis=1)], axis=-1).reshape(-1, 2)
    edge, count = np.unique(edge, axis=0, return_counts=True)
    backward = np.unique(edge[:, ::-1], axis=0)
    return bool((count == 1).all() and np.array_equal(edge, backward))
