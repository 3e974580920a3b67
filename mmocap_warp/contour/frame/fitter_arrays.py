"""The larger structs that a fitter of contours keeps on the device, each made once."""

from typing import Any

import numpy as np

from mmocap_warp.body.mesh_pieces import mesh_edges
from mmocap_warp.body.model import SkinMesh
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.kernels.contour.descent import Descent
from mmocap_warp.kernels.contour.jacobian import Tree
from mmocap_warp.kernels.contour.normal_equations import triangle_words
from mmocap_warp.kernels.contour.outline import BANDS, Edges, Outline
from mmocap_warp.kernels.structs import allocated

_LEAST_ROOM = 2048  # contour edges of a view that there is room for even with a small mesh
_BANDS_OF_AN_EDGE = 2  # bands that a contour edge reaches into, on average, that there is room for


def contour_room(edges: int) -> int:
    """Number of contour edges of a view that there is room for, by the number of the mesh's edges."""
    return min(edges, max(_LEAST_ROOM, edges // 2))


def make_edges(face: np.ndarray, device: str) -> Any:
    """Those of a mesh of faces (face, 3); a ValueError if it is open."""
    edge = mesh_edges(face)
    if (edge[:, 3] < 0).any():
        raise ValueError("the tracking mesh must be closed, this one has open edges")
    return allocated(Edges, device, face=face, edge=edge)


def make_tree(skeleton: Skeleton, index: np.ndarray, device: str) -> Any:
    """Joints ranked so that those below each follow it, and a column for each coordinate in ``index`` (dof,)."""
    order: list[int] = []
    waiting = [0]
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting += [child for child, parent in enumerate(skeleton.parent) if parent == joint]
    rank = np.argsort(order)
    last = rank + skeleton.below.sum(axis=1) - 1
    column = np.full(skeleton.coordinates, -1)
    column[index] = np.arange(len(index))
    return allocated(Tree, device, rank=rank, last=last, column=column)


def make_outline(view: tuple[int, int], mesh: SkinMesh, edges: int, device: str) -> Any:
    """Room for the contour edges of views (candidate, camera), by the number of the mesh's edges."""
    size = contour_room(edges)
    room = _BANDS_OF_AN_EDGE * size
    return allocated(
        Outline, device, size=size, late=view, image=(*view, len(mesh.rest)), facing=(*view, len(mesh.face)),
        found=(*view, edges), count=view, ends=(*view, size), room=room, line=view[0] * view[1] * 4 * room,
        band=(*view, BANDS + 1),
    )  # fmt: skip


def make_descent(
    index: np.ndarray, is_length: np.ndarray, limits: np.ndarray, view: tuple[int, int], width: int, device: str
) -> Any:
    """Arrays of a descent in the coordinates ``index`` (dof,), of which some are lengths (dof,), within ``limits``.

    ``limits`` (coordinate, 2) are of all coordinates, ``view`` are the numbers of candidates and cameras, and ``width``
    is that of a row of the normal equations.
    """
    candidates, poses = view[0], (view[0], len(limits))
    return allocated(
        Descent, device, index=index, gradient=width - 1, pull=np.where(is_length, 0.05, 0.10) ** -2.0,
        limits=limits[index], start=poses, pose=poses, best=poses, cost=candidates, tally=view, damping=candidates,
        triangle=(candidates, triangle_words(width)),
    )  # fmt: skip
