"""Silhouettes of posed bodies, counted against masks: the whole body, or a moving piece over the frozen rest."""

from __future__ import annotations

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
from mmocap_warp.kernels.structs import allocated
from mmocap_warp.masks.view_arrays import make_views
from mmocap_warp.silhouettes.renderers import make_renderer, outline


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
        self.views = make_views(rig, device)
        view = (candidates, len(rig))
        self.canvas = allocated(
            Canvas,
            device,
            cell=(*view, len(mesh.rest)),
            facing=(*view, len(mesh.face)),
            box=(*view, self._renderer.boxes),
            group_box=(*view, self._renderer.groups),
            count=view,
        )
        self._nothing_frozen = self.make_frozen(0)

    def make_frozen(self, runs: int) -> Any:
        """Where the silhouettes of a resting piece are drawn, a set for every run, in the struct that kernels take."""
        cameras, rows, words = self.views.observed.shape
        view = (runs, cameras)
        return allocated(Frozen, self._device, words=(*view, rows, words), count=view, cut=view)

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
