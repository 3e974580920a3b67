"""The ways to draw silhouettes: what each makes of a piece of the mesh, the boxes that it needs, and its kernel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.mesh_pieces import MeshPiece, mesh_edges
from mmocap_warp.kernels.batch import Batch
from mmocap_warp.kernels.silhouettes import raster, raycast, raycast_wide
from mmocap_warp.kernels.silhouettes.counting import Canvas, Frozen
from mmocap_warp.kernels.silhouettes.raster import Outline
from mmocap_warp.kernels.silhouettes.raycast import Tree
from mmocap_warp.kernels.silhouettes.raycast_wide import Leaves
from mmocap_warp.kernels.structs import allocated
from mmocap_warp.kernels.views.projection import Views
from mmocap_warp.silhouettes import RENDERERS

_LEAF = 16  # triangles of a leaf: with large packets, smaller leaves cost more than they save


@dataclass(frozen=True)
class Renderer:
    """A way to draw candidates and count their pixels.

    Attributes:
        module: where its kernel is.
        draw: fills the canvas's counts from ``posed`` (candidate, vertex), a piece, views, what is frozen, and a batch.
        piece: makes of a piece of the mesh the struct that ``draw`` takes; its ``vertex`` are the vertices needed.
        boxes: boxes of the largest piece, for a candidate and camera.
        groups: boxes around groups of these.
    """

    module: ModuleType
    draw: Callable[[wp.array[wp.vec3], Any, Views, Frozen, Batch, Canvas], None]
    piece: Callable[[MeshPiece], Any]
    boxes: int = 0
    groups: int = 0


def outline(piece: MeshPiece, device: str) -> Any:
    """A piece's triangles and their edges, for ``raster`` and for freezing."""
    return allocated(Outline, device, vertex=piece.vertex, triangle=piece.face, edge=mesh_edges(piece.face))


def make_renderer(name: str, rest: np.ndarray, face: np.ndarray, device: str) -> Renderer:
    """The renderer of that name for a device.

    Args:
        name: one of ``RENDERERS``.
        rest: (vertex, 3) rest pose.
        face: (face, 3) all triangles.
        device: a Warp device.

    Raises:
        ValueError: no such renderer.
    """
    if name not in RENDERERS:
        raise ValueError(f"renderer must be one of {list(RENDERERS)}, got {name!r}")
    if name == "raster":
        return Renderer(raster, raster.raster, lambda piece: outline(piece, device))

    def tree(piece: MeshPiece) -> Any:
        bvh = build_bvh(rest, piece.face, _LEAF)
        return allocated(Tree, device, vertex=piece.vertex, node=bvh.node, triangle=bvh.triangle)

    def leaves(piece: MeshPiece) -> Any:
        return allocated(Leaves, device, vertex=piece.vertex, triangle=build_bvh(rest, piece.face).triangle)

    if wp.get_device(device).is_cpu:
        return Renderer(raycast, raycast.raycast, tree, boxes=len(build_bvh(rest, face, _LEAF).node))
    groups = -(-len(face) // raycast_wide.WIDTH)
    return Renderer(raycast_wide, raycast_wide.raycast_wide, leaves, groups * raycast_wide.WIDTH, groups)


@dataclass(frozen=True)
class Bvh:
    """A bounding volume hierarchy of triangles: a binary tree in depth-first order.

    ``kernels/silhouettes/raycast.py`` says how it is walked.

    Attributes:
        node: (node, 3) int32, ``skip, first, count``; ``count`` is 0 for an inner node.
        triangle: (triangle, 3) int32, the faces in leaf order.
    """

    node: np.ndarray
    triangle: np.ndarray


def build_bvh(vertices: np.ndarray, faces: np.ndarray, leaf_size: int = 4) -> Bvh:
    """Split the triangles at the median of their centroids' widest axis until a leaf holds ``leaf_size`` at most.

    Args:
        vertices: (vertex, 3) float, the rest pose: boxes stay tight when a limb moves as a whole.
        faces: (triangle, 3) int.
        leaf_size: largest number of triangles in a leaf.
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
    return Bvh(np.array(nodes, np.int32), np.asarray(faces, np.int32)[order])
