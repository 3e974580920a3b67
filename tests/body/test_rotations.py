"""Rotations spread over all there are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mmocap_warp.body.rotations import spread_rotations


@pytest.mark.parametrize(("count", "widest"), [(20, 100), (240, 40)])
def test_any_rotation_is_near_one_of_those_that_are_spread(count: int, widest: float) -> None:
    spread = spread_rotations(count)
    np.testing.assert_allclose(spread @ np.swapaxes(spread, 1, 2), np.tile(np.eye(3), (count, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(spread), 1.0)
    anywhere = Rotation.random(2000, random_state=0).as_matrix()
    nearest = np.einsum("aij,bij->ab", anywhere, spread).max(axis=1)
    assert np.degrees(np.arccos((nearest - 1) / 2)).max() < widest
