"""The larger structs that a fitter of contours keeps on the device, each made once."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.mesh_pieces import mesh_edges
from mmocap_warp.body.model import SkinMesh
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.kernels.contour.descent import Descent
from mmocap_warp.kernels.contour.jacobian import Tree
from mmocap_warp.kernels.contour.normal_equations import triangle_words
from mmocap_warp.kernels.contour.outline import BANDS, Edges, Outline
from mmocap_warp.kernels.structs import filled

_LEAST_ROOM = 2048  # contour edges of a view that there is room for even with a small mesh
_BANDS_OF_AN_EDGE = 2  # bands that a contour edge reaches into, on average, that there is room for


def contour_room(edges: int) -> int:
    """Number of contour edges of a view that there is room for, by the number of the mesh's edges."""
    return min(edges, max(_LEAST_ROOM, edges // 2))


def make_edges(face: np.ndarray, device: str) -> Edges:
    """Those of a mesh of faces (face, 3).

    Raises:
        ValueError: the mesh is open.
    """
    edge = mesh_edges(face)
    if (edge[:, 3] < 0).any():
        raise ValueError("the tracking mesh must be closed, this one has open edges")
    return filled(
        Edges,
        face=wp.array(face, dtype=wp.vec3i, device=device),
        edge=wp.array(edge, dtype=wp.vec4i, device=device),
    )


def make_tree(skeleton: Skeleton, index: np.ndarray, device: str) -> Tree:
    """Joints ranked so that those below each follow it, and a column for each coordinate in ``index`` (dof,)."""
    joints = len(skeleton.joints)
    children: list[list[int]] = [[] for _ in range(joints)]
    for joint, parent in enumerate(skeleton.parent[1:], 1):
        children[parent].append(joint)
    order: list[int] = []
    waiting = [0]
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting.extend(children[joint])
    rank = np.empty(joints, np.int32)
    rank[order] = np.arange(joints)
    last = rank.copy()
    for joint in range(joints - 1, 0, -1):
        parent = skeleton.parent[joint]
        last[parent] = max(last[parent], last[joint])
    column = np.full(skeleton.coordinates, -1, np.int32)
    column[index] = np.arange(len(index))
    return filled(
        Tree,
        rank=wp.array(rank, dtype=wp.int32, device=device),
        last=wp.array(last, dtype=wp.int32, device=device),
        column=wp.array(column, dtype=wp.int32, device=device),
    )


def make_outline(view: tuple[int, int], mesh: SkinMesh, edges: int, device: str) -> Outline:
    """Room for the contour edges of views (candidate, camera), by the number of the mesh's edges."""
    size = contour_room(edges)
    return filled(
        Outline,
        size=size,
        late=wp.zeros(view, dtype=wp.float32, device=device),
        image=wp.zeros((*view, len(mesh.rest)), dtype=wp.vec3, device=device),
        facing=wp.zeros((*view, len(mesh.face)), dtype=wp.uint8, device=device),
        found=wp.zeros((*view, edges), dtype=wp.int32, device=device),
        count=wp.zeros(view, dtype=wp.int32, device=device),
        ends=wp.zeros((*view, size), dtype=wp.vec2i, device=device),
        room=_BANDS_OF_AN_EDGE * size,
        line=wp.zeros(view[0] * view[1] * 4 * _BANDS_OF_AN_EDGE * size, dtype=wp.float32, device=device),
        band=wp.zeros((*view, BANDS + 1), dtype=wp.int32, device=device),
    )


def make_descent(
    index: np.ndarray, is_length: np.ndarray, limits: np.ndarray, view: tuple[int, int], width: int, device: str
) -> Descent:
    """Arrays of a descent in the coordinates ``index`` (dof,), some of them lengths (dof,), within ``limits``.

    Args:
        index: the searched coordinates of a pose.
        is_length: whether they are metres, not radians.
        limits: (coordinate, 2) of all coordinates.
        view: candidates and cameras.
        width: columns of a row of the normal equations.
        device: a Warp device.
    """
    candidates, coordinates = view[0], len(limits)

    def poses() -> wp.array[Any]:
        return wp.zeros((candidates, coordinates), dtype=wp.float32, device=device)

    return filled(
        Descent,
        index=wp.array(index, dtype=wp.int32, device=device),
        gradient=width - 1,
        pull=wp.array(np.where(is_length, 0.05, 0.10) ** -2.0, dtype=wp.float32, device=device),
        limits=wp.array(limits[index], dtype=wp.float32, device=device),
        start=poses(),
        pose=poses(),
        best=poses(),
        cost=wp.zeros(candidates, dtype=wp.float32, device=device),
        tally=wp.zeros(view, dtype=wp.vec4, device=device),
        damping=wp.zeros(candidates, dtype=wp.float32, device=device),
        triangle=wp.zeros((candidates, triangle_words(width)), dtype=wp.float32, device=device),
    )
