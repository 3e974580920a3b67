"""What a camera's parameters do to its view, by the root's columns, is what they do to where points are seen."""

from __future__ import annotations

import numpy as np
import pytest
from contours import MATCHING, Contours, image_of
from synthetic import ring_rig, synthetic_body

from mmocap_warp.body.rotations import turn
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.calibration.adjust.camera_changes import (
    KINDS,
    OFFSET,
    RADIAL,
    AdjustConfig,
    Deviations,
    camera_jacobian,
    changed,
    difference,
)
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.kernels.contour.jacobian import OWN
from mmocap_warp.synthesis.exact_posing import ExactPoser

BODY = synthetic_body()
RIG = ring_rig(3)
SIGMA = Deviations().of(RIG)
STEP = 1e-5


def random_change(seed: int, rig=RIG) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 1, (len(rig), len(KINDS))) * SIGMA


def test_the_difference_of_changed_cameras_is_the_change():
    change = random_change(1)
    change[:, OFFSET] = 0.0
    np.testing.assert_allclose(difference(RIG, changed(RIG, change)), change, atol=1e-12)
    for mine, other in zip((RIG.K, RIG.R, RIG.t), (lambda r: (r.K, r.R, r.t))(changed(RIG, 0 * change)), strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-12)


def test_a_camera_that_turns_about_its_own_axis_stays_where_it_is():
    change = np.zeros((3, len(KINDS)))
    change[0, KINDS.index("pan")] = 0.1
    turned = changed(RIG, change)
    np.testing.assert_allclose(turned.centres, RIG.centres, atol=1e-12)
    ahead, right = RIG.R[0, 2], RIG.R[0, 0]
    np.testing.assert_allclose(turned.R[0, 2], np.cos(0.1) * ahead + np.sin(0.1) * right, atol=1e-12)


def test_a_moved_camera_moves_along_its_own_axes():
    change = np.zeros((3, len(KINDS)))
    change[1, KINDS.index("ahead")] = 0.3
    np.testing.assert_allclose(changed(RIG, change).centres[1], RIG.centres[1] + 0.3 * RIG.R[1, 2], atol=1e-12)


@pytest.mark.parametrize("far", [0.0, 1.0])
def test_columns_are_finite_differences_of_where_edges_are_seen(device, far):
    """From where cameras are, and from a change of one standard deviation each; the time moves the body."""
    rng = np.random.default_rng(3)
    pose = rng.uniform(-0.3, 0.3, (1, BODY.skeleton.coordinates))
    pose[:, :3] = [0.1, 0.9, -0.2]
    base = (turn("y", 0.7) @ turn("x", 0.2))[None]
    change = far * random_change(2)
    rig = changed(RIG, change)

    def vertices(at: np.ndarray) -> np.ndarray:
        return ExactPoser(BODY, base[0]).vertices(at)[0][BODY.tracking_vertex]

    masks = silhouettes(rig, vertices(pose + rng.normal(0, 0.01, pose.shape)), BODY.tracking_face)
    case = Contours(BODY, rig, pose, base, device, own=OWN, matching=MATCHING | {"reach": 0.5}).summed(masks)
    velocity = rng.normal(0, 1.0, (1, len(case.index)))
    posed = case.posed
    axes = np.repeat(posed.axes.numpy()[:, None, 0], len(rig), axis=1).astype(float)
    origin = np.repeat(posed.joints.transform.numpy()[:, None, 0, :3, 3], len(rig), axis=1).astype(float)
    root = int(np.searchsorted(case.index, 0)), int(np.searchsorted(case.index, ROOT_ANGLES.start))
    motion = camera_jacobian(RIG, change, axes, origin, velocity, root)
    for k in range(len(rig)):
        counts = case.outline.count.numpy()[0, k]
        used = np.flatnonzero(case.residuals.weighted.numpy()[0, k, :counts, 1] > 0)
        ends, normal = case.outline.ends.numpy()[0, k, used], case.residuals.normal.numpy()[0, k, used].astype(float)
        columns = case.rows_of(0, k)[used, :-2] @ motion[0, k]
        for kind in range(len(KINDS)):
            sides = []
            for step in (STEP, -STEP):
                there, moved = change.copy(), pose.copy()
                there[k, kind] += step
                moved[0, case.index] -= step * velocity[0] * (kind == OFFSET)
                points = vertices(moved)
                middle = (points[ends[:, 0]] + points[ends[:, 1]]) / 2
                now = changed(RIG, there)
                seen = image_of(now, k, middle) - now.K[k, :2, 2]
                seen *= 1.0 + there[k, RADIAL] * ((seen / now.K[k, [0, 1], [0, 1]]) ** 2).sum(axis=1, keepdims=True)
                sides.append(((seen + now.K[k, :2, 2]) * normal).sum(axis=1))
            expected = (sides[0] - sides[1]) / (2 * STEP)
            atol = 2e-3 * max(np.abs(expected).max(), 1.0)
            np.testing.assert_allclose(columns[:, kind], expected, atol=atol, err_msg=KINDS[kind])


def test_cameras_that_are_named_must_be_the_scenes() -> None:
    AdjustConfig(fixed="a", distance=("a", "b", 2.0)).check_names(("a", "b"))
    AdjustConfig().check_names(("a", "b"))
    for wrong in (AdjustConfig(fixed="c"), AdjustConfig(distance=("a", "c", 2.0))):
        with pytest.raises(ValueError, match="must name one of a, b, got c"):
            wrong.check_names(("a", "b"))
