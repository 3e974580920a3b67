"""The packet ray caster counts exactly the pixels that its twin covers, on the kernel's own snapped images."""

import cv2
import numpy as np
import pytest
import reference
import warp as wp
from poisoned import poisoned
from random_scenes import ODD_SIZES, indoor_rig, posed_vertices, projected, random_poses
from synthetic import ring_rig, synthetic_body, synthetic_subject

from mmocap_warp.bvh import build_bvh
from mmocap_warp.kernels import raycast
from mmocap_warp.kernels.projection import BEHIND, SUBPIXEL
from mmocap_warp.observation import pack_masks


class Caster:
    """A tree over the faces of a rest pose, and the arrays that the kernels take."""

    def __init__(self, rest, faces, sizes, device):
        self.device, self.faces, self.sizes = device, faces, np.asarray(sizes)
        bvh = build_bvh(rest, faces)
        self.node = wp.array(bvh.node, dtype=wp.vec4i, device=device)
        self.levels = [wp.array(level, dtype=wp.int32, device=device) for level in bvh.levels]
        self.triangle = wp.array(bvh.triangle, dtype=wp.vec3i, device=device)
        self.size = wp.array(self.sizes, dtype=wp.vec2i, device=device)

    def refit(self, image):
        box = poisoned((*image.shape[:2], len(self.node)), wp.vec4i, self.device)
        raycast.refit(self.node, self.levels, self.triangle, image, box)
        return box

    def count(self, image, masks):
        """(candidate, camera, 2) of the kernel: |M| and |M and F|."""
        observed = wp.array(pack_masks(masks), dtype=wp.uint32, device=self.device)
        count = poisoned(image.shape[:2], wp.vec2i, self.device)
        raycast.cast(self.node, self.triangle, image, self.refit(image), self.size, observed, count)
        return count.numpy()

    def silhouettes(self, image):
        """Per candidate and camera the twin's picture (row, column)."""
        return [
            [reference.covered(view, self.faces, *self.sizes[k]) for k, view in enumerate(views)]
            for views in image.numpy()
        ]


def counts_of(silhouettes, masks):
    return np.array([[(m.sum(), (m & f).sum()) for m, f in zip(views, masks, strict=True)] for views in silhouettes])


def random_masks(sizes, seed=0):
    rng = np.random.default_rng(seed)
    return [rng.random((height, width)) < 0.5 for width, height in sizes]


