"""Contour edges are those between triangles that face the camera and others; outline is what no triangle covers."""

import numpy as np
import pytest
import warp as wp
from contours import Contours, contour_edges, depth_in_body, image_of, moving_skin, poisoned_outline
from drawn import flat_rig
from other_bodies import arm_robot, quadruped
from random_scenes import any_rig, random_poses
from synthetic import ring_rig, synthetic_body, synthetic_subject

from mmocap_warp.body.mesh_pieces import mesh_edges
from mmocap_warp.body.rotations import turn
from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.contour.outline import Edges, Outline, find_contours, is_outline, on_outline
from mmocap_warp.kernels.structs import filled
from mmocap_warp.masks.observation import make_views

PROBE = 0.75  # px outside an edge
RIM = 30.0  # px of an image, for a test
BODIES = {"person": synthetic_body(), "dog": quadruped(), "arm": arm_robot()}


@wp.kernel
def _ask(
    outline: Outline,
    height: int,
    middle: wp.array3d[wp.vec2],
    normal: wp.array3d[wp.vec2],
    answer: wp.array3d[wp.int32],
):
    c, k, s = wp.tid()
    if s < outline.count[c, k]:
        answer[c, k, s] = wp.where(is_outline(outline, c, k, height, middle[c, k, s], normal[c, k, s]), 1, 0)


@wp.kernel
def _ask_at_once(outline: Outline, size: wp.vec2i, rim: float, number: wp.array2d[wp.int32]):
    c, k = wp.tid()
    number[c, k] = on_outline(outline, c, k, size, rim)


def of_body(name: str, device: str, candidates: int = 3, **more) -> Contours:
    body = BODIES[name]
    rng = np.random.default_rng(4)
    pose = rng.uniform(-0.6, 0.6, (candidates, body.skeleton.coordinates))
    pose[:, :3] = rng.uniform(-0.3, 0.3, (candidates, 3)) + np.array([0.0, 0.9, 0.0])
    base = np.stack([turn("y", 1.1 * c) for c in range(candidates)])
    return Contours(body, ring_rig(3, size=(160, 120)), pose, base, device, **more).found()


def directed(case: Contours, c: int, k: int) -> list[tuple[int, int]]:
    return [tuple(ends) for ends in case.outline.ends.numpy()[c, k, : case.outline.count.numpy()[c, k]].tolist()]


@pytest.mark.parametrize("name", BODIES)
def test_contour_edges_are_the_twins_in_the_order_of_the_mesh(device, name):
    case = of_body(name, device)
    order = {frozenset(ends): i for i, ends in enumerate(case.edge[:, :2].tolist())}
    for c in range(len(case.pose)):
        for k in range(len(case.rig)):
            found = directed(case, c, k)
            image = image_of(case.rig, k, case.twin(c))
            sure, doubtful = contour_edges(case.edge, case.body.tracking.face, image)
            assert set(found) - doubtful == sure
            assert len(sure) > 20
            numbers = [order[frozenset(ends)] for ends in found]
            assert numbers == sorted(numbers)
            seen = case.outline.image.numpy()[c, k]
            np.testing.assert_allclose(seen[:, :2], image, atol=2e-3)


@pytest.mark.parametrize("name", BODIES)
def test_contours_are_closed(device, name):
    """As many contour edges end at a vertex as begin there, also where triangles are seen exactly from the side."""
    case = of_body(name, device)
    for c in range(len(case.pose)):
        for k in range(len(case.rig)):
            start, end = np.array(directed(case, c, k)).T
            vertices = len(case.body.tracking.rest)
            assert (np.bincount(start, minlength=vertices) == np.bincount(end, minlength=vertices)).all()


def test_contours_at_a_triangle_seen_from_its_side_are_closed(device):
    """Its area is a rounding off zero, and which way differs from one of its edges to the next."""
    rng = np.random.default_rng(0)
    candidates = 4000
    share = rng.uniform(0.1, 0.9, (candidates, 1))
    ends = rng.uniform(-0.5, 0.5, (2, candidates, 2))
    image = np.stack(
        [ends[0], ends[1], share * ends[0] + (1 - share) * ends[1], rng.uniform(-0.5, 0.5, (candidates, 2))], 1
    )
    depth = rng.uniform(2.0, 4.0, (candidates, 4, 1))
    posed = wp.array(np.concatenate([image * depth, depth], axis=2), dtype=wp.vec3, device=device)
    face = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)], np.int32)
    edge = mesh_edges(face)
    edges = filled(
        Edges, face=wp.array(face, dtype=wp.vec3i, device=device), edge=wp.array(edge, dtype=wp.vec4i, device=device)
    )
    rig = flat_rig([(640, 480)])
    rig.K[0] = ((640.3, 0.0, 320.7), (0.0, 641.9, 240.1), (0.0, 0.0, 1.0))
    outline = poisoned_outline(candidates, 1, 6, (4, 4, 6), device)
    moving = moving_skin(None, wp.zeros(candidates, dtype=wp.int32, device=device), candidates, 4, device)
    batch = batch_of(0, candidates, candidates, device)
    find_contours(edges, posed, moving, make_views(rig, device), batch, outline)
    for count, ends in zip(outline.count.numpy()[:, 0], outline.ends.numpy()[:, 0], strict=True):
        start, end = ends[:count].T
        assert (np.bincount(start, minlength=4) == np.bincount(end, minlength=4)).all()


