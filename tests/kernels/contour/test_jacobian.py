"""Rows of the Jacobian are finite differences of where an edge's middle is along its normal, in float64."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from contours import MATCHING, Contours, image_of
from other_bodies import arm_robot, burdened, lift, quadruped
from synthetic import ring_rig, synthetic_body

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.rotations import turn
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.kernels.contour.jacobian import LENS, OWN
from mmocap_warp.synthesis.exact_posing import ExactPoser

BODIES = {"person": synthetic_body(), "dog": quadruped(), "arm": arm_robot(), "burdened": burdened(), "lift": lift()}
STEP = 1e-5
NEAR = 1e-3  # of the largest in a column: float32 of points some hundred pixels apart


def posed(body: BodyModel, base: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(tracking vertex, 3) float64 [m]."""
    return ExactPoser(body, base).vertices(pose[None])[0][body.tracking_vertex]


def case_of(body: BodyModel, device: str, change=None, own: int = 0) -> Contours:
    """Two candidates, and masks of a pose beside theirs."""
    rng = np.random.default_rng(2)
    pose = rng.uniform(-0.5, 0.5, (3, body.skeleton.coordinates))
    pose[:, :3] = rng.uniform(-0.1, 0.1, (3, 3)) + np.array([0.0, 0.7, 0.0])
    base = np.stack([turn("y", 1.1 * c) @ turn("x", 0.3) for c in range(2)])
    rig = ring_rig(2)
    seen = pose[0] + rng.normal(0, 0.02, pose.shape[1])
    masks = silhouettes(rig, posed(body, base[0], seen), body.tracking_face)
    matching = MATCHING | {"reach": 0.5}
    return Contours(body, rig, pose[:2], base, device, change=change, own=own, matching=matching).summed(masks)


def matched(case: Contours, c: int, k: int):
    """Numbers of the rows that count, their edges' ends, and normals."""
    count = case.outline.count.numpy()[c, k]
    counts = np.flatnonzero(case.residuals.weighted.numpy()[c, k, :count, 1] > 0)
    return counts, case.outline.ends.numpy()[c, k, counts], case.residuals.normal.numpy()[c, k, counts].astype(float)


def along_normals(case: Contours, k: int, points: np.ndarray, ends: np.ndarray, normal: np.ndarray) -> np.ndarray:
    middle = (points[ends[:, 0]] + points[ends[:, 1]]) / 2
    return (image_of(case.rig, k, middle) * normal).sum(axis=1)


@pytest.mark.parametrize("name", BODIES)
def test_every_searched_coordinate(device, name):
    body = BODIES[name]
    case = case_of(body, device)
    moved = set()
    for c, k in np.ndindex(2, 2):
        counts, ends, normal = matched(case, c, k)
        assert len(counts) > 15
        rows = case.rows_of(c, k)[counts]
        for column, coordinate in enumerate(case.index):
            sides = []
            for sign in (1, -1):
                pose = case.pose[c].copy()
                pose[coordinate] += sign * STEP
                sides.append(along_normals(case, k, posed(body, case.base[c], pose), ends, normal))
            expected = (sides[0] - sides[1]) / (2 * STEP)
            np.testing.assert_allclose(rows[:, column], expected, atol=NEAR * max(np.abs(expected).max(), 1.0))
            if np.abs(expected).max() > 1.0:
                moved.add(column)
        residual = case.residuals.weighted.numpy()[c, k, counts, 0]
        np.testing.assert_array_equal(rows[:, -1], residual)
    assert moved == set(range(len(case.index)))


@pytest.mark.parametrize("name", BODIES)
def test_every_parameter_of_the_rest_body(device, name):
    """Sliders, bones, girths and scale; posing is linear in the rest body, so that a step may be large."""
    body = BODIES[name]
    space = RestSpace(body)
    vertex, joint = space.basis(np.zeros(len(space.names)))
    case = case_of(body, device, change=(vertex[:, body.tracking_vertex], joint))
    searched = len(case.index)
    assert case.width == searched + len(space.names) + 1
    h = 1e-4
    for c, k in np.ndindex(2, 2):
        counts, ends, normal = matched(case, c, k)
        rows = case.rows_of(c, k)[counts]
        for p in range(len(space.names)):
            sides = []
            for sign in (h, -h):
                rest = body.skin.rest.astype(float) + sign * vertex[p]
                other = replace(
                    body,
                    skin=replace(body.skin, rest=rest),
                    joint_rest=body.joint_rest.astype(float) + sign * joint[p],
                )
                sides.append(along_normals(case, k, posed(other, case.base[c], case.pose[c]), ends, normal))
            expected = (sides[0] - sides[1]) / (2 * h)
            scale = max(np.abs(expected).max(), 1.0)
            np.testing.assert_allclose(rows[:, searched + p], expected, atol=NEAR * scale, err_msg=space.names[p])


def test_rows_of_edges_that_do_not_count_are_left_alone(device):
    case = case_of(BODIES["person"], device)
    for c, k in np.ndindex(2, 2):
        counts, _ends, _normal = matched(case, c, k)
        others = np.delete(case.rows_of(c, k), counts, axis=0)
        assert len(others)
        assert np.isnan(others).all()


def lens_image(rig: CameraRig, k: int, points: np.ndarray, column: int, step: float) -> np.ndarray:
    """(n, 2) [px] of points in a camera of which one parameter of the lens is changed by a step."""
    K = rig.K.copy()
    if column == 0:  # the logarithm of both focal lengths
        K[k, [0, 1], [0, 1]] *= np.exp(step)
    elif column < 3:  # the principal point
        K[k, column - 1, 2] += step
    image = image_of(replace(rig, K=K), k, points)
    if column < 3:
        return image
    # The first radial coefficient scales the offset from the principal point by 1 + k1 r^2.
    offset = image - K[k, :2, 2]
    r2 = ((offset / (K[k, 0, 0], K[k, 1, 1])) ** 2).sum(axis=1, keepdims=True)
    return K[k, :2, 2] + offset * (1 + step * r2)


@pytest.mark.parametrize("name", BODIES)
def test_the_lens_of_each_camera(device, name):
    """Focal length, principal point, radial distortion and larger masks; other columns keep their bits."""
    body = BODIES[name]
    case, without = case_of(body, device, own=OWN), case_of(body, device)
    searched = len(case.index)
    assert case.width == without.width + OWN
    h = 1e-6
    for c, k in np.ndindex(2, 2):
        counts, ends, normal = matched(case, c, k)
        rows = case.rows_of(c, k)[counts]
        points = posed(body, case.base[c], case.pose[c])
        middle = (points[ends[:, 0]] + points[ends[:, 1]]) / 2
        for column in range(LENS):
            sides = []
            for step in (h, -h):
                sides.append((lens_image(case.rig, k, middle, column, step) * normal).sum(axis=1))
            expected = (sides[0] - sides[1]) / (2 * h)
            scale = max(np.abs(expected).max(), 1.0)
            np.testing.assert_allclose(rows[:, searched + column], expected, atol=NEAR * scale)
        np.testing.assert_array_equal(rows[:, searched + LENS], 1.0)
        others = np.delete(rows, slice(searched, searched + OWN), axis=1)
        np.testing.assert_array_equal(others, without.rows_of(c, k)[counts])
