"""Silhouettes of posed bodies, counted against masks: the whole body, or a part of it over the frozen rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.mesh_parts import split_mesh, whole_mesh
from mmocap_warp.body.model import SkinMesh
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.kernels import block
from mmocap_warp.kernels.silhouettes.counting import Cameras, Frozen
from mmocap_warp.objective.renderers import Contours, make_renderer
from mmocap_warp.views.observation import words_per_row
from mmocap_warp.views.rig import CameraRig


def camera_arrays(rig: CameraRig, device: str) -> Cameras:
    """A rig and empty masks for the kernels.

    Raises:
        ValueError: images so wide that a block cannot hold a row.
    """
    lens = np.stack([rig.K[:, 0, 0], rig.K[:, 1, 1], rig.K[:, 0, 2], rig.K[:, 1, 2]], axis=1)
    cameras = Cameras()
    cameras.rotation = wp.array(rig.R, dtype=wp.mat33, device=device)
    cameras.translation = wp.array(rig.t, dtype=wp.vec3, device=device)
    cameras.lens = wp.array(lens, dtype=wp.vec4, device=device)
    cameras.size = wp.array(rig.size.astype(np.int32), dtype=wp.vec2i, device=device)
    rows, words = int(rig.size[:, 1].max()), words_per_row(int(rig.size[:, 0].max()))
    if 8 * words >= block.WORDS:
        raise ValueError(f"images must be narrower than {4 * block.WORDS} px, got {rig.size[:, 0].max()}")
    cameras.observed = wp.zeros((len(rig), rows, words), dtype=wp.uint32, device=device)
    return cameras


@dataclass(frozen=True)
class Part:
    """Some of the mesh: the vertices (n,) that it needs, and its triangles as the renderer wants them."""

    vertex: wp.array
    drawn: Any


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
    count: wp.array
    arrays: tuple[wp.array, ...]


class Silhouettes:
    """Draws posed candidates in every camera and counts them against the masks in ``cameras.observed``.

    ``count`` (candidate, camera) holds (|M|, |M and F|) after :meth:`draw`. ``modules`` have the kernels.

    Args:
        mesh: the tracking mesh.
        rig: undistorted cameras, at the masks' size.
        candidates: the most candidates at a time.
        renderer: a name in :data:`~mmocap_warp.objective.renderers.RENDERERS`.
        device: a Warp device.
    """

    def __init__(self, mesh: SkinMesh, rig: CameraRig, candidates: int, renderer: str, device: str) -> None:
        self._mesh, self._device = mesh, device
        self.cameras = camera_arrays(rig, device)
        shape = (candidates, len(rig))
        self._renderer = make_renderer(renderer, mesh.rest, mesh.face, shape, device)
        self._contours = self._renderer if isinstance(self._renderer, Contours) else Contours(mesh.face, shape, device)
        self.modules = (self._renderer.module, self._contours.module)
        whole = whole_mesh(mesh)
        self.whole = Part(wp.array(whole.vertex, dtype=wp.int32, device=device), self._renderer.of(whole))
        self._nothing_frozen = FrozenArrays(1, self.cameras, device)
        self._image = wp.zeros((*shape, len(mesh.rest)), dtype=wp.vec2i, device=device)
        self.count = wp.zeros(shape, dtype=wp.vec2i, device=device)

    @property
    def candidate_arrays(self) -> list[wp.array[Any]]:
        """Those whose first axis is the candidates."""
        return [self._image, self.count, *self._renderer.arrays, *self._contours.arrays]

    def split(self, skeleton: Skeleton, index: np.ndarray) -> tuple[Part, Part] | None:
        """What coordinates ``index`` move and what they leave, or None where nothing is left."""
        moving, staying = split_mesh(self._mesh, skeleton, index)
        if not len(staying.face) or not len(moving.face):
            return None
        return (
            Part(wp.array(moving.vertex, dtype=wp.int32, device=self._device), self._renderer.of(moving)),
            Part(wp.array(staying.vertex, dtype=wp.int32, device=self._device), self._contours.of(staying)),
        )

    def slice(self, first: int, end: int) -> SilhouetteSlice:
        """Candidates ``first .. end - 1``, to be drawn by a thread of their own."""
        return SilhouetteSlice(
            first,
            block.scratch(self._device),
            self._image[first:end],
            self.count[first:end],
            tuple(array[first:end] for array in self._renderer.arrays),
        )

    def draw(
        self, own: SilhouetteSlice, posed: wp.array, part: Part, frozen: FrozenArrays | None, particles: int
    ) -> None:
        """Draw and count a slice's ``posed`` (candidate, vertex); of a part, over what is ``frozen`` for each run."""
        held = frozen.of(own.first, particles) if frozen else self._nothing_frozen.of(0, 0)
        self._renderer.draw(
            posed, part.vertex, part.drawn, self.cameras, held, own.scratch, own.image, own.arrays, own.count
        )

    def freeze(self, own: SilhouetteSlice, posed: wp.array, part: Part, frozen: FrozenArrays) -> None:
        """Draw and count what stays, of ``posed`` (run, vertex)."""
        self._contours.freeze(posed, part.vertex, part.drawn, self.cameras, own.scratch, own.image, frozen.of(0, 0))
