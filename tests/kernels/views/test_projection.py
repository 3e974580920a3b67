import cv2
import numpy as np
import reference
import warp as wp
from drawn import Drawing, bare_mesh
from random_scenes import indoor_rig, random_masks
from synthetic import ring_rig

from mmocap_warp.kernels.views.projection import BEHIND, NEAR, SUBPIXEL

FLOAT32 = 2e-3  # [px], error of single precision at a thousand pixels
HALF_CELL = 0.5 / SUBPIXEL  # [px]


def pixels(rig, points):
    """(camera, point, 2) float64 of the twin [px], and depths (camera, point) [m]."""
    lens = np.stack([rig.K[:, 0, 0], rig.K[:, 1, 1], rig.K[:, 0, 2], rig.K[:, 1, 2]], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = [reference.project(points, rig.R[k], rig.t[k], lens[k]) for k in range(len(rig))]
    return np.stack(seen), np.einsum("kj,nj->kn", rig.R[:, 2], points) + rig.t[:, 2:]


def cells(rig, points, device):
    """(camera, point, 2) int of the kernels: of a mesh whose vertices the points are."""
    posed = wp.array(np.asarray(points, np.float32)[None], dtype=wp.vec3, device=device)
    drawing = Drawing(bare_mesh(np.arange(len(points) // 3 * 3).reshape(-1, 3)), rig, posed)
    drawing.count(random_masks(rig.size))
    return drawing.image()[0]


def random_points(n, reach, seed):
    return np.random.default_rng(seed).uniform(-reach, reach, (n, 3)).astype(np.float32)


def test_points_fall_into_the_cell_around_them(device):
    rig, points = ring_rig(), random_points(600, 1.0, seed=0)
    found = cells(rig, points, device)
    expected = np.floor(SUBPIXEL * pixels(rig, points.astype(float))[0])
    assert np.abs(found - expected).max() <= 1
    assert np.mean(found != expected) < 2 * SUBPIXEL * FLOAT32


def test_points_are_where_opencv_projects_them(device):
    rig, points = ring_rig(), random_points(300, 1.0, seed=1)
    found = (cells(rig, points, device) + 0.5) / SUBPIXEL
    for k in range(len(rig)):
        turn = cv2.Rodrigues(rig.R[k])[0]
        expected = cv2.projectPoints(points.astype(float), turn, rig.t[k], rig.K[k], None)[0][:, 0]
        assert np.abs(found[k] - expected).max() < HALF_CELL + FLOAT32


def test_points_before_the_near_plane_do_not_project(device):
    rig, points = indoor_rig(), random_points(900, 3.0, seed=2)
    found = cells(rig, points, device)
    _, depth = pixels(rig, points.astype(float))
    clear = np.abs(depth - NEAR) > 1e-5
    behind = np.all(found == BEHIND, axis=-1)
    np.testing.assert_array_equal(behind[clear], (depth < NEAR)[clear])
    assert np.any(depth < NEAR)
    assert not np.any((found == BEHIND).any(axis=-1) & ~behind)


def test_far_outside_the_image_coordinates_stay_on_a_bounded_grid(device):
    rig = ring_rig(cameras=1)
    right, down, forward = rig.R[0]
    points = rig.centres[0] + NEAR * 1.01 * forward + np.array([[1e3], [-1e3], [0]]) * (right + down)
    found = cells(rig, points, device)[0, :2]
    np.testing.assert_array_equal(found, [[2**20, 2**20], [-(2**20), -(2**20)]])
