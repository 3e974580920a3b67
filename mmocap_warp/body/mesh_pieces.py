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
    """(edge, 4) int32, the edges of faces (m, corner): two vertices, and the faces on the two sides.

    In the first of these faces the second vertex follows the first, in the other it precedes it; there may be none, -1.
    Where more than two faces meet at an edge, they are paired as far as they go.
    """
    owner = np.tile(np.arange(len(face)), face.shape[1])
    start, end = face.T.ravel(), np.roll(face, -1, axis=1).T.ravel()
    forward, backward = start.astype(np.int64) << 32 | end, end.astype(np.int64) << 32 | start
    order = np.argsort(forward)
    if np.any(np.diff(forward[order]) == 0):
        return _paired_one_by_one(start, end, owner)
    # No two faces run along an edge in the same sense, so that each has one partner at most.
    place = order[np.minimum(np.searchsorted(forward, backward, sorter=order), len(order) - 1)] if len(order) else order
    paired = forward[place] == backward
    first = ~paired | (np.arange(len(order)) < place)
    return np.stack([start, end, owner, np.where(paired, owner[place], -1)], axis=1)[first].astype(np.int32)


def _paired_one_by_one(start: np.ndarray, end: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """:func:`mesh_edges` where more than two faces meet at some edge: of the sides (corner * m,) of all faces."""
    waiting: dict[tuple[int, int], list[int]] = {}
    edges: list[list[int]] = []
    for a, b, f in zip(start.tolist(), end.tolist(), owner.tolist(), strict=True):
        partners = waiting.get((b, a))
        if partners:
            edges[partners.pop()][3] = f
        else:
            waiting.setdefault((a, b), []).append(len(edges))
            edges.append([a, b, f, -1])
    return np.array(edges, np.int32).reshape(-1, 4)


def connected(start: np.ndarray, end: np.ndarray, count: int) -> np.ndarray:
    """(count,) the connected piece that each node is in, by edges from ``start`` to ``end``, counted as they come."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(start)), (start, end)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def is_closed(face: np.ndarray) -> bool:
    """Whether every edge joins exactly two of the faces (face, corner), which run along it in opposite senses."""
    edge = np.stack([face, np.roll(face, -1, axis=1)], axis=-1).reshape(-1, 2)
    edge, count = np.unique(edge, axis=0, return_counts=True)
    return bool((count == 1).all() and np.array_equal(edge, np.unique(edge[:, ::-1], axis=0)))
