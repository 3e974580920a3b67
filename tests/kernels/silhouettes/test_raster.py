"""What is particular to drawing by contours: bands of rows, and layers counted in bytes."""

import numpy as np
import pytest
import reference
from drawn import Drawing, bare_mesh, draw_bits, flat_rig, lifted, pictures_of
from random_scenes import posed_vertices, random_masks, random_poses
from synthetic import ring_rig, synthetic_body, synthetic_subject

from mmocap_warp.kernels.views.projection import SUBPIXEL
from mmocap_warp.silhouettes import RENDERERS

# A band of 4,000 px wide rows has 10 of them, one of 70 px 409; the last one is ten words and one row.
LARGE = ((4000, 45), (70, 2000), (289, 1))


@pytest.mark.parametrize("renderer", RENDERERS)
def test_images_of_several_bands_are_drawn_exactly(device, renderer):
    rng = np.random.default_rng(0)
    rig = flat_rig(LARGE)
    cells = np.concatenate([SUBPIXEL * rng.integers(-50, (4050, 50), (4, 12, 2)),
                            SUBPIXEL * rng.integers(-50, (120, 2050), (4, 12, 2))])  # fmt: skip
    faces = np.arange(12).reshape(-1, 3)
    for points in cells:
        drawing = Drawing(bare_mesh(faces), rig, lifted(points[None], device), renderer)
        pictures = [reference.covered(points, faces, *size) for size in LARGE]
        expected = [[picture.sum()] * 2 for picture in pictures]
        assert drawing.count(pictures)[0].tolist() == expected


def test_bodies_in_images_of_several_bands_are_drawn_exactly(device):
    """Bit by bit what the twin draws, which is also what both renderers count."""
    body, base = synthetic_body(), synthetic_subject().root_base
    rig = ring_rig(cameras=2, size=(1500, 500), distance=3.0)
    posed = posed_vertices(body, base, random_poses(3, reach=0.3), device)
    masks = random_masks(rig.size)
    drawn = pictures_of(draw_bits(body.tracking, rig, posed), rig.size)
    for renderer in RENDERERS:
        drawing = Drawing(body.tracking, rig, posed, renderer)
        found = drawing.count(masks)
        for c, views in enumerate(drawing.image()):
            for k, view in enumerate(views):
                picture = reference.covered(view, body.tracking.face, *rig.size[k])
                np.testing.assert_array_equal(drawn[c][k], picture)
                assert found[c, k].tolist() == [picture.sum(), (picture & masks[k]).sum()]


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("layers", [1, 100, 127])
def test_up_to_127_layers_may_lie_in_front_of_a_pixel(device, layers, renderer):
    """No more: beyond that ``raster``'s sums flow over into the next pixel's. Bodies have less than a dozen.

    A quarter of the layers begin and end at the same pixels, the others a little later; next to them is a single one.
    """
    corner = np.array([[-1, -1], [63, -1], [63, 63], [-1, 63]])
    shift = np.zeros((layers + 1, 1, 2), int)
    shift[:layers, 0, 0] = np.maximum(0, np.arange(layers) - layers // 4) % SUBPIXEL
    shift[layers, 0, 0] = 66
    points = (corner + shift).reshape(-1, 2)
    square = np.array([[0, 2, 1], [0, 3, 2]])
    faces = np.concatenate([square + 4 * i for i in range(layers + 1)])
    picture = reference.covered(points, faces, 40, 6)
    drawing = Drawing(bare_mesh(faces), flat_rig([(40, 6)]), lifted(points[None], device), renderer)
    assert drawing.count([picture])[0, 0].tolist() == [picture.sum()] * 2
    assert picture.sum() == 4 * (9 if layers > 1 else 8)
