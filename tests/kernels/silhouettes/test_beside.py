"""Mask cells beside a body, and places that other masks agree on, against NumPy."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from synthetic import ring_rig, synthetic_subject

from mmocap_warp.masks.observation import Observation
from mmocap_warp.tracking.uncovered import UncoveredArea

RIG = ring_rig(cameras=5, size=(150, 110))


@pytest.fixture(scope="module")
def masks() -> list[np.ndarray]:
    """Coarse blobs that agree here and there."""
    rng = np.random.default_rng(7)
    return [cv2.resize(rng.random((7, 9)), (150, 110)) > 0.62 for _ in range(5)]


@pytest.fixture(scope="module")
def looked(masks: list[np.ndarray]) -> UncoveredArea:
    """One that has looked at the masks, and whose outputs are spoilt."""
    area = UncoveredArea(synthetic_subject(), RIG)
    area.of(synthetic_subject().pose[None], Observation.from_masks(masks))
    area._cells[1].fill_(-9)
    for values in area._agreed:
        values.fill_(-9)
    return area


def test_cells_are_those_of_a_mask_without_skin_in_a_disc_around_them(masks, looked) -> None:
    rng = np.random.default_rng(3)
    skin = rng.uniform(-30, 200, (5, 60, 2))
    skin[1, :5], skin[2] = np.nan, 1e9
    step, deep = np.array([1, 2, 3, 4, 0]), np.array([3.0, 9.0, 6.0, 2.0, 5.0])
    found = looked._beside(skin, step, deep)
    assert not len(found[4])
    for k in range(4):
        mask, points = masks[k][:: step[k], :: step[k]], np.rint(skin[k] / step[k])
        column, row = points[((points >= 0) & (points < mask.shape[::-1])).all(axis=1)].astype(int).T
        covered, radius = np.zeros(mask.shape, np.uint8), max(1, round(deep[k] / step[k]))
        covered[row, column] = 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        expected = np.argwhere(mask & (cv2.dilate(covered, disc) == 0))[:, ::-1]
        np.testing.assert_array_equal(found[k], expected[: len(found[k])])
        assert len(found[k]) == min(len(expected), 1201)
    assert not looked._cells[0].numpy().any()  # ready for the next body


def test_places_are_in_the_middle_of_what_other_masks_leave_open(masks, looked) -> None:
    rng = np.random.default_rng(5)
    pixels, skin = rng.integers(0, 100, (40, 2)), rng.normal(0.0, 1.0, (30, 3))
    others, depth = np.array([0, 1, 3, 4]), 3.0
    place, nearest, apart = looked._agreed_on(2, pixels, depth, others, skin)
    size = synthetic_subject().body.relative_size
    depths = np.arange(depth - 1.2 * size, depth + 1.2 * size, 0.03 * size)
    rays = np.column_stack([pixels, np.ones(40)]) @ np.linalg.inv(RIG.K[2]).T
    points = ((rays[:, None] * depths[:, None]).reshape(-1, 3) - RIG.t[2]) @ RIG.R[2]
    against = np.zeros(len(points), int)
    for k in others:
        seen = (points @ RIG.R[k].T + RIG.t[k]) @ RIG.K[k].T
        column, row = np.rint(seen[:, :2] / seen[:, 2:]).astype(int).T
        within = (seen[:, 2] > 0) & (column >= 0) & (row >= 0) & (column < 150) & (row < 110)
        against[within] += ~masks[k][row[within], column[within]]
    expected = []
    for ray, hit in zip(points.reshape(40, -1, 3), (against <= 1).reshape(40, -1), strict=True):
        if hit.any():
            expected.append(ray[np.flatnonzero(hit)[(hit.sum() + 1) // 2 - 1]])
    np.testing.assert_allclose(place, expected, atol=1e-12)
    assert 5 < len(place) < 40
    distance = np.linalg.norm(place[:, None] - skin, axis=2)
    np.testing.assert_array_equal(nearest, distance.argmin(axis=1))
    np.testing.assert_allclose(apart, distance.min(axis=1) ** 2)
    assert not len(looked._agreed_on(2, pixels, depth, others[:1], skin)[0])  # two views must agree
