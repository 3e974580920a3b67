"""Mask cells beside a body, and places that other masks agree on, against NumPy."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from synthetic import ring_rig, synthetic_subject

from mmocap_warp.kernels.silhouettes.beside import find_cells, follow_rays
from mmocap_warp.masks.observation import Observation
from mmocap_warp.tracking.uncovered import UncoveredArea

RIG = ring_rig(cameras=5, size=(150, 110))
SUBJECT = synthetic_subject()


@pytest.fixture(scope="module")
def masks() -> list[np.ndarray]:
    """Coarse blobs that agree here and there."""
    rng = np.random.default_rng(7)
    return [cv2.resize(rng.random((7, 9)), (150, 110)) > 0.62 for _ in range(5)]


@pytest.fixture
def looked(masks: list[np.ndarray], device: str) -> tuple[Any, Any]:
    """What has looked at the masks: views and a look whose outputs are spoilt."""
    area = UncoveredArea(SUBJECT, RIG, device)
    area.of(SUBJECT.pose[None], Observation.from_masks(masks))
    area._look.count.zero_()
    for name in ("mark", "in_row", "place", "nearest", "apart"):
        getattr(area._look, name).fill_(77)
    area._look.scale.fill_(1e4)
    return area._sight, area._look


def test_cells_are_those_of_a_mask_without_skin_in_a_disc_around_them(masks, looked) -> None:
    sight, look = looked
    rng = np.random.default_rng(3)
    skin = np.full((5, look.point.shape[0], 2), 1e9)
    skin[:, :60] = rng.uniform(-30, 200, (5, 60, 2))
    skin[1, :5], skin[2] = np.nan, 1e9
    step, radius = np.array([1, 2, 3, 4, 0]), np.array([3, 6, 5, 1, 5])
    for array, values in ((look.pixel, skin), (look.step, step), (look.radius, radius)):
        array.assign(values)
    find_cells(sight, look)
    count, mark = look.count.numpy(), look.mark.numpy()
    for k in range(4):
        mask, points = masks[k][:: step[k], :: step[k]], np.rint(skin[k] / step[k])
        column, row = points[((points >= 0) & (points < mask.shape[::-1])).all(axis=1)].astype(int).T
        covered = np.zeros(mask.shape, np.uint8)
        covered[row, column] = 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius[k] + 1, 2 * radius[k] + 1))
        expected = mask & (cv2.dilate(covered, disc) == 0)
        np.testing.assert_array_equal(mark[k, : mask.size].reshape(mask.shape) == -1, expected)
        np.testing.assert_array_equal(look.in_row.numpy()[k, : len(mask)], expected.sum(axis=1))
        assert count[k] == expected.sum()
    assert count[4] == 0


def test_places_are_in_the_middle_of_what_other_masks_leave_open(masks, looked) -> None:
    sight, look = looked
    rng = np.random.default_rng(5)
    cells = np.sort(rng.permutation(110 * 150)[:90])  # every second one is asked
    pixels, skin = np.stack([cells % 150, cells // 150], axis=1)[::2], rng.normal(0.0, 1.0, (look.point.shape[0], 3))
    mark, in_row = np.zeros(look.mark.shape, np.int16), np.zeros(look.in_row.shape, np.int32)
    mark[2, cells] = -1
    in_row[2, :110] = np.bincount(cells // 150, minlength=110)
    size, depth = SUBJECT.body.relative_size, 3.0
    look.step.fill_(1)
    look.scale.assign(np.array([100.0, 100.0, 100.0, 1.0, 100.0]))  # the fourth view shows more than limbs
    look.depth.fill_(depth)
    for array, values in ((look.mark, mark), (look.in_row, in_row), (look.point, skin)):
        array.assign(values)
    look.count.assign(np.array([0, 0, 90, 1, 0]))
    follow_rays(sight, look, 3)
    depths = np.arange(depth - 1.2 * size, depth + 1.2 * size, 0.03 * size)
    rays = np.column_stack([pixels, np.ones(45)]) @ np.linalg.inv(RIG.K[2]).T
    points = ((rays[:, None] * depths[:, None]).reshape(-1, 3) - RIG.t[2]) @ RIG.R[2]
    against = np.zeros(len(points), int)
    for k in (0, 1, 4):
        seen = (points @ RIG.R[k].T + RIG.t[k]) @ RIG.K[k].T
        column, row = np.rint(seen[:, :2] / seen[:, 2:]).astype(int).T
        within = (seen[:, 2] > 0) & (column >= 0) & (row >= 0) & (column < 150) & (row < 110)
        against[within] += ~masks[k][row[within], column[within]]
    nearest = look.nearest.numpy()[2, :45]
    hits = (against <= 1).reshape(45, -1)
    np.testing.assert_array_equal(nearest >= 0, hits.any(axis=1))
    assert 5 < hits.any(axis=1).sum() < 45
    for i in np.flatnonzero(hits.any(axis=1)):
        place = points.reshape(45, -1, 3)[i, np.flatnonzero(hits[i])[(hits[i].sum() + 1) // 2 - 1]]
        np.testing.assert_allclose(look.place.numpy()[2, i], place, atol=1e-12)
        distance = np.linalg.norm(place - skin[::4], axis=1)
        assert nearest[i] == distance.argmin()
        np.testing.assert_allclose(look.apart.numpy()[2, i], distance.min() ** 2)
    assert (look.nearest.numpy()[2, 45:] == -1).all()
    look.step.assign(np.array([0, 1, 1, 0, 0]))  # two views must agree
    follow_rays(sight, look, 3)
    assert (look.nearest.numpy()[2] == -1).all()
