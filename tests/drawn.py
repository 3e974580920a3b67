"""Meshes drawn by the kernels straight from posed vertices, and bare triangles given by their image points."""

from __future__ import annotations

import numpy as np
import warp as wp
from pixel_rays import cast_pixels
from poisoned import poisoned

from mmocap_warp.body.model import SkinMesh
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.kernels.block import Batch, batch_of
from mmocap_warp.kernels.views.projection import BEHIND, SUBPIXEL
from mmocap_warp.masks.observation import make_views, pack_masks, unpack_masks
from mmocap_warp.silhouettes.silhouettes import Silhouettes


class Drawing:
    """A mesh in a rig's cameras, for as many candidates as there are ``posed`` (candidate, vertex) vec3 [m]."""

    def __init__(self, mesh: SkinMesh, rig: CameraRig, posed: wp.array, renderer: str = "raycast") -> None:
        self._posed, self._sizes = posed, rig.size
        self._silhouettes = Silhouettes(mesh, rig, posed.shape[0], renderer, str(posed.device))

    def count(self, masks: list[np.ndarray]) -> np.ndarray:
        """(candidate, camera, 2) of |M| and |M and F|, F the given boolean pictures, one a camera."""
        drawing = self._silhouettes
        count = drawing.canvas.count
        drawing.views.observed.assign(pack_masks(masks))
        count.assign(poisoned(count.shape, wp.vec2i, str(self._posed.device)))
        drawing.draw(self._posed, drawing.whole, whole_batch(self._posed))
        return count.numpy()

    def image(self) -> np.ndarray:
        """(candidate, camera, vertex, 2) cells, once :meth:`count` has projected them."""
        return self._silhouettes.canvas.cell.numpy()


def whole_batch(posed: wp.array) -> Batch:
    """All candidates in one launch."""
    return batch_of(0, posed.shape[0], posed.shape[0], str(posed.device))


def draw_bits(mesh: SkinMesh, rig: CameraRig, posed: wp.array) -> np.ndarray:
    """(candidate, camera, row, word) uint32: closed meshes as the kernels draw them."""
    device = str(posed.device)
    drawing = Silhouettes(mesh, rig, posed.shape[0], "raster", device)
    frozen = drawing.make_frozen(posed.shape[0])
    frozen.words.assign(poisoned(frozen.words.shape, wp.uint32, device))
    drawing.freeze(posed, drawing.whole, whole_batch(posed), frozen)
    return frozen.words.numpy()


def cast_bits(faces: np.ndarray, rig: CameraRig, posed: wp.array) -> np.ndarray:
    """(candidate, camera, row, word) uint32, by one ray a pixel."""
    device = str(posed.device)
    views = make_views(rig, device)
    bits = poisoned((posed.shape[0], *views.observed.shape), wp.uint32, device)
    cast_pixels(posed, wp.array(faces, dtype=wp.vec3i, device=device), views, bits)
    return bits.numpy()


def pictures_of(bits: np.ndarray, sizes: np.ndarray) -> list[list[np.ndarray]]:
    """Per candidate and camera a boolean picture."""
    return [unpack_masks(views, sizes) for views in bits]


def counts_of(pictures: list[list[np.ndarray]], masks: list[np.ndarray]) -> np.ndarray:
    """(candidate, camera, 2) of |M| and |M and F|."""
    return np.array([[(m.sum(), (m & f).sum()) for m, f in zip(views, masks, strict=True)] for views in pictures])


def bare_mesh(faces: np.ndarray) -> SkinMesh:
    """A mesh of which only the faces matter; its vertices lie in the order of their numbers."""
    vertices = int(faces.max()) + 1
    rest = np.arange(3 * vertices, dtype=np.float32).reshape(-1, 3)
    slot = np.zeros((vertices, 4), np.int32)
    return SkinMesh(rest, faces.astype(np.int32), slot, np.eye(4, dtype=np.float32)[slot[:, 0]])


def flat_rig(sizes: np.ndarray | tuple, shift: int = 0) -> CameraRig:
    """Cameras at the origin that see :func:`lifted` points at their cells, each ``shift`` px further right."""
    n = len(sizes)
    K = np.tile(np.eye(3), (n, 1, 1))
    K[:, 0, 2] = shift * np.arange(n)
    names = tuple(f"flat{k}" for k in range(n))
    return CameraRig(names, K, np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), np.array(sizes), np.zeros((n, 5)), "-y")


def lifted(cells: np.ndarray, device: str) -> wp.array:
    """(candidate, vertex) vec3 from (candidate, vertex, 2) cells: the points, 1 m away, in their middles.

    ``BEHIND`` stands for a point behind the camera.
    """
    x = (np.asarray(cells, np.float64) + 0.5) / SUBPIXEL
    points = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)
    points[np.asarray(cells)[..., 0] == BEHIND] = (0.25, 0.5, -1.0)
    return wp.array(points, dtype=wp.vec3, device=device)
