"""The floor, the way and the axis are drawn where the cameras see them."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import ring_rig

from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.display.still_pictures import floor_picture

RIG = ring_rig(3)


def drawn(rig: CameraRig, heads: np.ndarray) -> np.ndarray:
    images = [np.zeros((height, width, 3), np.uint8) for width, height in rig.size]
    return floor_picture(images, rig, heads, 1, "title")


def heads_over(rig: CameraRig) -> np.ndarray:
    """A short way, 1.7 m over the floor, of which one frame is not known."""
    level = np.eye(3)[np.abs(rig.up_vector) < 0.5]
    way = np.linspace(-0.4, 0.4, 4)[:, None] * level[0] + 1.7 * rig.up_vector
    way[2] = np.nan
    return way


def test_axis_and_grid_are_in_the_view():
    heads = heads_over(RIG)
    sheet = drawn(RIG, heads)
    _, height = RIG.size[0]
    x, y = project(RIG, heads[1:2] - 0.8 * RIG.up_vector)[0, 0] * 480 / height
    around = sheet[32 + round(y) - 3 : 32 + round(y) + 4, round(x) - 3 : round(x) + 4].reshape(-1, 3)
    assert around[:, 0].max() > 150  # blue, as the body's axis
    assert len(np.unique(sheet[40:].reshape(-1, 3), axis=0)) > 10


def test_views_stand_in_rows_of_equal_width():
    sheet = drawn(RIG, heads_over(RIG))
    assert sheet.shape[0] == 32 + 2 * 480  # a line, then two views and one


@pytest.mark.parametrize("known", [1, 4])
def test_who_is_far_behind_the_cameras_harms_nothing(known):
    heads = heads_over(RIG) - 50.0 * np.eye(3)[0]
    heads[known:] = np.nan
    assert drawn(RIG, heads).any()
