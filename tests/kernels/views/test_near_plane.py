"""What the near plane cuts, seen from between a body's parts or from inside it."""

import numpy as np
import pytest
import warp as wp
from drawn import Drawing, bare_mesh, flat_rig
from random_scenes import random_masks
from synthetic import ring_rig

from mmocap_warp.kernels.views.projection import NEAR
from mmocap_warp.silhouettes import RENDERERS

CUBE = np.array(
    [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
     [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7]]
)  # fmt: skip


def box(low, high):
    """(8, 3) corners of a box; ``CUBE`` are its faces, counter-clockwise seen from outside."""
    x, y, z = np.array([low, high], float).T
    return np.array([[x[i], y[j], z[k]] for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))])


def count(points, faces, rig, masks, device, renderer):
    """(camera, 2) of one posed mesh."""
    posed = wp.array(np.asarray(points)[None], dtype=wp.vec3, device=device)
    return Drawing(bare_mesh(faces), rig, posed, renderer).count(masks)[0]


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("turned", [1, -1])
def test_a_floor_is_seen_up_to_its_far_edge(device, turned, renderer):
    """A floor 1 m below, from 4 m behind to 4 m ahead of the camera and 2 m to its sides: three edges are seen."""
    rig = flat_rig([(45, 30)])
    rig.K[0] = [[20, 0, 22.25], [0, 20, 10.25], [0, 0, 1]]
    floor = np.array([[-2, 1, -4], [2, 1, -4], [2, 1, 4], [-2, 1, 4]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])[:, ::turned]
    column, row = np.meshgrid(np.arange(45), np.arange(30))
    below = (row - 10.25) / 20  # m per metre of depth
    with np.errstate(divide="ignore"):
        depth = 1 / np.where(below > 0, below, 1e-9)
    picture = (depth < 4) & (np.abs((column - 22.25) / 20 * depth) < 2)
    assert count(floor, faces, rig, [picture], device, renderer)[0].tolist() == [picture.sum()] * 2
    assert 0 < picture[16].sum() < 45


@pytest.mark.parametrize("renderer", RENDERERS)
def test_from_inside_a_body_nothing_else_is_seen(device, renderer):
    rig = ring_rig(cameras=3, size=(97, 61))
    masks = random_masks(rig.size)
    around = rig.centres[1] + box((-0.3, -0.4, -0.2), (0.5, 0.3, 0.6))
    found = count(around, CUBE, rig, masks, device, renderer)
    assert found[1].tolist() == [97 * 61, masks[1].sum()]
    assert found[0, 0] < 97 * 61


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("depth", [(-1.0, -0.5), (NEAR / 4, NEAR / 2)])
def test_what_lies_before_the_near_plane_is_not_seen(device, depth, renderer):
    rig, everywhere = flat_rig([(40, 30)]), [np.ones((30, 40), bool)]
    rig.K[0] = [[20, 0, 20], [0, 20, 15], [0, 0, 1]]
    assert not count(box((-1, -1, depth[0]), (1, 1, depth[1])), CUBE, rig, everywhere, device, renderer).any()


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_box_that_is_cut_is_seen_like_one_that_ends_there(device, renderer):
    """The open end of a box, cut off at the near plane, is filled with the inside of its back."""
    rig = flat_rig([(160, 120)])
    rig.K[0] = [[80, 0, 80.3], [0, 80, 60.4], [0, 0, 1]]
    masks = random_masks(rig.size)
    for low, high in (((-0.02, -0.03, 0), (0.03, 0.02, 0)), ((0.01, -0.04, 0), (0.05, 0.02, 0))):
        seen = [
            count(box((*low[:2], near), (*high[:2], 2.0)), CUBE, rig, masks, device, renderer)[0].tolist()
            for near in (-0.5, NEAR * 1.0001)
        ]
        assert seen[0] == seen[1]
        assert 500 < seen[0][0] < 160 * 120
