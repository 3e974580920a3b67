"""The ways to draw silhouettes: what each makes of a mesh, the arrays that it works in, and its kernel."""

from __future__ import annotations

from types import ModuleType
from typing import Any, Protocol

import numpy as np
import warp as wp

from mmocap_warp.body.mesh_parts import MeshPart, mesh_edges
from mmocap_warp.kernels.block import parts_of
from mmocap_warp.kernels.silhouettes import raster, raycast, raycast_wide
from mmocap_warp.kernels.silhouettes.counting import Cameras, Frozen
from mmocap_warp.kernels.silhouettes.raster import Outline
from mmocap_warp.kernels.silhouettes.raycast import Tree
from mmocap_warp.objective.bvh import Bvh, build_bvh

RENDERERS = ("raycast", "raster")
"""How silhouettes are drawn; the counts are the same."""


class Renderer(Protocol):
    """Draws candidates and counts their pixels."""

    module: ModuleType
    """Where its kernel is."""

    arrays: tuple[wp.array, ...]
    """What it works in, (candidate, camera, ...) each; a thread is given its candidates' rows."""

    def of(self, part: MeshPart) -> Any:
        """A part of the mesh, as :meth:`draw` wants it."""
        ...

    def draw(
        self,
        posed: wp.array,
        vertex: wp.array,
        part: Any,
        cameras: Cameras,
        frozen: Frozen,
        scratch: wp.array,
        image: wp.array,
        arrays: tuple[wp.array, ...],
        count: wp.array,
    ) -> None:
        """Fill ``count`` (candidate, camera) with (|M|, |M and F|) of ``posed`` (candidate, vertex)."""
        ...


_LEAF = 16  # triangles: with large packets, going down further costs more than it saves


class Packets:
    """``raycast`` on the CPU: a binary tree."""

    module = raycast

    def __init__(self, rest: np.ndarray, face: np.ndarray, shape: tuple[int, int], device: str) -> None:
        self._rest, self._device = rest, device
        nodes = len(build_bvh(rest, face, _LEAF).node)
        visible = wp.zeros((*shape, len(face)), dtype=wp.uint8, device=device)
        self.arrays: tuple[wp.array, ...] = (visible, wp.zeros((*shape, nodes), dtype=wp.vec4i, device=device))

    def of(self, part: MeshPart) -> Tree:
        """A tree over the part's triangles."""
        return tree_arrays(build_bvh(self._rest, part.face, _LEAF), self._device)

    def draw(self, posed, vertex, part, cameras, frozen, scratch, image, arrays, count) -> None:
        """See :class:`Renderer`."""
        raycast.raycast(posed, vertex, part, cameras, frozen, scratch, image, *arrays, count)


class WidePackets:
    """``raycast`` on a GPU: a tree of two levels, 32 wide."""

    module = raycast_wide

    def __init__(self, rest: np.ndarray, face: np.ndarray, shape: tuple[int, int], device: str) -> None:
        self._rest, self._device = rest, device
        groups = -(-len(face) // raycast_wide.WIDTH)
        box = wp.zeros((*shape, groups * raycast_wide.WIDTH), dtype=wp.vec4i, device=device)
        self.arrays: tuple[wp.array, ...] = (box, wp.zeros((*shape, groups), dtype=wp.vec4i, device=device))

    def of(self, part: MeshPart) -> wp.array:
        """The part's triangles in the order of a binary tree's leaves, where neighbours are near."""
        return wp.array(build_bvh(self._rest, part.face).triangle, dtype=wp.vec3i, device=self._device)

    def draw(self, posed, vertex, part, cameras, frozen, scratch, image, arrays, count) -> None:
        """See :class:`Renderer`."""
        parts = parts_of(count.device, count.size)
        raycast_wide.raycast_wide(posed, vertex, part, cameras, frozen, parts, scratch, image, *arrays, count)


class Contours:
    """``raster``: the edges between what faces the camera and what does not."""

    module = raster

    def __init__(self, face: np.ndarray, shape: tuple[int, int], device: str) -> None:
        self._device = device
        self.arrays: tuple[wp.array, ...] = (wp.zeros((*shape, len(face)), dtype=wp.uint8, device=device),)

    def of(self, part: MeshPart) -> Outline:
        """The part's triangles and their edges."""
        outline = Outline()
        outline.triangle = wp.array(part.face, dtype=wp.vec3i, device=self._device)
        outline.edge = wp.array(mesh_edges(part.face), dtype=wp.vec4i, device=self._device)
        return outline

    def draw(self, posed, vertex, part, cameras, frozen, scratch, image, arrays, count) -> None:
        """See :class:`Renderer`."""
        parts = parts_of(count.device, count.size)
        raster.raster(posed, vertex, part, cameras, frozen, parts, scratch, image, *arrays, count)

    def freeze(
        self,
        posed: wp.array,
        vertex: wp.array,
        part: Outline,
        cameras: Cameras,
        scratch: wp.array,
        image: wp.array,
        frozen: Frozen,
    ) -> None:
        """Draw and count what stays, of ``posed`` (run, vertex), into ``frozen``."""
        raster.freeze(posed, vertex, part, cameras, scratch, image, *self.arrays, frozen)


def tree_arrays(bvh: Bvh, device: str) -> Tree:
    """A BVH for the kernels."""
    tree = Tree()
    tree.node = wp.array(bvh.node, dtype=wp.vec3i, device=device)
    tree.triangle = wp.array(bvh.triangle, dtype=wp.vec3i, device=device)
    return tree


def make_renderer(name: str, rest: np.ndarray, face: np.ndarray, shape: tuple[int, int], device: str) -> Renderer:
    """The renderer of that name for a device.

    Args:
        name: one of ``RENDERERS``.
        rest: (vertex, 3) rest pose.
        face: (face, 3) all triangles.
        shape: most candidates, cameras.
        device: a Warp device.

    Raises:
        ValueError: no such renderer.
    """
    if name not in RENDERERS:
        raise ValueError(f"renderer must be one of {list(RENDERERS)}, got {name!r}")
    if name == "raster":
        return Contours(face, shape, device)
    if wp.get_device(device).is_cpu:
        return Packets(rest, face, shape, device)
    return WidePackets(rest, face, shape, device)
