"""Silhouettes of posed bodies, counted against masks: the whole body, or a moving piece over the frozen rest."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.mesh_pieces import split_mesh, whole_mesh
from mmocap_warp.body.model import SkinMesh
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.kernels.batch import Batch
from mmocap_warp.kernels.silhouettes import raster
from mmocap_warp.kernels.silhouettes.counting import Canvas, Frozen
from mmocap_warp.kernels.silhouettes.raster import Outline
from mmocap_warp.kernels.structs import filled
from mmocap_warp.masks.view_arrays import ViewArrays
from mmocap_warp.silhouettes.renderers import make_renderer, outline


class FrozenArrays:
    """Where the silhouettes of a resting piece are drawn, a set for every run, and the ``struct`` that kernels take."""

    def __init__(self, runs: int, views: ViewArrays, device: str) -> None:
        cameras, rows, words = views.observed.shape
        self.words = wp.zeros((runs, cameras, rows, words), dtype=wp.uint32, device=device)
        self.count = wp.zeros((runs, cameras), dtype=wp.vec2i, device=device)
        self.cut = wp.zeros((runs, cameras), dtype=wp.int32, device=device)
        self.struct = filled(Frozen, **vars(self))


class CanvasArrays:
    """What candidates are drawn in and counted, and the ``struct`` of it that kernels take."""

    def __init__(self, shape: tuple[int, int], vertices: int, faces: int, boxes: int, groups: int, device: str) -> None:
        self.cell = wp.zeros((*shape, vertices), dtype=wp.vec2i, device=device)
        self.facing = wp.zeros((*shape, faces), dtype=wp.uint8, device=device)
        self.box = wp.zeros((*shape, boxes), dtype=wp.vec4i, device=device)
        self.group_box = wp.zeros((*shape, groups), dtype=wp.vec4i, device=device)
        self.count = wp.zeros(shape, dtype=wp.vec2i, device=device)
        self.struct = filled(Canvas, **vars(self))


class Silhouettes:
    """Draws posed candidates in every camera and counts them against the masks in ``views``.

    ``canvas.count`` (candidate, camera) holds (|M|, |M and F|) after :meth:`draw`. ``modules`` have the kernels.

    Args:
        mesh: the tracking mesh.
        rig: undistorted cameras, at the masks' size.
        candidates: the most candidates at a time.
        renderer: a name in ``RENDERERS``.
        device: a Warp device.
    """

    def __init__(self, mesh: SkinMesh, rig: CameraRig, candidates: int, renderer: str, device: str) -> None:
        self._mesh, self._device = mesh, device
        self._renderer = make_renderer(renderer, mesh.rest, mesh.face, device)
        self.modules = (self._renderer.module, raster)
        self.whole = self._renderer.piece(whole_mesh(mesh))
        self.views = ViewArrays(rig, device)
        shape, boxes = (candidates, len(rig)), (self._renderer.boxes, self._renderer.groups)
        self.canvas = CanvasArrays(shape, len(mesh.rest), len(mesh.face), *boxes, device)

    @cached_property
    def _nothing_frozen(self) -> FrozenArrays:
        return FrozenArrays(0, self.views, self._device)

    def split(self, skeleton: Skeleton, index: np.ndarray) -> tuple[Any, Outline] | None:
        """The piece that coordinates ``index`` move and the one that rests, or None where either is empty."""
        moving, resting = split_mesh(self._mesh, skeleton, index)
        if not len(resting.face) or not len(moving.face):
            return None
        return self._renderer.piece(moving), outline(resting, self._device)

    def draw(self, posed: wp.array[wp.vec3], piece: Any, batch: Batch, frozen: FrozenArrays | None = None) -> None:
        """Draw and count a piece of a batch's ``posed`` (candidate, vertex), over what is ``frozen`` for each run."""
        under = (frozen or self._nothing_frozen).struct
        self._renderer.draw(posed, piece, self.views.struct, under, batch, self.canvas.struct)

    def freeze(self, posed: wp.array[wp.vec3], resting: Outline, batch: Batch, frozen: FrozenArrays) -> None:
        """Draw and count the resting piece of ``posed`` (run, vertex); a batch's candidates are runs here."""
        raster.freeze(posed, resting, self.views.struct, batch, self.canvas.struct, frozen.struct)
