"""The tie rule: which pixels a triangle covers, exactly, whichever renderer draws it."""

import cv2
import numpy as np
import pytest
import reference
import warp as wp
from drawn import Drawing, bare_mesh, counts_of, draw_bits, flat_rig, lifted, pictures_of
from poisoned import poisoned
from random_scenes import ODD_SIZES, posed_vertices, random_masks, random_poses
from synthetic import ring_rig, synthetic_body, synthetic_subject

from mmocap_warp.kernels.silhouettes.coverage import crossing, edge
from mmocap_warp.kernels.views.projection import BEHIND, SUBPIXEL
from mmocap_warp.silhouettes import RENDERERS

SQUARE = np.array([[0, 2, 1], [0, 3, 2]], np.int32)  # facing: counter-clockwise for the eye, y down
LIMIT = 2**20  # cells
SIZES = (*ODD_SIZES, (1, 1), (32, 33), (64, 1))  # [px]


# Pictures that are known


def square(left, top, right, bottom):
    """The (4, 2) cells of a square's corners."""
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def squares_counted(squares, masks, device, renderer):
    """(candidate, 2) of the one camera's counts."""
    sizes = [masks[0].shape[::-1]]
    return Drawing(bare_mesh(SQUARE), flat_rig(sizes), lifted(squares, device), renderer).count(masks)[:, 0]


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_square_fills_whole_pixels(device, renderer):
    """From the cell before a pixel centre to the one after another: both are in it; turned around it is hidden."""
    corners = square(3 * SUBPIXEL - 1, 5 * SUBPIXEL - 1, 40 * SUBPIXEL, 17 * SUBPIXEL)
    picture = np.zeros((30, 70), bool)
    picture[5:18, 3:41] = True
    both = np.stack([corners, corners[::-1]])
    assert squares_counted(both, [picture], device, renderer).tolist() == [[13 * 38, 13 * 38], [0, 0]]
    assert squares_counted(both, [~picture], device, renderer)[0].tolist() == [13 * 38, 0]


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_cell_decides_which_side_of_a_pixel_centre_a_corner_lies_on(device, renderer):
    boxes = [(-8, -8, 8, 8), (-1, -1, 0, 0), (0, 0, 15, 15), (0, 0, 16, 16), (-1, -1, -1, 16), (-1, -1, 15, 31)]
    found = squares_counted(np.stack([square(*box) for box in boxes]), [np.ones((8, 8), bool)], device, renderer)
    assert found[:, 0].tolist() == [1, 1, 0, 1, 0, 2]


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_pixel_on_an_edge_belongs_to_the_side_on_the_right(device, renderer):
    """Squares halved along diagonals through pixel centres: the halves share no pixel and leave none out."""
    column, row = np.meshgrid(np.arange(6), np.arange(6))
    falling, rising = square(-1, -1, 63, 63), square(0, -1, 64, 63)
    first, second = (column < 4) & (row < 4), (column >= 1) & (column < 5) & (row < 4)
    halves = [
        (falling[[0, 2, 1]], first & (column >= row)),
        (falling[[0, 3, 2]], first & (column < row)),
        (rising[[0, 3, 1]], second & (column + row < 4)),
        (rising[[1, 3, 2]], second & (column + row >= 4)),
    ]
    for corners, picture in halves:
        drawing = Drawing(bare_mesh(np.array([[0, 1, 2]])), flat_rig([(6, 6)]), lifted(corners[None], device), renderer)
        assert drawing.count([picture]).ravel().tolist() == [picture.sum(), picture.sum()]


# Any triangles