def random_triangles(kind, rng, candidates, sizes, triangles=24):
    """(candidate, camera, vertex, 2) int corners: slivers, giants, points on pixel centres, some behind the camera."""
    shape = (candidates, len(sizes), 3 * triangles, 2)
    extent = SUBPIXEL * np.array(sizes)[None, :, None]
    image = rng.integers(-extent, 2 * extent, shape)
    if kind == "small":
        middle = np.repeat(rng.integers(-extent // 4, extent * 5 // 4, (*shape[:2], triangles, 2)), 3, axis=2)
        image = middle + rng.integers(-60, 61, shape)
    elif kind == "on centres":
        image = image // SUBPIXEL * SUBPIXEL
    elif kind == "giant":
        image = np.where(rng.random(shape) < 0.5, rng.integers(-(2**20), 2**20 + 1, shape), image)
    image[rng.random(shape[:3]) < 0.02] = BEHIND
    return image.astype(np.int32)


@pytest.mark.parametrize("kind", ["wide", "small", "on centres", "giant"])
def test_counts_of_any_triangles_are_exact(device, kind):
    rng = np.random.default_rng(7)
    corners = random_triangles(kind, rng, 12, ODD_SIZES)
    faces = np.arange(corners.shape[2], dtype=np.int32).reshape(-1, 3)
    caster = Caster(rng.normal(0, 1, (corners.shape[2], 3)), faces, ODD_SIZES, device)
    image = wp.array(corners, dtype=wp.vec2i, device=device)
    masks = random_masks(ODD_SIZES)
    expected = counts_of(caster.silhouettes(image), masks)
    np.testing.assert_array_equal(caster.count(image, masks), expected)
    assert np.mean(expected[..., 0] > 0) > 0.9


@pytest.mark.parametrize("seed", range(3))
def test_counts_of_people_around_the_cameras_are_exact(device, seed):
    """Cameras stand among the people: some bodies are out of view in part, behind, or around the camera itself."""
    body, base = synthetic_body(), synthetic_subject().root_base
    rig = indoor_rig(seed=seed)
    posed = posed_vertices(body, base, random_poses(25, seed=seed), device)
    image = projected(posed, rig)
    caster = Caster(body.tracking.rest, body.tracking.face, rig.size, device)
    masks = random_masks(rig.size, seed)
    expected = counts_of(caster.silhouettes(image), masks)
    np.testing.assert_array_equal(caster.count(image, masks), expected)
    behind = (image.numpy() == BEHIND).all(axis=-1)
    assert np.any(behind.any(axis=-1) & ~behind.all(axis=-1))  # in front in part
    assert np.any(expected[..., 0] > 0)


def test_both_ways_to_refit_and_to_cast_agree(device):
    """The CPU walks a tree or an image in one thread, a GPU gives a thread to each node or packet."""
    body = synthetic_body()
    rig = indoor_rig()
    image = projected(posed_vertices(body, np.eye(3), random_poses(20), device), rig)
    caster = Caster(body.tracking.rest, body.tracking.face, rig.size, device)
    shape = (*image.shape[:2], len(caster.node))
    inputs = [caster.node, caster.triangle, image]
    whole, level_wise = poisoned(shape, wp.vec4i, device), poisoned(shape, wp.vec4i, device)
    wp.launch(raycast._refit, dim=shape[:2], inputs=inputs, outputs=[whole], device=device)
    for level in caster.levels:
        dim = (*shape[:2], len(level))
        wp.launch(raycast._refit_level, dim=dim, inputs=[level, *inputs], outputs=[level_wise], device=device)
    np.testing.assert_array_equal(whole.numpy(), level_wise.numpy())

    observed = wp.array(pack_masks(random_masks(rig.size)), dtype=wp.uint32, device=device)
    inputs = [*inputs, whole, caster.size, observed]
    one_thread, packet_wise = poisoned(shape[:2], wp.vec2i, device), wp.zeros(shape[:2], dtype=wp.vec2i, device=device)
    wp.launch(raycast._cast, dim=shape[:2], inputs=inputs, outputs=[one_thread], device=device)
    dim = (*shape[:2], -(-observed.shape[1] // raycast.PACKET_ROWS), observed.shape[2])
    wp.launch(raycast._cast_each, dim=dim, inputs=inputs, outputs=[packet_wise], device=device)
    np.testing.assert_array_equal(one_thread.numpy(), packet_wise.numpy())
    assert one_thread.numpy()[..., 0].max() > 0


SQUARE = np.array([[0, 2, 1], [0, 3, 2]], np.int32)  # facing: counter-clockwise for the eye, y down


def square(left, top, right, bottom):
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def test_a_square_fills_whole_pixels(device):
    """Corners on pixel centres: the picture is known, edges included, and hidden when it turns its back."""
    size = (70, 30)
    corners = SUBPIXEL * np.stack([square(3, 5, 40, 17), square(3, 5, 40, 17)[::-1]])[:, None]
    image = wp.array(corners, dtype=wp.vec2i, device=device)
    caster = Caster(np.eye(4, 3), SQUARE, [size], device)
    picture = np.zeros((30, 70), bool)
    picture[5:18, 3:41] = True
    found = caster.count(image, [picture])[:, 0]
    assert found.tolist() == [[13 * 38, 13 * 38], [0, 0]]
    assert caster.count(image, [~picture])[0, 0].tolist() == [13 * 38, 0]


def test_pixels_are_covered_from_edge_to_edge(device):
    """Half a pixel around a pixel covers it alone; less than to the next centre on both sides covers none."""
    boxes = [(-8, -8, 8, 8), (1, 1, 15, 15), (0, 0, 0, 0), (0, 0, 1, 1), (-16, 0, 16, 0), (-16, -16, 15, 31)]
    image = wp.array(np.stack([square(*box) for box in boxes])[:, None], dtype=wp.vec2i, device=device)
    caster = Caster(np.eye(4, 3), SQUARE, [(8, 8)], device)
    found = caster.count(image, [np.ones((8, 8), bool)])[:, 0, 0]
    assert found.tolist() == [1, 0, 0, 1, 0, 2]


def opencv_silhouette(image, faces, width, height):
    """Facing triangles filled by OpenCV, which also draws every pixel that an outline touches."""
    canvas = np.zeros((height, width), np.uint8)
    corners = image[faces]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    for triangle in corners[a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0]]:
        cv2.fillConvexPoly(canvas, triangle, 1, lineType=cv2.LINE_8, shift=4)
    return canvas


def test_silhouettes_are_opencvs_up_to_boundary_pixels(device):
    body, base = synthetic_body(), synthetic_subject().root_base
    rig = ring_rig(cameras=3, size=(320, 240))
    image = projected(posed_vertices(body, base, random_poses(8, reach=0.3), device), rig)
    caster = Caster(body.tracking.rest, body.tracking.face, rig.size, device)
    for views, silhouettes in zip(image.numpy(), caster.silhouettes(image), strict=True):
        drawn = [opencv_silhouette(view, body.tracking.face, 320, 240) for view in views]
        found = caster.count(wp.array(views[None], dtype=wp.vec2i, device=device), drawn)[0]
        assert np.all(found[:, 1] == found[:, 0])  # no pixel that OpenCV does not draw
        for mask, silhouette in zip(drawn, silhouettes, strict=True):
            near = cv2.dilate(silhouette.astype(np.uint8), np.ones((3, 3)))
            assert not np.any(mask > near)  # OpenCV draws no pixel further than one from ours
