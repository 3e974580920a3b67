"""One ray a pixel: the reference of ``tests/test_silhouettes.py``, which shares nothing with the renderers."""

import numpy as np
import warp as wp
from drawn import cast_bits
from random_scenes import ODD_SIZES, posed_vertices, random_poses
from synthetic import ring_rig, synthetic_body

from mmocap_warp.masks.observation import unpack_masks


def test_a_square_fills_whole_pixels(device):
    """Corners half a pixel outside of the pixel centres of (3, 5) to (40, 17); an image of odd size."""
    rig = ring_rig(cameras=1, size=(70, 30))
    x, y = np.array([2.5, 40.5, 40.5, 2.5]), np.array([4.5, 4.5, 17.5, 17.5])
    rays = np.linalg.solve(rig.K[0], np.stack([x, y, np.ones(4)])).T
    corners = rig.centres[0] + 2.0 * rays @ rig.R[0]
    posed = wp.array(corners[None], dtype=wp.vec3, device=device)
    bits = cast_bits(np.array([[0, 2, 1], [0, 3, 2]]), rig, posed)
    picture = np.zeros((30, 70), bool)
    picture[5:18, 3:41] = True
    np.testing.assert_array_equal(unpack_masks(bits[0], rig.size)[0], picture)


def test_smaller_images_are_padded_with_background(device):
    body = synthetic_body()
    rig = ring_rig(cameras=len(ODD_SIZES), size=(97, 75), distance=1.5)
    rig = type(rig)(rig.names, rig.K, rig.R, rig.t, np.array(ODD_SIZES), rig.distortion, rig.up)
    posed = posed_vertices(body, np.eye(3), random_poses(2, reach=0.2), device)
    bits = cast_bits(body.tracking.face, rig, posed)
    for k, (width, height) in enumerate(ODD_SIZES):
        pixel = np.unpackbits(bits[:, k].view("u1"), axis=-1, bitorder="little")
        assert pixel[:, :height, :width].any()
        assert not pixel[:, height:].any()
        assert not pixel[:, :, width:].any()
