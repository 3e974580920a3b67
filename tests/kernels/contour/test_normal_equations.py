"""Normal equations are sums over the rows, in the same order however candidates are shared."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from contours import poisoned_outline, poisoned_residuals
from poisoned import poisoned

from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.contour.jacobian import Rows
from mmocap_warp.kernels.contour.normal_equations import Sums, sum_normal_equations, sum_tallies
from mmocap_warp.kernels.structs import filled

SIZE = 700
COUNTS = ((0, 1, 333), (700, 256, 20))  # (candidate, camera) contour edges


class Case:
    """Made-up rows; those without a weight are not a number."""

    def __init__(self, width: int, device: str):
        rng = np.random.default_rng(width)
        self.device, self.width = device, width
        self.value = rng.normal(0, 1, (2, 3, SIZE, width)).astype(np.float32)
        self.value[..., 3] *= 200.0
        self.value[:, :, ::5, 2] = 0.0
        self.weight = (rng.uniform(0, 1, (2, 3, SIZE)) * (rng.random((2, 3, SIZE)) < 0.6)).astype(np.float32)
        self.value[self.weight == 0] = np.nan
        self.tally = rng.uniform(0, 1, (2, 3, SIZE, 4)).astype(np.float32)
        for c, k in np.ndindex(2, 3):
            self.weight[c, k, COUNTS[c][k] :] = np.nan
            self.tally[c, k, COUNTS[c][k] :] = np.nan
        self.outline = poisoned_outline(2, 3, SIZE, (1, 1, 1), device)
        self.outline.count.assign(np.array(COUNTS, np.int32))
        self.residuals = poisoned_residuals(2, 3, SIZE, device)
        self.residuals.weighted.assign(np.stack([self.value[..., -1], self.weight], axis=-1))
        self.residuals.tally.assign(self.tally)
        value = wp.array(self.value.ravel(), dtype=wp.float32, device=device)
        self.rows = filled(Rows, value=value, width=width, own=0)

    def sums(self, parts: tuple[tuple[int, int], ...] = ((0, 2),)) -> tuple[np.ndarray, np.ndarray]:
        triangle = self.width * (self.width + 1) // 2
        sums = filled(
            Sums,
            triangle=poisoned(6 * triangle, wp.float32, self.device),
            tally=poisoned((2, 3), wp.vec4, self.device),
        )
        for first, end in parts:
            batch = batch_of(first, end, 2, self.device)
            sum_tallies(self.outline, self.residuals, batch, sums)
            sum_normal_equations(self.outline, self.residuals, self.rows, batch, sums)
        return sums.triangle.numpy().reshape(2, 3, triangle), sums.tally.numpy()


@pytest.mark.parametrize("width", [4, 32, 52, 113])
def test_sums_are_the_twins(device, width):
    case = Case(width, device)
    triangle, tally = case.sums()
    lower = np.tril_indices(width)
    for c, k in np.ndindex(2, 3):
        count = COUNTS[c][k]
        counts = np.flatnonzero(case.weight[c, k, :count] > 0)
        z, w = case.value[c, k, counts].astype(float), case.weight[c, k, counts].astype(float)
        expected = (z * w[:, None]).T @ z
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected))) + 1e-9
        assert (np.abs(triangle[c, k] - expected[lower]) <= 1e-5 * scale[lower]).all()
        np.testing.assert_allclose(tally[c, k], case.tally[c, k, :count].astype(float).sum(axis=0), rtol=1e-5)


def test_the_bits_are_the_same_however_candidates_are_shared(device):
    case = Case(52, device)
    whole, parts = case.sums(), case.sums(((1, 2), (0, 1)))
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one, other)
