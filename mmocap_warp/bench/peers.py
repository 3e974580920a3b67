"""Other ways to draw silhouettes, beside ours in the same process: Embree's rays and OpenCV's polygons.

They are given more than ours: vertices are posed, projected, and rays are made beforehand, and nothing of that is
timed. What is timed is drawing and counting, from posed vertices to |M| and |M and F|.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np

from mmocap_warp.bench.evaluations import evaluations
from mmocap_warp.bench.workload import Workload
from mmocap_warp.kernels.benchmarks.case import Case, Check
from mmocap_warp.observation import unpack_masks

PEER = "peers"

_CANDIDATES = 4  # as many as a core does in a fraction of a second
_SUBPIXEL_BITS = 4
# Embree has no grid of sub-pixels: contours shift by up to 1/32 px. OpenCV fills what its polygons' outlines touch, and
# so about half a pixel more all around.
_ALLOWED = {"embree": 0.003, "opencv": 0.08}  # relative difference of |M|


class Box(NamedTuple):
    """The pixels of a camera within which a body lies: columns and rows, each first and one past the last."""

    left: int
    right: int
    top: int
    bottom: int


def peers(load: Workload, names: Sequence[str]) -> Iterator[list[Case]]:
    """The named peers and our whole evaluation with one thread, taking turns."""
    if not names:
        return
    (ours,) = evaluations(load, (_CANDIDATES,), (1,), "cpu", group=PEER)
    poses = load.poses(_CANDIDATES)
    expected = load.objective(_CANDIDATES, "raster", "cpu")
    expected.evaluate(_CANDIDATES)
    reference = expected.count.numpy().astype(int)
    makers = {"embree": _embree, "opencv": _opencv}
    yield [*ours, *(_peer(load, name, makers[name](load, poses), reference) for name in names)]


def _peer(load: Workload, name: str, work: Callable[[np.ndarray], None], reference: np.ndarray) -> Case:
    count = np.zeros_like(reference)

    def check() -> Check:
        count[:] = 0
        work(count)
        apart = np.abs(count - reference)[..., 0].sum() / reference[..., 0].sum()
        return Check(f"|M| differs by {100 * apart:.2g} %, {100 * _ALLOWED[name]:g} % allowed", apart <= _ALLOWED[name])

    sizes = {"candidates": len(reference)} | load.sizes | {"threads": 1}
    return Case(PEER, name, sizes, partial(work, count), check, len(reference))


def _boxes(load: Workload, pixels: np.ndarray) -> list[Box]:
    """The box in each camera of projected vertices (camera, vertex, 2)."""
    low, high = np.floor(pixels.min(axis=1)).astype(int), np.ceil(pixels.max(axis=1)).astype(int) + 1
    low, high = np.maximum(low, 0), np.minimum(high, load.rig.size)
    return [Box(a[0], b[0], a[1], b[1]) for a, b in zip(low, high, strict=True)]


def _masks(load: Workload) -> list[np.ndarray]:
    return unpack_masks(load.observation.words, load.rig.size)


def _embree(load: Workload, poses: np.ndarray) -> Callable[[np.ndarray], None]:
    """A scene a candidate, built anew, and a ray for each pixel of the body's boxes that ends at any hit."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    faces, vertices = load.body.tracking_face, load.vertices(poses)
    rays = [_rays(load, _boxes(load, pixels)) for pixels in load.pixels(poses)]

    def work(count: np.ndarray) -> None:
        for c, (origin, direction, observed, ends) in enumerate(rays):
            scene = EmbreeScene()
            TriangleMesh(scene, vertices[c][faces])
            hit = scene.run(origin, direction, query="OCCLUDED") >= 0
            overlap = hit & observed
            for k, (first, end) in enumerate(pairwise(ends)):
                count[c, k] = hit[first:end].sum(), overlap[first:end].sum()

    return work


class Rays(NamedTuple):
    """Of all cameras, one after the other."""

    origin: np.ndarray  # (ray, 3) [m]
    direction: np.ndarray  # (ray, 3)
    observed: np.ndarray  # (ray,) bool, the mask at its pixel
    ends: list[int]  # of each camera's, from 0 on


def _rays(load: Workload, boxes: list[Box]) -> Rays:
    rig, masks = load.rig, _masks(load)
    origins, directions, observed = [], [], []
    for k, box in enumerate(boxes):
        x, y = np.meshgrid(np.arange(box.left, box.right), np.arange(box.top, box.bottom))
        plane = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3) @ np.linalg.inv(rig.K[k]).T
        directions.append(plane @ rig.R[k])
        origins.append(np.tile(rig.centres[k], (len(plane), 1)))
        observed.append(masks[k][box.top : box.bottom, box.left : box.right].ravel())
    ends = np.cumsum([0, *(len(mask) for mask in observed)]).tolist()
    origin, direction = (np.concatenate(parts).astype(np.float32) for parts in (origins, directions))
    return Rays(origin, direction, np.concatenate(observed), ends)


def _opencv(load: Workload, poses: np.ndarray) -> Callable[[np.ndarray], None]:
    """Every triangle as a polygon, on images that are cleared within the body's boxes."""
    faces, projected = load.body.tracking_face, load.pixels(poses)
    fixed = np.rint(projected * 2**_SUBPIXEL_BITS).astype(np.int32)
    corners = np.ascontiguousarray(fixed[:, :, faces])
    boxes = [_boxes(load, pixels) for pixels in projected]
    masks = [mask.view(np.uint8) for mask in _masks(load)]
    images = [np.zeros((height, width), np.uint8) for width, height in load.rig.size.tolist()]

    def work(count: np.ndarray) -> None:
        for c in range(len(corners)):
            for k, image in enumerate(images):
                box = boxes[c][k]
                part = image[box.top : box.bottom, box.left : box.right]
                part[:] = 0
                for triangle in corners[c, k]:
                    cv2.fillConvexPoly(image, triangle, 1, cv2.LINE_8, _SUBPIXEL_BITS)
                observed = masks[k][box.top : box.bottom, box.left : box.right]
                count[c, k] = cv2.countNonZero(part), cv2.countNonZero(part & observed)

    return work
