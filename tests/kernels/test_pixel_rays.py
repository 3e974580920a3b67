"""Packets of rays against one ray a pixel, which share no code below the camera."""

import numpy as np
import warp as wp
from poisoned import poisoned
from random_scenes import ODD_SIZES, posed_vertices, projected, random_poses
from synthetic import ring_rig, synthetic_body, synthetic_subject

from mmocap_warp.bvh import build_bvh
from mmocap_warp.kernels.pixel_rays import cast_pixels
from mmocap_warp.kernels.raycast import cast, refit
from mmocap_warp.objective import CameraArrays
from mmocap_warp.observation import unpack_masks, words_per_row

PIXELS_APART = 1e-4  # of the image; corners are moved by up to half of a sixteenth of a pixel to the grid


def drawn(posed, faces, rig, device):
    """(candidate, camera, row, word) of one ray a pixel."""
    cameras = CameraArrays(rig, device)
    shape = (posed.shape[0], len(rig), int(rig.size[:, 1].max()), words_per_row(int(rig.size[:, 0].max())))
    silhouette = poisoned(shape, wp.uint32, device)
    triangle = wp.array(faces, dtype=wp.vec3i, device=device)
    cast_pixels(posed, triangle, cameras.rotation, cameras.translation, cameras.intrinsics, cameras.size, silhouette)
    return silhouette


def test_a_square_fills_whole_pixels(device):
    """Corners half a pixel outside of the pixel centres of (3, 5) to (40, 17); an image of odd size."""
    rig = ring_rig(cameras=1, size=(70, 30))
    x, y = np.array([2.5, 40.5, 40.5, 2.5]), np.array([4.5, 4.5, 17.5, 17.5])
    rays = np.linalg.solve(rig.K[0], np.stack([x, y, np.ones(4)])).T
    corners = rig.centres[0] + 2.0 * rays @ rig.R[0]
    posed = wp.array(corners[None], dtype=wp.vec3, device=device)
    words = drawn(posed, np.array([[0, 2, 1], [0, 3, 2]]), rig, device).numpy()
    picture = np.zeros((30, 70), bool)
    picture[5:18, 3:41] = True
    np.testing.assert_array_equal(unpack_masks(words[0], rig.size)[0], picture)


def test_smaller_images_are_padded_with_background(device):
    body = synthetic_body()
    rig = ring_rig(cameras=len(ODD_SIZES), size=(97, 75), distance=1.5)
    rig = type(rig)(rig.names, rig.K, rig.R, rig.t, np.array(ODD_SIZES), rig.distortion, rig.up)
    posed = posed_vertices(body, np.eye(3), random_poses(2, reach=0.2), device)
    words = drawn(posed, body.tracking.face, rig, device).numpy()
    for k, (width, height) in enumerate(ODD_SIZES):
        bits = np.unpackbits(words[:, k].view("u1"), axis=-1, bitorder="little")
        assert bits[:, :height, :width].any()
        assert not bits[:, height:].any()
        assert not bits[:, :, width:].any()


def test_packets_see_what_single_rays_see(device, record_property):
    body, base = synthetic_body(), synthetic_subject().root_base
    rig = ring_rig()
    cameras = CameraArrays(rig, device)
    posed = posed_vertices(body, base, random_poses(6, reach=0.5), device)
    single = drawn(posed, body.tracking.face, rig, device)

    bvh = build_bvh(body.tracking.rest, body.tracking.face)
    node, triangle = (
        wp.array(bvh.node, dtype=wp.vec4i, device=device),
        wp.array(bvh.triangle, dtype=wp.vec3i, device=device),
    )
    levels = [wp.array(level, dtype=wp.int32, device=device) for level in bvh.levels]
    image = projected(posed, rig)
    box = poisoned((*image.shape[:2], len(node)), wp.vec4i, device)
    refit(node, levels, triangle, image, box)
    apart, covered = 0, 0
    for c in range(len(posed)):
        count = poisoned((1, len(rig)), wp.vec2i, device)
        cast(node, triangle, image[c : c + 1], box[c : c + 1], cameras.size, single[c], count)
        by_rays = np.bitwise_count(single[c].numpy()).sum(axis=(1, 2), dtype=int)
        by_packets, by_both = count.numpy()[0].T
        apart += np.sum(by_rays + by_packets - 2 * by_both)
        covered += np.sum(by_rays)
    pixels = len(posed) * len(rig) * 640 * 480
    record_property("pixels_apart", f"{apart} of {pixels}, of which {covered} are covered")
    assert apart / pixels < PIXELS_APART
