"""Meshes as triangles: which piece moves when some of a pose changes, their edges, and whether they are closed."""

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.model import SkinMesh
from mmocap_warp.body.skeleton import Skeleton


@dataclass(frozen=True)
class MeshPiece:
    """Some triangles of a mesh and the vertices that they need."""

    vertex: np.ndarray  # (n,) int32, numbers of vertices
    face: np.ndarray  # (m, 3) int32, corners as numbers of the whole mesh's vertices


def split_mesh(mesh: SkinMesh, skeleton: Skeleton, index: np.ndarray) -> tuple[MeshPiece, MeshPiece]:
    """The triangles that coordinates ``index`` move, wholly or at a corner, and those that they leave alone."""
    moved = np.any(skeleton.moved_by(index)[mesh.joint] & (mesh.weight > 0), axis=1)
    moving = moved[mesh.face].any(axis=1)
    return piece_of(mesh.face[moving]), piece_of(mesh.face[~moving])


def piece_of(face: np.ndarray) -> MeshPiece:
    """The piece of some triangles (m, 3) of a mesh."""
    return MeshPiece(np.unique(face).astype(np.int32), np.ascontiguousarray(face, np.int32))


def mesh_edges(face: np.ndarray) -> np.ndarray:
    """The edges of triangles (m, 3), each with the triangles on its two sides.

    Returns:
        (edge, 4) int32: two vertices, the triangle in which the second follows the first, and the triangle in which
        it precedes it, or -1. Where more than two triangles meet at an edge, they are paired as far as they go.
    """
    triangle = np.tile(np.arange(len(face)), 3)
    start, end = face[:, [0, 1, 2]].T.ravel(), face[:, [1, 2, 0]].T.ravel()
    forward, backward = start.astype(np.int64) << 32 | end, end.astype(np.int64) << 32 | start
    order = np.argsort(forward)
    if np.any(np.diff(forward[order]) == 0):
        return _paired_one_by_one(start, end, triangle)

    # No two triangles run along an edge in the same sense, so that each has one partner at most.
    place = order[np.minimum(np.searchsorted(forward, backward, sorter=order), len(order) - 1)] if len(order) else order
    paired = forward[place] == backward
    first = ~paired | (np.arange(len(order)) < place)
    return np.stack([start, end, triangle, np.where(paired, triangle[place], -1)], axis=1)[first].astype(np.int32)


def _paired_one_by_one(start: np.ndarray, end: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """:func:`mesh_edges` where more than two triangles meet at some edge: of the sides (3 m,) of all triangles."""
    waiting: dict[tuple[int, int], list[int]] = {}
    edges: list[list[int]] = []
    for a, b, t in zip(start.tolist(), end.tolist(), triangle.tolist(), strict=True):
        partners = waiting.get((b, a))
        if partners:
            edges[partners.pop()][3] = t
        else:
            waiting.setdefault((a, b), []).append(len(edges))
            edges.append([a, b, t, -1])
    return np.array(edges, np.int32).reshape(-1, 4)


def is_closed(face: np.ndarray) -> bool:
    """Whether every edge joins exactly two of the faces (face, corner), which run along it in opposite senses."""
    edge = np.stack([face, np.roll(face, -1, axis=1)], axis=-1).reshape(-1, 2)
    edge, count = np.unique(edge, axis=0, return_counts=True)
    return bool((count == 1).all() and np.array_equal(edge, np.unique(edge[:, ::-1], axis=0)))
