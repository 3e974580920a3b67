"""A closed surface for tracking from skin that may have holes, or be made of parts that overlap.

Files repeat a vertex wherever colours or normals change: skin is welded first.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mmocap_warp.body.mesh_pieces import is_closed, mesh_edges
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh
from mmocap_warp.rigging.importing.wrapping import wrapped

_SAME = 1e-5  # vertices as near as this are one, as a share of the mesh's extent


def welded(mesh: RiggedMesh) -> RiggedMesh:
    """The mesh with one vertex for each place, and without triangles that have no area or occur twice.

    Of vertices that are joined the weights are averaged; rigid parts are not joined to each other. Vertices of no
    triangle are left out.

    Raises:
        ValueError: a mesh of no extent.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    extent = float(np.ptp(mesh.vertex, axis=0).max())
    if not 0 < extent < np.inf:
        raise ValueError("the mesh has no extent")
    # Places in units of the tolerance; parts of a rigid mesh are kept apart by a further coordinate.
    tolerance = _SAME * extent
    apart = mesh.influence[:, :1].astype(float) if mesh.rigid else np.zeros((len(mesh.vertex), 0))
    scaled = np.concatenate([mesh.vertex / tolerance, 2 * apart], axis=1)
    # Vertices of one cell are joined first: where many crowd, few pairs are left to look at.
    _, first, cell = np.unique(np.round(2 * scaled), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # the file's own order
    first, cell = first[order], np.argsort(order)[cell]
    near = cKDTree(scaled[first]).query_pairs(1.0, output_type="ndarray")
    joined = coo_matrix((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(first), len(first)))
    place = connected_components(joined, directed=False)[1][cell.ravel()]
    # Triangles over the joined vertices, without those of no area and those that are there twice.
    face = place[mesh.face]
    face = face[(face[:, 0] != face[:, 1]) & (face[:, 1] != face[:, 2]) & (face[:, 2] != face[:, 0])]
    _, whole = np.unique(np.sort(face, axis=1), axis=0, return_index=True)
    kept, face = np.unique(face[np.sort(whole)], return_inverse=True)

    # A joined vertex has the mean of its vertices' influences and places.
    dense = np.zeros((place.max() + 1, len(mesh.joints)))
    np.add.at(dense, (place[:, None], mesh.influence), mesh.weight)
    dense = dense[kept] / np.bincount(place)[kept, None]
    most = max(int((dense > 0).sum(axis=1).max(initial=0)), 1)
    influence = np.argsort(-dense, axis=1, kind="stable")[:, :most]
    vertex = np.zeros((place.max() + 1, 3))
    np.add.at(vertex, place, mesh.vertex)
    vertex /= np.bincount(place)[:, None]
    return replace(
        mesh,
        vertex=vertex[kept],
        face=face.reshape(-1, 3),
        influence=influence,
        weight=np.take_along_axis(dense, influence, axis=1),
    )


def four_influences(mesh: RiggedMesh) -> tuple[np.ndarray, np.ndarray, float]:
    """Each vertex's heaviest joints (vertex, 4) int32, weights (vertex, 4) float32 of sum one, and what was dropped.

    The last is the largest share of a vertex's weight that its other joints had. Vertices that follow no joint follow
    the root.
    """
    total = mesh.weight.sum(axis=1)
    share = np.divide(mesh.weight, total[:, None], out=np.zeros_like(mesh.weight), where=total[:, None] > 0)
    pad = max(4 - share.shape[1], 0)
    share, joint = np.pad(share, ((0, 0), (0, pad))), np.pad(mesh.influence, ((0, 0), (0, pad)))
    order = np.argsort(-share, axis=1, kind="stable")[:, :4]
    weight, joint = np.take_along_axis(share, order, axis=1), np.take_along_axis(joint, order, axis=1)
    kept = weight.sum(axis=1)
    dropped = float((1 - kept[total > 0]).max(initial=0.0))
    weight[total == 0], kept[total == 0] = (1, 0, 0, 0), 1.0
    weight = weight / kept[:, None]
    return np.where(weight > 0, joint, 0).astype(np.int32), weight.astype(np.float32), max(dropped, 0.0)


_MOST_HOLES = 200  # skin with more holes is wrapped instead of closed
MOST_TRIANGLES, CELLS = 20_000, 40
"""A mesh of more triangles is wrapped, which is quicker than making it coarser; and the grid's cells along its side."""


class ClosedMesh(NamedTuple):
    """A closed mesh.

    Attributes:
        added: (n, 3) vertices that the mesh had not.
        beside: (n,) int, for each of these a vertex that the mesh had, near by: it moves as that one does.
        face: (face, 3) over the mesh's vertices and then ``added``, counter-clockwise seen from outside.
        done: what was done; empty where the mesh was closed.
    """

    added: np.ndarray
    beside: np.ndarray
    face: np.ndarray
    done: str


def closed(vertex: np.ndarray, face: np.ndarray, most: int = MOST_TRIANGLES, cells: int = CELLS) -> ClosedMesh:
    """The mesh itself where it is closed; else with its holes filled; else wrapped in a new surface.

    Args:
        vertex: (vertex, 3).
        face: (face, 3), welded, see :func:`welded`.
        most: triangles; a mesh of more is wrapped in any case.
        cells: of the grid in which it is wrapped, along its longest side.
    """
    if len(face) > most:
        return _wrap(vertex, face, cells, f"it has {len(face)} triangles")
    wound = face if is_closed(face) else consistently_wound(face)
    rims = None if wound is None else _hole_rims(wound)
    if wound is None or rims is None or len(rims) > _MOST_HOLES:
        return _wrap(vertex, face, cells, "it is not a surface with a few holes")
    middle = np.array([vertex[rim].mean(axis=0) for rim in rims]).reshape(-1, 3)
    whole = _with_filled_holes(wound, rims, len(vertex))
    if not is_closed(whole):
        return _wrap(vertex, face, cells, "it is open")
    beside = np.array([rim[0] for rim in rims], int)
    done = "" if not rims else f"{len(rims)} hole{'s' if len(rims) > 1 else ''} filled"
    return ClosedMesh(middle, beside, outward(np.concatenate([vertex, middle]), whole), done)


def _wrap(vertex: np.ndarray, face: np.ndarray, cells: int, why: str) -> ClosedMesh:
    corner, triangle, beside = wrapped(vertex, face, cells)
    return ClosedMesh(corner, beside, triangle + len(vertex), f"wrapped in a new surface, for {why}")


def consistently_wound(face: np.ndarray) -> np.ndarray | None:
    """The triangles, some turned round so that neighbours run along their edge in opposite senses.

    None where an edge has more than two triangles, or the surface has one side only.
    """
    neighbours = _neighbours(face)
    if neighbours is None:
        return None
    turned = np.where(_faces_to_turn(len(face), *neighbours)[:, None], face[:, ::-1], face)
    directed = np.concatenate([turned[:, [0, 1]], turned[:, [1, 2]], turned[:, [2, 0]]])
    return turned if len(np.unique(directed, axis=0)) == len(directed) else None


def _neighbours(face: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """The two triangles at each edge, (edge,) and (edge,), and (edge,) bool whether both run along it in one sense.

    None where an edge has more than two triangles.
    """
    directed = np.stack([face, np.roll(face, -1, axis=1)], axis=-1).reshape(-1, 2)
    owner = np.repeat(np.arange(len(face)), 3)
    _, edge, count = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    if count.max(initial=0) > 2:
        return None
    order = np.argsort(edge.ravel(), kind="stable")
    first, second = order[count[edge.ravel()[order]] == 2].reshape(-1, 2).T
    return owner[first], owner[second], directed[first, 0] == directed[second, 0]


def _faces_to_turn(faces: int, first: np.ndarray, second: np.ndarray, alike: np.ndarray) -> np.ndarray:
    """(face,) bool: which triangles to turn round so that neighbours agree."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import breadth_first_order

    graph = coo_matrix((np.where(alike, 2, 1), (first, second)), shape=(faces, faces)).tocsr()
    graph = graph.maximum(graph.T)
    turned, reached = np.zeros(faces, bool), np.zeros(faces, bool)
    while not reached.all():
        order, before = breadth_first_order(graph, int(reached.argmin()))
        reached[order] = True
        against = np.asarray(graph[before[order[1:]], order[1:]]).ravel() == 2
        for face, turn in zip(order[1:].tolist(), against.tolist(), strict=True):
            turned[face] = turned[before[face]] ^ turn
    return turned


def outward(vertex: np.ndarray, face: np.ndarray) -> np.ndarray:
    """The triangles, in each connected piece turned so that it holds a positive volume."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edge = mesh_edges(face)[:, :2]
    graph = coo_matrix((np.ones(len(edge)), (edge[:, 0], edge[:, 1])), shape=(len(vertex), len(vertex)))
    pieces, of_vertex = connected_components(graph, directed=False)
    piece = of_vertex[face[:, 0]]
    a, b, c = vertex[face].swapaxes(0, 1)
    volume = np.bincount(piece, np.einsum("fi,fi->f", a, np.cross(b, c)), pieces)
    return np.where((volume[piece] < 0)[:, None], face[:, ::-1], face)


def _hole_rims(face: np.ndarray) -> list[list[int]] | None:
    """The rims of holes as rings of vertices, in the sense of the triangles that fill them; None if they touch."""
    edges = mesh_edges(face)
    after: dict[int, int] = {}
    for start, end, *_ in edges[edges[:, 3] < 0].tolist():
        if end in after:
            return None
        after[end] = start  # against the triangle that is there
    rims = []
    while after:
        first, at = after.popitem()
        ring = [first]
        while at != first:
            ring.append(at)
            at = after.pop(at, first if at == first else -1)
            if at < 0:
                return None
        rims.append(ring)
    return rims


def _with_filled_holes(face: np.ndarray, rims: list[list[int]], middle: int) -> np.ndarray:
    """Triangles with each hole filled by a fan; vertices in the holes' middles are numbered from ``middle``."""
    fans = [face]
    for hole, ring in enumerate(rims):
        fans.append(np.stack([ring, np.roll(ring, -1), np.full(len(ring), middle + hole)], axis=1))
    return np.concatenate(fans)
