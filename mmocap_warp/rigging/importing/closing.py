"""A closed surface for tracking from skin that may have holes, be made of parts that overlap, or have no inside.

Files repeat a vertex wherever colours or normals change: skin is welded first.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from mmocap_warp.body.mesh_pieces import connected, is_closed, mesh_edges
from mmocap_warp.device.resolve import start_quietly
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh

_SAME = 1e-5  # vertices as near as this are one, as a share of the mesh's extent


def welded(mesh: RiggedMesh) -> RiggedMesh:
    """The mesh with one vertex for each place, and without triangles that have no area or occur twice.

    Of vertices that are joined the weights are averaged; rigid parts are not joined to each other. Vertices of no
    triangle are left out. Raises a ValueError for a mesh of no extent.
    """
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
    place = connected(near[:, 0], near[:, 1], len(first))[cell.ravel()]
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
    weight = np.take_along_axis(dense, influence, axis=1)
    return replace(mesh, vertex=vertex[kept], face=face.reshape(-1, 3), influence=influence, weight=weight)


def weighted(mesh: RiggedMesh) -> RiggedMesh:
    """The mesh with vertices that follow no joint following what the nearest vertex with weights follows."""
    from scipy.spatial import cKDTree

    loose = mesh.weight.sum(axis=1) == 0
    if not loose.any() or loose.all():
        return mesh
    _, nearest = cKDTree(mesh.vertex[~loose]).query(mesh.vertex[loose])
    influence, weight = mesh.influence.copy(), mesh.weight.copy()
    influence[loose], weight[loose] = mesh.influence[~loose][nearest], mesh.weight[~loose][nearest]
    note = f"{loose.sum()} of {len(loose)} vertices have no weights: they follow what the nearest one follows"
    return replace(mesh, influence=influence, weight=weight, notes=(*mesh.notes, note))


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
_PIECE_TRIANGLES, _PIECE_CELLS = 60_000, 20  # the same of a connected piece of a mesh, at least
_WHOLE_CELLS = 80  # a wrapped piece has cells as small as if so many lay along the whole mesh
_MOST_PIECES = 200  # a coarse mesh could not hold more pieces
_SMALLEST_PIECE = 0.01  # smaller pieces, such as eyes and buttons, are left out; a share of the mesh's extent


class ClosedMesh(NamedTuple):
    """A closed mesh."""

    added: np.ndarray  # (n, 3) vertices that the mesh had not
    beside: np.ndarray  # (n,) int, for each of these a vertex that the mesh had, near by: it moves as that one does
    face: np.ndarray  # (face, 3) over the mesh's vertices and then ``added``, counter-clockwise seen from outside
    done: str  # what was done; empty where the mesh was closed


def closed(vertex: np.ndarray, face: np.ndarray, most: int = MOST_TRIANGLES, cells: int = CELLS) -> ClosedMesh:
    """The mesh itself where it is closed; else with its holes filled; else wrapped in a new surface.

    Its triangles (face, 3) of vertices (vertex, 3) are :func:`welded`. It is wrapped in any case if there are more than
    ``most`` of them, on a grid that has ``cells`` along its longest side.
    """
    made = _filled(vertex, face) if len(face) <= most else f"it has {len(face)} triangles"
    return wrapped(vertex, face, cells, made) if isinstance(made, str) else made


def _filled(vertex: np.ndarray, face: np.ndarray) -> ClosedMesh | str:
    """The mesh with its holes filled, or why that cannot be."""
    wound = face if is_closed(face) else consistently_wound(face)
    rims = None if wound is None else _hole_rims(wound)
    if wound is None or rims is None or len(rims) > _MOST_HOLES:
        return "it is not a surface with a few holes"
    # Each hole is filled by a fan around a vertex in its middle.
    middle = np.array([vertex[rim].mean(axis=0) for rim in rims]).reshape(-1, 3)
    fans = [np.stack([rim, np.roll(rim, -1), np.full(len(rim), len(vertex) + i)], axis=1) for i, rim in enumerate(rims)]
    whole = np.concatenate([wound, *fans])
    if not is_closed(whole):
        return "it is open"
    beside = np.array([rim[0] for rim in rims], int)
    done = "" if not rims else f"{len(rims)} hole{'s' if len(rims) > 1 else ''} filled"
    return ClosedMesh(middle, beside, outward(np.concatenate([vertex, middle]), whole), done)


def closed_pieces(vertex: np.ndarray, face: np.ndarray) -> ClosedMesh | None:
    """As :func:`closed`; but where that would wrap the mesh, each of its connected pieces is closed by itself.

    A silhouette is that of the pieces' union. A wrap of the whole would join legs and fill armpits. None where there
    are too many pieces, or none that can be seen.
    """
    if len(face) <= MOST_TRIANGLES and isinstance(whole := _filled(vertex, face), ClosedMesh):
        return whole
    edge = mesh_edges(face)
    piece = connected(edge[:, 0], edge[:, 1], len(vertex))[face[:, 0]]
    extent = _extent(vertex, face)
    parts = [face[piece == number] for number in np.unique(piece)]
    shown = [part for part in parts if _extent(vertex, part) >= _SMALLEST_PIECE * extent]
    if not 0 < len(shown) <= _MOST_PIECES:
        return None
    made: list[ClosedMesh] = []
    for part in shown:
        filled = _filled(vertex, part)
        if isinstance(filled, ClosedMesh) and len(part) <= _PIECE_TRIANGLES:
            made.append(filled)
            continue
        # Where three triangles meet at an edge, as a collar does on a shirt, each sheet is closed by itself.
        for sheet in [part] if isinstance(filled, ClosedMesh) else _sheets(part):
            cells = max(_PIECE_CELLS, round(_WHOLE_CELLS * _extent(vertex, sheet) / extent))
            made.append(closed(vertex, sheet, _PIECE_TRIANGLES, cells))
    if len(made) > len(shown):
        made = [_with_own_vertices(vertex, each) for each in made]
    changed = sum(bool(part.done) for part in made)
    done = f"{len(made)} pieces, of which {changed} were closed or wrapped in new surfaces"
    if len(made) == 1:
        done = made[0].done or "one piece"
    left_out = f"; {len(parts) - len(shown)} small ones left out" if len(shown) < len(parts) else ""
    return joined_meshes(made, len(vertex), done + left_out)


def _with_own_vertices(vertex: np.ndarray, surface: ClosedMesh) -> ClosedMesh:
    """A surface that shares no vertex with others: it adds copies of those of the mesh."""
    used, face = np.unique(surface.face, return_inverse=True)
    place = np.concatenate([vertex, surface.added])[used]
    beside = np.concatenate([np.arange(len(vertex)), surface.beside])[used]
    return ClosedMesh(place, beside, len(vertex) + face.reshape(-1, 3), surface.done)


def _extent(vertex: np.ndarray, face: np.ndarray) -> float:
    return float(np.ptp(vertex[face].reshape(-1, 3), axis=0).max())


def _sheets(face: np.ndarray) -> list[np.ndarray]:
    """Triangles that hang together over edges of two triangles."""
    _, first, second, _ = _shared_edges(face)
    sheet = connected(first // 3, second // 3, len(face))
    return [face[sheet == each] for each in np.unique(sheet)]


def _shared_edges(face: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """The sides of triangles (3 * face, 2), the two at each edge of two triangles, and the most at any edge."""
    directed = np.stack([face, np.roll(face, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, edge, count = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge.ravel(), kind="stable")
    first, second = order[count[edge.ravel()[order]] == 2].reshape(-1, 2).T
    return directed, first, second, int(count.max(initial=0))


def joined_meshes(parts: list[ClosedMesh], vertices: int, done: str) -> ClosedMesh:
    """Several closed meshes over the same ``vertices`` as one."""
    faces = [
        np.where(part.face < vertices, part.face, part.face - vertices + start)
        for part, start in zip(parts, vertices + np.cumsum([0, *(len(part.added) for part in parts)]), strict=False)
    ]
    added, beside = (np.concatenate([each[i] for each in parts]) for i in range(2))
    return ClosedMesh(added, beside, np.concatenate(faces), done)


def consistently_wound(face: np.ndarray) -> np.ndarray | None:
    """The triangles, some turned round so that neighbours run along their edge in opposite senses.

    None where an edge has more than two triangles, or the surface has one side only.
    """
    directed, first, second, most = _shared_edges(face)
    if most > 2:
        return None
    alike = directed[first, 0] == directed[second, 0]  # whether both run along it in one sense
    # A graph has each triangle twice, as it is and turned round, and joins neighbours that agree. A two-sided surface
    # gives two pieces, the first of which holds its first triangle as it is. A one-sided surface gives one piece.
    first, second, many = first // 3, second // 3, len(face)
    partners = np.concatenate([second + many * alike, second + many * ~alike])
    as_it_is, turned = connected(np.concatenate([first, first + many]), partners, 2 * many).reshape(2, -1)
    return None if (as_it_is == turned).any() else np.where((turned < as_it_is)[:, None], face[:, ::-1], face)


def outward(vertex: np.ndarray, face: np.ndarray) -> np.ndarray:
    """The triangles, in each connected piece turned so that it holds a positive volume."""
    edge = mesh_edges(face)
    piece = connected(edge[:, 0], edge[:, 1], len(vertex))[face[:, 0]]
    a, b, c = vertex[face].swapaxes(0, 1)
    volume = np.bincount(piece, np.einsum("fi,fi->f", a, np.cross(b, c)))
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


_SKIN = 1.2  # distance of the surface from the triangles that it is laid around, in cells
_BACK = 0.85  # share of that distance by which the surface is drawn back to the triangles
_CORNER = 0.04  # distance from the surface, in cells, that every node of the grid has at least
_MOST_SAMPLES = 4_000_000


def wrapped(vertex: np.ndarray, face: np.ndarray, cells: int, why: str) -> ClosedMesh:
    """A closed surface around triangles: it is laid a little outside of them, then drawn back to them.

    Gaps of less than a few cells are closed, and hollows that cannot be reached from outside are filled. Single sheets
    get two sides. The triangles (face, 3) of vertices (vertex, 3) may be in any order and sense; the grid has ``cells``
    along its longest side. The user reads ``why`` the mesh is wrapped.
    """
    import warp as wp
    from scipy.spatial import cKDTree

    size = float(np.ptp(vertex[np.unique(face)], axis=0).max()) / cells
    sample, owner = _samples(vertex, face, 0.5 * size)
    tree = cKDTree(sample)
    margin = np.ceil(_SKIN) + 2
    low = sample.min(axis=0) - margin * size
    shape = np.ceil((sample.max(axis=0) - low) / size + margin).astype(int) + 1
    field = _outside(tree, low, size, shape)
    # Where the surface meets a node its triangles have no area, and no normal: it keeps away.
    field = np.copysign(np.maximum(np.abs(field), _CORNER), field)
    start_quietly()
    nodes: Any = wp.array(field, dtype=wp.float32, device="cpu")
    level = wp.MarchingCubes.extract(nodes)
    corner, triangle = low + size * level[0].numpy().astype(float), level[1].numpy().reshape(-1, 3)
    _, near = tree.query(corner)
    towards = sample[near] - corner
    done = f"wrapped in a new surface, for {why}"
    return ClosedMesh(corner + _BACK * towards, owner[near], triangle + len(vertex), done)


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
    field[(field > 0) & (region != region[0, 0, 0])] *= -1
    return field