def random_triangles(kind, rng, candidates, triangles=24):
    """(candidate, vertex, 2) cells: wide and small triangles, corners beside pixel centres, giants."""
    shape = (candidates, 3 * triangles, 2)
    extent = SUBPIXEL * np.array([100, 60])
    cells = rng.integers(-extent, 2 * extent, shape)
    if kind == "small":
        middle = np.repeat(rng.integers(-extent // 4, extent * 5 // 4, (candidates, triangles, 2)), 3, axis=1)
        cells = middle + rng.integers(-60, 61, shape)
    elif kind == "beside centres":  # 0 and -1: the cells on both sides of the centre
        cells = cells // SUBPIXEL * SUBPIXEL - rng.integers(0, 2, shape)
    elif kind == "long":  # edges on both sides of the 1024 cells up to which crossings are found in float32
        cells = rng.choice([-37, 0, 986, 987, 1023, 1024, 2047], shape) + rng.integers(-1, 2, shape)
    elif kind == "giant":
        cells = np.where(rng.random(shape) < 0.5, rng.integers(-LIMIT, LIMIT + 1, shape), cells)
        cells = np.where(rng.random(shape) < 0.1, rng.choice([-LIMIT, LIMIT], shape), cells)
    return cells


KINDS = ("wide", "small", "beside centres", "long", "giant")


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("kind", KINDS)
def test_any_triangles_are_drawn_exactly(device, kind, renderer):
    """Triangles that share nothing: half of them turn away, many are cut by an image's border."""
    rng = np.random.default_rng(7)
    cells = random_triangles(kind, rng, 20)
    faces = np.arange(cells.shape[1]).reshape(-1, 3)
    rig = flat_rig(SIZES, shift=5)
    drawing = Drawing(bare_mesh(faces), rig, lifted(cells, device), renderer)
    masks = random_masks(rig.size)
    found = drawing.count(masks)
    shift = 5 * SUBPIXEL * np.arange(len(rig))[:, None, None] * [1, 0]
    image = np.clip(cells[:, None] + shift, -LIMIT, LIMIT)
    np.testing.assert_array_equal(drawing.image(), image)
    pictures = [
        [reference.covered(view, faces, *rig.size[k]) for k, view in enumerate(views)] for views in drawing.image()
    ]
    np.testing.assert_array_equal(found, counts_of(pictures, masks))
    assert np.mean(found[:, : len(ODD_SIZES), 0] > 0) > 0.6
    for c in (0, 1):  # bit by bit
        one = Drawing(bare_mesh(faces), rig, lifted(cells[c : c + 1], device), renderer).count(pictures[c])
        np.testing.assert_array_equal(one[0, :, 1], one[0, :, 0])


@pytest.mark.parametrize("renderer", RENDERERS)
def test_faces_may_share_vertices_and_edges_in_any_way(device, renderer):
    """Surfaces that are open, cross themselves, or have three triangles at an edge."""
    rng = np.random.default_rng(8)
    cells = random_triangles("wide", rng, 20, triangles=4)
    rig = flat_rig(SIZES)
    masks = random_masks(rig.size)
    for _ in range(5):
        faces = np.stack([rng.permutation(12)[:3] for _ in range(30)])
        drawing = Drawing(bare_mesh(faces), rig, lifted(cells, device), renderer)
        found = drawing.count(masks)
        pictures = [
            [reference.covered(view, faces, *rig.size[k]) for k, view in enumerate(views)] for views in drawing.image()
        ]
        np.testing.assert_array_equal(found, counts_of(pictures, masks))


@pytest.mark.parametrize("kind", KINDS)
def test_renderers_agree_on_any_triangles_that_the_near_plane_cuts(device, kind):
    rng = np.random.default_rng(9)
    cells = random_triangles(kind, rng, 30, triangles=8)
    cells[rng.random(cells.shape[:2]) < 0.1] = BEHIND
    faces = np.stack([rng.permutation(24)[:3] for _ in range(16)])
    rig = flat_rig(SIZES)
    masks = random_masks(rig.size)
    found = [Drawing(bare_mesh(faces), rig, lifted(cells, device), name).count(masks) for name in RENDERERS]
    np.testing.assert_array_equal(*found)
    assert np.mean(found[0][:, : len(ODD_SIZES), 0] > 0) > 0.6


# Where an edge meets a row


@wp.kernel
def _cross(
    top: wp.array[wp.vec2i],  # (edge,)
    bottom: wp.array[wp.vec2i],  # (edge,)
    row: wp.array2d[wp.int32],  # (edge, row)
    # out
    pixel: wp.array2d[wp.int32],  # (edge, row)
):
    i, j = wp.tid()
    pixel[i, j] = crossing(edge(top[i], bottom[i]), row[i, j])


def check_crossings(top, bottom, rows, device):
    """Compare the pixels at which edges (n, 2) meet rows (n, m), those that they do meet, with integer divisions."""
    ax, ay = 2 * top[:, :1] + 1, 2 * top[:, 1:] + 1  # in half cells
    dx, dy = (bottom - top)[:, :1], (bottom - top)[:, 1:]
    expected = -(-(ax * dy + (2 * SUBPIXEL * rows - ay) * dx) // (2 * SUBPIXEL * dy))
    pixel = poisoned(rows.shape, wp.int32, device)
    inputs = [wp.array(ends, dtype=wp.vec2i, device=device) for ends in (top, bottom)]
    inputs.append(wp.array(rows, dtype=wp.int32, device=device))
    wp.launch(_cross, dim=rows.shape, inputs=inputs, outputs=[pixel], device=device)
    met = (rows > top[:, 1:] >> 4) & (rows <= bottom[:, 1:] >> 4)
    np.testing.assert_array_equal(pixel.numpy()[met], expected[met])
    return met.sum()


@pytest.mark.parametrize("height", [1, 3, 512, 1009, 1022, 1023, 1024, 1025, 2047])
def test_edges_meet_rows_exactly(device, height):
    """Every width up to 1023 cells, to which float32 tells ties apart, and some beyond; from every cell of a pixel."""
    width = np.arange(-1030, 1031)
    for start in ((0, 0), (15, 15), (7, 3), (-9, 8)):
        top = np.tile(start, (len(width), 1))
        bottom = top + np.stack([width, np.full(len(width), height)], axis=1)
        check_crossings(top, bottom, np.tile(np.arange(130), (len(width), 1)), device)


@pytest.mark.parametrize("reach", [600, 1023, 1024, 1025, 20_000, LIMIT])
def test_edges_through_and_beside_pixel_centres_meet_rows_exactly(device, reach):
    """Of any length up to the longest: symmetrical about a pixel centre, a tie, and turned by a cell."""
    rng = np.random.default_rng(reach)
    centre = SUBPIXEL * rng.integers(-30, 60, (3000, 2))
    half = rng.integers(1, reach - 999, (3000, 2)) if reach == LIMIT else rng.integers(1, reach // 2 + 2, (3000, 2))
    half[:, 0] *= rng.choice([-1, 1], 3000)
    top, bottom = centre - half, centre + half - 1
    rows = centre[:, 1:] // SUBPIXEL + np.arange(-3, 4)
    for turned in np.array([[0, 0], [1, 0], [-1, 0]]):
        assert check_crossings(top + turned, bottom, rows, device) > 3000


# Against another rasteriser


def opencv_silhouette(image, faces, width, height):
    """Facing triangles filled by OpenCV, which also draws every pixel that an outline touches."""
    canvas = np.zeros((height, width), np.uint8)
    corners = 2 * image[faces] + 1  # in half cells
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    for triangle in corners[a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0]]:
        cv2.fillConvexPoly(canvas, triangle, 1, lineType=cv2.LINE_8, shift=5)
    return canvas


def test_silhouettes_are_opencvs_up_to_boundary_pixels(device):
    body, base = synthetic_body(), synthetic_subject().root_base
    rig = ring_rig(cameras=3, size=(320, 240))
    posed = posed_vertices(body, base, random_poses(8, reach=0.3), device)
    drawing = Drawing(body.tracking, rig, posed)
    drawing.count(random_masks(rig.size))
    pictures = pictures_of(draw_bits(body.tracking, rig, posed), rig.size)
    for views, silhouettes in zip(drawing.image(), pictures, strict=True):
        for view, ours in zip(views, silhouettes, strict=True):
            theirs = opencv_silhouette(view, body.tracking.face, 320, 240) > 0
            assert not np.any(ours & ~theirs)
            near = cv2.dilate(ours.astype(np.uint8), np.ones((3, 3))) > 0
            assert not np.any(theirs & ~near)
