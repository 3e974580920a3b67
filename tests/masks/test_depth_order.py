"""Who is in front of whom, by where the rays through people's masks meet."""

import numpy as np
import pytest
from synthetic import ring_rig

from mmocap_warp.cameras.rig import project
from mmocap_warp.masks.depth_order import in_front_of

HALF = 14  # pixels of a square mask


def squares(rig, point):
    """Per camera (height, width) bool, a square about a point (3,)."""
    masks = []
    for (column, row), (width, height) in zip(
        np.rint(project(rig, point[None])[:, 0]).astype(int), rig.size, strict=True
    ):
        mask = np.zeros((height, width), bool)
        mask[max(row - HALF, 0) : row + HALF, max(column - HALF, 0) : column + HALF] = True
        masks.append(mask)
    return masks


@pytest.fixture(scope="module")
def rig():
    return ring_rig(4, size=(320, 240))


@pytest.mark.parametrize("apart", [0.1, 0.4])
def test_who_is_surely_behind_hides_nothing(rig, apart):
    ahead = rig.R[0, 2] * [1, 0, 1]
    own, other = np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0]) + apart * ahead / np.linalg.norm(ahead)
    nothing = [np.zeros_like(mask) for mask in squares(rig, own)]
    theirs = squares(rig, other)
    depth = rig.R[:, 2] @ (other - own)
    assert depth[0] > 0
    hidden = in_front_of(rig, squares(rig, own), [list(each) for each in zip(nothing, theirs, strict=True)])
    assert [mask.any() for mask in hidden] == [bool(d < 0.15) for d in depth]
    assert (apart > 0.15) == (not hidden[0].any())


def test_things_and_people_of_unknown_place_may_be_in_front(rig):
    own, thing = squares(rig, np.array([0.0, 1.0, 0.0])), squares(rig, np.array([0.0, 0.6, 0.0]))
    seen_once = [squares(rig, np.array([0.0, 1.3, 3.0]))[0], *(np.zeros_like(mask) for mask in own[1:])]
    hidden = in_front_of(rig, own, [list(each) for each in zip(thing, seen_once, strict=True)])
    for mask, one, other in zip(hidden, thing, seen_once, strict=True):
        np.testing.assert_array_equal(mask, one | other)