@pytest.mark.parametrize("bands", [1.0, 9.0], ids=["not sorted", "sorted into bands"])
@pytest.mark.parametrize("name", BODIES)
def test_outline_is_what_no_triangle_covers(device, name, bands):
    """Also where the lines find no room in the bands."""
    case = of_body(name, device, bands=bands)
    if bands == 1.0:
        case = of_body(name, device, bands=bands, size=int(case.outline.count.numpy().max()))
    band = case.outline.band.numpy()
    ends_first = (np.diff(band, axis=2) < 0).all(axis=2)
    assert (np.diff(band, axis=2) >= 0).all(axis=2)[~ends_first].all()
    assert ends_first.any() == (bands == 1.0)
    shape = (*case.outline.count.shape, case.size)
    middle, outward = np.zeros((*shape, 2)), np.zeros((*shape, 2))
    image = case.outline.image.numpy()[..., :2].astype(float)
    for c, k in np.ndindex(*shape[:2]):
        for s, (start, end) in enumerate(directed(case, c, k)):
            a, b = image[c, k, start], image[c, k, end]
            middle[c, k, s] = (a + b) / 2
            outward[c, k, s] = np.array([a[1] - b[1], b[0] - a[0]]) / max(np.hypot(*(b - a)), 1e-9)
    answer = wp.full(shape, -1, dtype=wp.int32, device=device)
    inputs = [wp.array(values, dtype=wp.vec2, device=device) for values in (middle, outward)]
    wp.launch(_ask, dim=shape, inputs=[case.outline, 120, *inputs], outputs=[answer], device=device)
    number = wp.zeros(shape[:2], dtype=wp.int32, device=device)
    if device == "cpu":
        wp.launch(_ask_at_once, dim=shape[:2], inputs=[case.outline, wp.vec2i(160, 120), RIM], outputs=[number])
    for c, k in np.ndindex(*shape[:2]):
        count = case.outline.count.numpy()[c, k]
        probe = (middle + PROBE * outward)[c, k, :count]
        depth = depth_in_body(probe, case.body.tracking.face, image[c, k])
        clear = np.abs(depth) > 1e-2
        visible = answer.numpy()[c, k, :count] == 1
        assert (visible == (depth < 0))[clear].all()
        assert clear.mean() > 0.95
        assert 0.1 < visible.mean() < 1.0
        if device == "cpu":  # there all edges of a view are asked at once
            at = case.outline.found.numpy()[c, k, : number.numpy()[c, k]]
            assert (np.diff(at) > 0).all()
            inside = ((middle[c, k, :count] > RIM) & (middle[c, k, :count] < (159 - RIM, 119 - RIM))).all(axis=1)
            length = np.linalg.norm(outward[c, k, :count], axis=1)
            passed = np.isin(np.arange(count), at)
            assert (passed == (visible & inside & (length > 0.5)))[clear].all()


def test_a_view_with_a_vertex_behind_the_camera_has_no_contour(device):
    """Nor one with more contour edges than there is room for; others are as they were."""
    body = synthetic_body()
    poses = random_poses(8)
    rig = any_rig(3, inside=np.array([0.0, 0.9, 0.0]))
    base = np.tile(synthetic_subject().root_base, (8, 1, 1))
    case = Contours(body, rig, poses, base, device).found()
    behind = np.array(
        [[((case.twin(c) @ rig.R[k].T + rig.t[k])[:, 2] < 0.05).any() for k in range(len(rig))] for c in range(8)]
    )
    count = case.outline.count.numpy()
    assert (count[behind] == 0).all()
    assert (count[~behind] > 0).all()
    assert behind.any()
    assert not behind.all()
    room = int(np.median(count[~behind]))
    tight = Contours(body, rig, poses, base, device, size=room).found()
    np.testing.assert_array_equal(tight.outline.count.numpy(), np.where(count <= room, count, 0))
    for c, k in zip(*np.nonzero((count <= room) & ~behind), strict=True):
        assert directed(tight, c, k) == directed(case, c, k)
