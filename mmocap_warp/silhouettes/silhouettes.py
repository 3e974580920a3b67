"""Silhouettes of posed bodies, counted against masks: the whole body, or a moving piece over the frozen rest.

There are several ways to draw them: each makes something else of a piece of the mesh, and has its own kernel.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.mesh_pieces import MeshPiece, mesh_edges, piece_of, split_mesh
from mmocap_warp.body.model import SkinMesh
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.kernels.block import Batch
from mmocap_warp.kernels.silhouettes import raster, raycast, raycast_wide
from mmocap_warp.kernels.silhouettes.counting import Canvas, Frozen
from mmocap_warp.kernels.silhouettes.raster import Outline
from mmocap_warp.kernels.silhouettes.raycast import Tree
from mmocap_warp.kernels.silhouettes.raycast_wide import Leaves
from mmocap_warp.kernels.structs import allocated
from mmocap_warp.kernels.views.projection import Views
from mmocap_warp.masks.observation import make_views

_LEAF = 16  # triangles of a leaf: with large packets, smaller leaves cost more than they save


@dataclass(frozen=True)
class Renderer:
    """A way to draw candidates and count their pixels."""

    module: ModuleType  # where its kernel is
    # fills the canvas's counts from ``posed`` (candidate, vertex), a piece, views, what is frozen, and a batch
    draw: Callable[[wp.array[wp.vec3], Any, Views, Frozen, Batch, Canvas], None]
    # makes of a piece of the mesh the struct that ``draw`` takes; its ``vertex`` are the vertices needed
    piece: Callable[[MeshPiece], Any]
    boxes: int = 0  # boxes of the largest piece, for a candidate and camera
    groups: int = 0  # boxes around groups of these


def outline(piece: MeshPiece, device: str) -> Any:
    """A piece's triangles and their edges, for ``raster`` and for freezing."""
    return allocated(Outline, device, vertex=piece.vertex, triangle=piece.face, edge=mesh_edges(piece.face))


def make_renderer(name: str, rest: np.ndarray, face: np.ndarray, device: str) -> Renderer:
    """The renderer of that name in ``RENDERERS``, for faces (face, 3) and a rest pose (vertex, 3)."""
    if name == "raster":
        return Renderer(raster, raster.raster, lambda piece: outline(piece, device))

    def tree(piece: MeshPiece) -> Any:
        node, triangle = build_bvh(rest, piece.face, _LEAF)
        return allocated(Tree, device, vertex=piece.vertex, node=node, triangle=triangle)

    def leaves(piece: MeshPiece) -> Any:
        return allocated(Leaves, device, vertex=piece.vertex, triangle=build_bvh(rest, piece.face)[1])

    if wp.get_device(device).is_cpu:
        return Renderer(raycast, raycast.raycast, tree, boxes=len(build_bvh(rest, face, _LEAF)[0]))
    groups = -(-len(face) // raycast_wide.WIDTH)
    return Renderer(raycast_wide, raycast_wide.raycast_wide, leaves, groups * raycast_wide.WIDTH, groups)


def build_bvh(vertices: np.ndarray, faces: np.ndarray, leaf_size: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """A bounding volume hierarchy of triangles: a binary tree in depth-first order.

    Triangles are split at the median of their centroids' widest axis until a leaf holds ``leaf_size`` at most.
    ``kernels/silhouettes/raycast.py`` says how the tree is walked.

    Args:
        vertices: (vertex, 3) float, the rest pose: boxes stay tight when a limb moves as a whole.
        faces: (triangle, 3) int.
        leaf_size: largest number of triangles in a leaf.

    Returns:
        nodes (node, 3) int32, ``skip, first, count``, where ``count`` is 0 for an inner node; and the faces in leaf
        order, (triangle, 3) int32.
    """
    centroid = np.asarray(vertices, np.float64)[faces].mean(axis=1)
    nodes: list[list[int]] = []
    order: list[int] = []

    def split(triangles: np.ndarray) -> None:
        index = len(nodes)
        nodes.append([0, len(order), 0])
        if len(triangles) <= leaf_size:
            nodes[index][2] = len(triangles)
            order.extend(triangles)
        else:
            axis = np.ptp(centroid[triangles], axis=0).argmax()
            ranked = triangles[np.argsort(centroid[triangles, axis], kind="stable")]
            split(ranked[: len(ranked) // 2])
            split(ranked[len(ranked) // 2 :])
        nodes[index][0] = len(nodes)

    split(np.arange(len(faces)))
    return np.array(nodes, np.int32), np.asarray(faces, np.int32)[order]


class Silhouettes:
    """Draws posed candidates in every camera and counts them against the masks in ``views``.

    ``canvas.count`` (candidate, camera) holds (|M|, |M and F|) after :meth:`draw`. ``modules`` have the kernels. The
    cameras are undistorted, at the masks' size.
    """

    def __init__(self, mesh: SkinMesh, rig: CameraRig, candidates: int, renderer: str, device: str) -> None:
        self._mesh, self._device = mesh, device
        self._renderer = make_renderer(renderer, mesh.rest, mesh.face, device)
        self.modules = (self._renderer.module, raster)
        self.whole = self._renderer.piece(piece_of(mesh.face))
        self.views = make_views(rig, device)
        view, boxes, groups = (candidates, len(rig)), self._renderer.boxes, self._renderer.groups
        lengths = {"cell": len(mesh.rest), "facing": len(mesh.face), "box": boxes, "group_box": groups}
        self.canvas = allocated(Canvas, device, **{name: (*view, n) for name, n in lengths.items()}, count=view)
        self._nothing_frozen = self.make_frozen(0)

    def make_frozen(self, runs: int) -> Any:
        """Where the silhouettes of a resting piece are drawn, a set for every run, in the struct that kernels take."""
        words = (runs, *self.views.observed.shape)
        return allocated(Frozen, self._device, words=words, count=words[:2], cut=words[:2])

    def split(self, skeleton: Skeleton, index: np.ndarray) -> tuple[Any, Outline] | None:
        """The piece that coordinates ``index`` move and the one that rests, or None where either is empty."""
        moving, resting = split_mesh(self._mesh, skeleton, index)
        if not len(resting.face) or not len(moving.face):
            return None
        return self._renderer.piece(moving), outline(resting, self._device)

    def draw(self, posed: wp.array[wp.vec3], piece: Any, batch: Batch, frozen: Any = None) -> None:
        """Draw and count a piece of a batch's ``posed`` (candidate, vertex), over what is ``frozen`` for each run."""
        self._renderer.draw(posed, piece, self.views, frozen or self._nothing_frozen, batch, self.canvas)

    def freeze(self, posed: wp.array[wp.vec3], resting: Outline, batch: Batch, frozen: Any) -> None:
        """Draw and count the resting piece of ``posed`` (run, vertex); a batch's candidates are runs here."""
        raster.freeze(posed, resting, self.views, batch, self.canvas, frozen)
