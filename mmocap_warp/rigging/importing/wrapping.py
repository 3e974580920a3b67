"""A closed surface around any heap of triangles: what has no inside gets one."""

from __future__ import annotations

from itertools import permutations

import numpy as np

_SKIN = 1.2  # distance of the surface from the triangles that it is laid around, in cells
_BACK = 0.85  # share of that distance by which the surface is drawn back to the triangles
_CORNER = 0.04  # the surface cuts a cell's edge this share of it from its ends: slivers have no normal
_MOST_SAMPLES = 4_000_000


def wrapped(vertex: np.ndarray, face: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A closed surface around triangles: it is laid a little outside of them, then drawn back to them.

    Gaps of less than a few cells are closed, and hollows that cannot be reached from outside are filled. Single sheets
    get two sides.

    Args:
        vertex: (vertex, 3).
        face: (face, 3), in any order and sense.
        cells: of the grid, along the longest side.

    Returns:
        vertices (n, 3), triangles (m, 3) counter-clockwise seen from outside, and for each of these vertices (n,) the
        number of a given vertex that is near.
    """
    from scipy.spatial import cKDTree

    size = float(np.ptp(vertex[np.unique(face)], axis=0).max()) / cells
    sample, owner = _samples(vertex, face, 0.5 * size)
    tree = cKDTree(sample)
    margin = np.ceil(_SKIN) + 2
    low = sample.min(axis=0) - margin * size
    shape = np.ceil((sample.max(axis=0) - low) / size + margin).astype(int) + 1
    field = _outside(tree, low, size, shape)
    corner, triangle = _level_set(field)
    corner = low + size * corner
    _, near = tree.query(corner)
    towards = sample[near] - corner
    return corner + _BACK * towards, triangle, owner[near]


def _samples(vertex: np.ndarray, face: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points spread over the triangles, about ``spacing`` apart, and the nearest corner of each one's triangle."""
    corner = vertex[face]
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(longest / spacing), 1, None).astype(int)
    total = float((steps.astype(float) ** 2).sum())
    if total > _MOST_SAMPLES:
        steps = np.maximum((steps * np.sqrt(_MOST_SAMPLES / total)).astype(int), 1)
    points, owners = [], []
    for step in np.unique(steps):
        i, j = (each.ravel() for each in np.mgrid[: step + 1, : step + 1])
        i, j = i[i + j <= step], j[i + j <= step]
        share = np.stack([step - i - j, i, j], axis=1) / step
        of = np.flatnonzero(steps == step)
        points.append(np.einsum("sk,fka->fsa", share, corner[of]).reshape(-1, 3))
        owners.append(face[of][:, share.argmax(axis=1)].ravel())
    return np.concatenate(points), np.concatenate(owners)


def _outside(tree, low: np.ndarray, size: float, shape: np.ndarray) -> np.ndarray:  # type: ignore[no-untyped-def]
    """(x, y, z) how many cells each node of the grid lies outside of the surface; negative inside, and in hollows."""
    from scipy.ndimage import label

    node = low + size * np.indices(tuple(shape.tolist())).reshape(3, -1).T
    distance, _ = tree.query(node, distance_upper_bound=(_SKIN + 2) * size)
    field: np.ndarray = np.minimum(distance / size, _SKIN + 2).reshape(shape) - _SKIN
    region, _ = label(field > 0)
    hollow = (field > 0) & (region != region[0, 0, 0])
    field[hollow] *= -1
    return field


def _level_set(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where a field on a grid is zero: vertices (n, 3) in cells, and triangles (m, 3) whose normals point to positive.

    Marching tetrahedra (Doi and Koide 1991): each cell is cut in six along its diagonal, all cells alike, so that faces
    of neighbours meet and the surface is closed wherever it does not reach the grid's sides.
    """
    shape = np.array(field.shape)
    value = np.where(field == 0, 1e-6, field).ravel()
    stride = np.array([shape[1] * shape[2], shape[2], 1])
    cell = np.indices(tuple((shape - 1).tolist())).reshape(3, -1).T @ stride
    path = np.cumsum([[(0, 0, 0), *np.eye(3, dtype=int)[list(order)]] for order in permutations(range(3))], axis=1)
    tetrahedra = path @ stride  # (6, 4): from each cell's first node to its last, an edge along an axis at a time
    even = np.linalg.det(np.diff(path, axis=1).astype(float)) > 0
    tetrahedra[~even] = tetrahedra[~even][:, [0, 2, 1, 3]]
    node = (cell[:, None, None] + tetrahedra).reshape(-1, 4)
    inside = value[node] < 0
    count = inside.sum(axis=1)
    node, inside, count = (each[(count > 0) & (count < 4)] for each in (node, inside, count))

    edges = []  # three edges of the grid for each triangle: inside node, outside node
    for pattern in range(1, 15):
        bits = np.array([pattern >> k & 1 for k in range(4)], bool)
        chosen = node[(inside == bits).all(axis=1)]
        for triangle in _triangles_of(bits):
            edges.append(chosen[:, np.array(triangle)])
    edge = np.concatenate(edges)  # (triangle, corner, end)
    unique, corners = np.unique(edge.reshape(-1, 2), axis=0, return_inverse=True)
    a, b = value[unique].T
    share = np.clip(a / (a - b), _CORNER, 1 - _CORNER)[:, None]
    place = np.stack(np.unravel_index(unique, field.shape), axis=-1).astype(float)
    corner = (1 - share) * place[:, 0] + share * place[:, 1]
    return corner, corners.reshape(-1, 3)


def _triangles_of(inside: np.ndarray) -> list[list[tuple[int, int]]]:
    """Triangles between the inner and the outer nodes of a tetrahedron; each corner is an edge (inside, outside)."""
    within, without = np.flatnonzero(inside).tolist(), np.flatnonzero(~inside).tolist()
    even = round(np.linalg.det(np.eye(4)[within + without])) > 0
    if len(within) == 1:
        (a,), (b, c, d) = within, without
        found = [[(a, b), (a, c), (a, d)]]
    elif len(within) == 3:
        (a, b, c), (d,) = within, without
        found = [[(a, d), (b, d), (c, d)]]
    else:
        (a, b), (c, d) = within, without
        found = [[(a, c), (a, d), (b, d)], [(a, c), (b, d), (b, c)]]
    return found if even else [triangle[::-1] for triangle in found]
