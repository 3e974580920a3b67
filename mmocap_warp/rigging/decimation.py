"""Coarsen a closed mesh while keeping its own vertices, so that what is stored per vertex carries over."""

import heapq

import numpy as np

from mmocap_warp.body.mesh_pieces import is_closed, mesh_edges

_FOLDED = -0.5  # cosine between normals of two faces that fold back on each other, at most
_LEAST_COSINE = 0.2  # a collapse may turn a triangle's normal this far: a triangle may tilt, not fold over


def decimate(vertex: np.ndarray, face: np.ndarray, triangles: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed mesh of ``triangles`` triangles, or one fewer, over a subset of a closed mesh's vertices.

    Half-edge collapses in the order of the quadric error (Garland and Heckbert 1997): a vertex is moved onto a
    neighbour and vanishes, so all that remain are where they were. Given are places (vertex, 3) and consistently wound
    triangles (face, 3); returned are the kept vertices (n,) int32, ascending, and triangles over them (m, 3) int32.
    Raises a ValueError for a mesh that is not closed, or cannot be made that coarse.
    """
    if not is_closed(face):
        raise ValueError("only a closed mesh can be decimated")
    mesh, quadric = _Collapsing(vertex, face), _quadrics(vertex, face)
    homogeneous = np.c_[vertex, np.ones(len(vertex))]

    def error(gone: int, kept: int) -> float:
        at = homogeneous[kept]
        return float(at @ (quadric[gone] + quadric[kept]) @ at)

    # All edges wait in the order of their errors. Entries of changed vertices stay there; their age shows them.
    age = [0] * len(vertex)
    heap = [(error(u, v), u, v, 0, 0) for u, around in enumerate(mesh.neighbours) for v in sorted(around)]
    heapq.heapify(heap)
    while mesh.faces_left > triangles:
        if not heap:
            raise ValueError(f"cannot be decimated to {triangles} triangles; {mesh.faces_left} are left")
        _, gone, kept, age_gone, age_kept = heapq.heappop(heap)
        if age[gone] != age_gone or age[kept] != age_kept or not mesh.may_collapse(gone, kept):
            continue
        # The vertex that is kept takes over the planes of the one that goes, and its edges are put in anew.
        mesh.collapse(gone, kept)
        quadric[kept] += quadric[gone]
        age[gone] = -1
        age[kept] += 1
        for other in sorted(mesh.neighbours[kept]):
            heapq.heappush(heap, (error(kept, other), kept, other, age[kept], age[other]))
            heapq.heappush(heap, (error(other, kept), other, kept, age[other], age[kept]))
    kept_vertex, renumbered = np.unique([corners for corners in mesh.face if corners], return_inverse=True)
    return kept_vertex.astype(np.int32), renumbered.reshape(-1, 3).astype(np.int32)


def _quadrics(vertex: np.ndarray, face: np.ndarray) -> np.ndarray:
    """(vertex, 4, 4): the form that gives a point's area-weighted squared distance to the planes of the faces."""
    a, b, c = vertex[face].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(normal, axis=1)
    normal /= 2 * area[:, None]
    plane = np.c_[normal, -(normal * a).sum(axis=1)]
    form = area[:, None, None] * plane[:, :, None] * plane[:, None, :]
    quadric = np.zeros((len(vertex), 4, 4))
    for corner in range(3):
        np.add.at(quadric, face[:, corner], form)
    # Faces that fold back, as at a wing's rim, lie in one plane, in which it could move: it keeps one across too.
    start, end, one, other = mesh_edges(face).T
    fold = (normal[one] * normal[other]).sum(axis=1) < _FOLDED
    start, end = start[fold], end[fold]
    across = np.cross(vertex[end] - vertex[start], normal[one[fold]])  # as long as the edge: its square is an area
    plane = np.c_[across, -(across * vertex[start]).sum(axis=1)]
    for rim in (start, end):
        np.add.at(quadric, rim, plane[:, :, None] * plane[:, None, :])
    return quadric


class _Collapsing:
    """A closed triangle mesh whose edges are collapsed one by one.

    Plain lists and sets: a collapse touches a dozen vertices, for which NumPy's calls cost more than the work.
    """

    def __init__(self, vertex: np.ndarray, face: np.ndarray) -> None:
        self._position = vertex.tolist()
        self.face: list[list[int]] = face.tolist()
        self._faces_at: list[set[int]] = [set() for _ in self._position]
        self.neighbours: list[set[int]] = [set() for _ in self._position]
        self.faces_left = len(self.face)
        for f, (a, b, c) in enumerate(self.face):
            for v in (a, b, c):
                self._faces_at[v].add(f)
                self.neighbours[v] |= {a, b, c} - {v}

    def may_collapse(self, gone: int, kept: int) -> bool:
        """Whether the mesh stays a closed surface (the link condition) and no triangle folds over."""
        wings = self.neighbours[gone] & self.neighbours[kept]
        if len(wings) != 2 or any(len(self.neighbours[v]) <= 3 for v in wings):
            return False
        for f in self._faces_at[gone]:
            corners = self.face[f]
            if kept in corners:
                continue
            before = self._normal(corners)
            after = self._normal([kept if v == gone else v for v in corners])
            if _dot(before, after) <= _LEAST_COSINE * (_dot(before, before) * _dot(after, after)) ** 0.5:
                return False
        return True

    def collapse(self, gone: int, kept: int) -> None:
        """Move vertex ``gone`` onto ``kept``; the two triangles between them vanish."""
        for f in list(self._faces_at[gone]):
            corners = self.face[f]
            if kept in corners:
                for v in corners:
                    self._faces_at[v].discard(f)
                self.face[f] = []
                self.faces_left -= 1
            else:
                self.face[f] = [kept if v == gone else v for v in corners]
                self._faces_at[kept].add(f)
        for v in self.neighbours[gone]:
            self.neighbours[v].discard(gone)
            if v != kept:
                self.neighbours[v].add(kept)
                self.neighbours[kept].add(v)

    def _normal(self, corners: list[int]) -> tuple[float, float, float]:
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (self._position[v] for v in corners)
        ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
        return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


def _dot(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
