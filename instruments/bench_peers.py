"""Other ways to draw silhouettes, beside ours in the same process: Embree's rays and OpenCV's polygons.

What is timed begins with posed vertices and ends with |M| and |M and F|; ours also poses, before, and takes the cost,
after. Rays through all pixels of the cameras are made once, beforehand; a candidate takes those within its boxes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise

import cv2
import numpy as np

from mmocap_warp.bench.evaluations import evaluations
from mmocap_warp.bench.report_file import PEERS
from mmocap_warp.bench.workload import Workload
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.kernels.benchmarks.timing import Case, Check
from mmocap_warp.masks.observation import unpack_masks

_CANDIDATES = 4  # few enough for a core to draw them in a fraction of a second
_SUBPIXEL_BITS = 4
# Embree has no grid of sub-pixels: contours shift by up to 1/32 px. OpenCV fills what its polygons' outlines touch, and
# so about half a pixel more at each crossing of a contour.
_ALLOWED = {"embree": 0.1, "trimesh": 0.1, "opencv": 4.0}  # difference of |M|, in pixels a row of the body


Box = tuple[slice, slice]
"""The pixels of a camera within which a body lies: rows and columns."""


def peers(load: Workload, names: Sequence[str]) -> Iterator[list[Case]]:
    """The named peers and our whole evaluation with one thread, taking turns."""
    names = [name for name in names if name in _ALLOWED]
    if not names:
        return
    (ours,) = evaluations(load, (_CANDIDATES,), (1,), "cpu", group=PEERS)
    expected = load.objective(_CANDIDATES, "raster", "cpu")
    expected.evaluate(_CANDIDATES)
    reference = expected.count.numpy().astype(int)
    vertices = load.vertices(load.poses(_CANDIDATES))
    draw = {name: _opencv(load, vertices) if name == "opencv" else _rays(load, vertices, name) for name in names}
    yield [*ours, *(_peer(load, name, draw[name], reference) for name in names)]


def _peer(load: Workload, name: str, work: Callable[[np.ndarray], None], reference: np.ndarray) -> Case:
    count = np.zeros_like(reference)

    def check() -> Check:
        count[:] = 0
        work(count)
        apart = np.abs(count - reference)[..., 0].mean() / load.height
        return Check(f"|M| differs by {apart:.2g} pixels a row of the body", apart <= _ALLOWED[name])

    sizes = {"candidates": len(reference)} | load.sizes | {"threads": 1}
    return Case(PEERS, name, sizes, partial(work, count), check, len(reference))


def _boxes(load: Workload, pixels: np.ndarray) -> list[Box]:
    """The box in each camera of projected vertices (camera, vertex, 2)."""
    low, high = np.floor(pixels.min(axis=1)).astype(int), np.ceil(pixels.max(axis=1)).astype(int) + 1
    low, high = np.maximum(low, 0), np.minimum(high, load.rig.size)
    return [np.s_[a[1] : b[1], a[0] : b[0]] for a, b in zip(low, high, strict=True)]


Cast = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Origins and directions (ray, 3) float32 to hits (ray,) bool."""


def _caster(name: str, posed: np.ndarray, faces: np.ndarray) -> Cast:
    """Embree as it is, or as trimesh offers it."""
    if name == "trimesh":
        import trimesh

        return trimesh.Trimesh(posed, faces, process=False).ray.intersects_any
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    TriangleMesh(scene, posed[faces])
    return lambda origin, direction: scene.run(origin, direction, query="OCCLUDED") >= 0


def _rays(load: Workload, vertices: np.ndarray, name: str) -> Callable[[np.ndarray], None]:
    """A scene a candidate, built anew, and a ray for each pixel of the body's boxes that ends at any hit."""
    masks, eyes = unpack_masks(load.observation.words, load.rig.size), load.rig.centres.astype(np.float32)
    directions = [_directions(load.rig, k) for k in range(len(load.rig))]

    def work(count: np.ndarray) -> None:
        for c, posed in enumerate(vertices):
            cast = _caster(name, posed, load.body.tracking_face)
            boxes = _boxes(load, project(load.rig, posed))
            rays = [image[box].reshape(-1, 3) for box, image in zip(boxes, directions, strict=True)]
            ends = np.cumsum([0, *map(len, rays)])
            hit = cast(np.repeat(eyes, np.diff(ends), axis=0), np.concatenate(rays))
            for k, (first, end) in enumerate(pairwise(ends)):
                model = hit[first:end]
                count[c, k] = np.count_nonzero(model), np.count_nonzero(model & masks[k][boxes[k]].ravel())

    return work


def _directions(rig: CameraRig, k: int) -> np.ndarray:
    """Of the rays through a camera's pixels in the world, (height, width, 3) float32."""
    x, y = np.meshgrid(*map(np.arange, rig.size[k].tolist()))
    plane = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(rig.K[k]).T
    return (plane @ rig.R[k]).astype(np.float32)


def _opencv(load: Workload, vertices: np.ndarray) -> Callable[[np.ndarray], None]:
    """Every triangle as a polygon, on images that are cleared within the body's boxes."""
    masks = [mask.view(np.uint8) for mask in unpack_masks(load.observation.words, load.rig.size)]
    images = [np.zeros((height, width), np.uint8) for width, height in load.rig.size.tolist()]

    def work(count: np.ndarray) -> None:
        for c, posed in enumerate(vertices):
            pixels = project(load.rig, posed)
            corners = np.rint(pixels * 2**_SUBPIXEL_BITS).astype(np.int32)
            for k, (image, box) in enumerate(zip(images, _boxes(load, pixels), strict=True)):
                model = image[box]
                model[:] = 0
                for triangle in corners[k][load.body.tracking_face]:
                    cv2.fillConvexPoly(image, triangle, 1, cv2.LINE_8, _SUBPIXEL_BITS)
                count[c, k] = cv2.countNonZero(model), cv2.countNonZero(model & masks[k][box])

    return work
