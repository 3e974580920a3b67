"""Silhouettes of posed bodies, counted against masks: the whole body, or a part of it over the frozen rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmocap_warp.body import SkinMesh
from mmocap_warp.bvh import Bvh, build_bvh
from mmocap_warp.cameras import CameraRig
from mmocap_warp.kernels import block
from mmocap_warp.kernels.raster import Outline, freeze, raster
from mmocap_warp.kernels.raycast import Tree, raycast
from mmocap_warp.kernels.silhouette import Cameras, Frozen
from mmocap_warp.moving import MeshPart, mesh_edges, split_mesh, whole_mesh
from mmocap_warp.observation import words_per_row

RENDERERS = ("raycast", "raster")
"""How silhouettes are drawn; the counts are the same."""


def camera_arrays(rig: CameraRig, device: str) -> Cameras:
    """A rig and empty masks for the kernels."""
    lens = np.stack([rig.K[:, 0, 0], rig.K[:, 1, 1], rig.K[:, 0, 2], rig.K[:, 1, 2]], axis=1)
    cameras = Cameras()
    cameras.rotation = wp.array(rig.R, dtype=wp.mat33, device=device)
    cameras.translation = wp.array(rig.t, dtype=wp.vec3, device=device)
    cameras.lens = wp.array(lens, dtype=wp.vec4, device=device)
    cameras.size = wp.array(rig.size.astype(np.int32), dtype=wp.vec2i, device=device)
    rows, words = int(rig.size[:, 1].max()), words_per_row(int(rig.size[:, 0].max()))
    cameras.observed = wp.zeros((len(rig), rows, words), dtype=wp.uint32, device=device)
    return cameras


def tree_arrays(bvh: Bvh, device: str) -> Tree:
    """A BVH for the kernels."""
    tree = Tree()
    tree.node = wp.array(bvh.node, dtype=wp.vec4i, device=device)
    tree.triangle = wp.array(bvh.triangle, dtype=wp.vec3i, device=device)
    # A single thread goes through the nodes as they lie in memory, a block of them a level at a time.
    levels = [np.arange(len(bvh.node))[::-1]] if wp.get_device(device).is_cpu else bvh.levels
    tree.by_level = wp.array(np.concatenate(levels), dtype=wp.int32, device=device)
    tree.level_end = wp.array(np.cumsum([len(level) for level in levels]), dtype=wp.int32, device=device)
    return tree


def outline_arrays(face: np.ndarray, device: str) -> Outline:
    """Triangles and their edges for the kernels."""
    outline = Outline()
    outline.triangle = wp.array(face, dtype=wp.vec3i, device=device)
    outline.edge = wp.array(mesh_edges(face), dtype=wp.vec4i, device=device)
    return outline


class PartArrays:
    """Vertices and triangles of a part for the kernels; a tree for ``raycast``, edges for ``raster``."""

    def __init__(self, part: MeshPart, rest: np.ndarray, renderer: str, device: str) -> None:
        self.vertex = wp.array(part.vertex, dtype=wp.int32, device=device)
        self.outline = outline_arrays(part.face, device) if renderer == "raster" else None
        self.tree = tree_arrays(build_bvh(rest, part.face), device) if renderer == "raycast" else None


class FrozenArrays:
    """Where the silhouettes of what stays are drawn, a set for every run."""

    def __init__(self, runs: int, cameras: Cameras, device: str) -> None:
        views, rows, words = cameras.observed.shape
        self.runs = runs
        self.words = wp.zeros((runs, views, rows, words), dtype=wp.uint32, device=device)
        self.count = wp.zeros((runs, views), dtype=wp.vec2i, device=device)
        self.cut = wp.zeros((runs, views), dtype=wp.int32, device=device)

    def of(self, first: int, particles: int) -> Frozen:
        """For a launch that begins at candidate ``first``; it is left out with 0 ``particles``."""
        frozen = Frozen()
        frozen.first, frozen.particles = first, particles
        frozen.words, frozen.count, frozen.cut = self.words, self.count, self.cut
        return frozen


@dataclass(frozen=True)
class SilhouetteSlice:
    """The arrays of a row of candidates that one thread draws."""

    first: int
    scratch: wp.array
    image: wp.array
    visible: wp.array
    box: wp.array
    count: wp.array


class Silhouettes:
    """Draws posed candidates in every camera and counts them against the masks in ``cameras.observed``.

    ``count`` (candidate, camera) holds (|M|, |M and F|) after :meth:`draw`.

    Args:
        mesh: the tracking mesh.
        rig: undistorted cameras, at the masks' size.
        candidates: the most candidates at a time.
        renderer: one of ``RENDERERS``.
        device: a Warp device.
    """

    def __init__(self, mesh: SkinMesh, rig: CameraRig, candidates: int, renderer: str, device: str) -> None:
        if renderer not in RENDERERS:
            raise ValueError(f"renderer must be one of {list(RENDERERS)}, got {renderer!r}")
        self._mesh, self._renderer, self._device = mesh, renderer, device
        self.cameras = camera_arrays(rig, device)
        self.whole = PartArrays(whole_mesh(mesh), mesh.rest, renderer, device)
        self._nothing_frozen = FrozenArrays(1, self.cameras, device)
        shape = (candidates, len(rig))
        self._image = wp.zeros((*shape, len(mesh.rest)), dtype=wp.vec2i, device=device)
        nodes = self.whole.tree.node.shape[0] if self.whole.tree else 1
        self._visible = wp.zeros((*shape, len(mesh.face)), dtype=wp.uint8, device=device)
        self._box = wp.zeros((*shape, nodes), dtype=wp.vec4i, device=device)
        self.count = wp.zeros(shape, dtype=wp.vec2i, device=device)

    def split(self, index: np.ndarray) -> tuple[PartArrays, PartArrays] | None:
        """What coordinates ``index`` move and what they leave, or None where nothing is left."""
        moving, staying = split_mesh(self._mesh, index)
        if not len(staying.face) or not len(moving.face):
            return None
        return (
            PartArrays(moving, self._mesh.rest, self._renderer, self._device),
            PartArrays(staying, self._mesh.rest, "raster", self._device),
        )

    def slice(self, first: int, end: int) -> SilhouetteSlice:
        """Candidates ``first .. end - 1``, to be drawn by a thread of their own."""
        arrays = (self._image, self._visible, self._box, self.count)
        return SilhouetteSlice(first, block.scratch(self._device), *(array[first:end] for array in arrays))

    def draw(self, own: SilhouetteSlice, posed: wp.array, part: PartArrays, frozen: FrozenArrays | None, particles: int) -> None:
        """Draw and count a slice's ``posed`` (candidate, vertex); of a part, over what is ``frozen`` for each run."""
        held = frozen.of(own.first, particles) if frozen else self._nothing_frozen.of(0, 0)
        if part.tree:
            raycast(
                posed, part.vertex, part.tree, self.cameras, held, own.scratch,
                own.image, own.visible, own.box, own.count,
            )  # fmt: skip
        else:
            raster(
                posed, part.vertex, part.outline, self.cameras, held, own.scratch, own.image, own.visible, own.count
            )

    def freeze(self, own: SilhouetteSlice, posed: wp.array, part: PartArrays, frozen: FrozenArrays) -> None:
        """Draw and count what stays, of ``posed`` (run, vertex)."""
        drawn = frozen.of(0, 0)
        freeze(posed, part.vertex, part.outline, self.cameras, own.scratch, own.image, own.visible, drawn)
