"""The overlay of masks: every view, as large as a screen allows."""

from __future__ import annotations

import numpy as np
import pytest

from mmocap_warp.scene.mask_writing import _ADDED, _TAKEN, TINTS, draw_masks


@pytest.mark.parametrize(
    ("count", "size", "drawn"),
    [
        (1, (640, 480), (640, 480)),  # never larger than it is
        (4, (320, 240), (1280, 240)),  # in a row, where that fits
        (5, (640, 480), (1599, 800)),
        (7, (640, 480), (1600, 600)),
        (8, (1920, 1080), (1599, 900)),
        (4, (1088, 1920), (1600, 706)),
    ],
)
def test_views_fill_a_screen(count, size, drawn):
    masks = [np.zeros(size[::-1], bool) for _ in range(count)]
    picture = draw_masks([masks], [None] * count, ["cam"] * count)
    assert picture.shape[1::-1] == drawn


def test_every_view_is_in_its_cell_with_what_was_added_and_taken():
    masks = [np.zeros((480, 640), bool) for _ in range(7)]
    masks[0][:, :] = masks[5][:, :] = True
    before = [mask.copy() for mask in masks]
    before[5][:, 320:] = False
    before[6][:, 320:] = True
    gray = np.full((480, 640, 3), 100, np.uint8)
    picture = draw_masks([masks], [gray, *[None] * 6], [f"cam{k}" for k in range(7)], [before])
    tint = np.array(TINTS[0]) // 2
    assert picture.shape == (600, 1600, 3)
    assert (picture[150, 200] == 50 + tint).all()  # of the first view, over its image
    assert (picture[150, 600] == 40).all()
    assert (picture[450, 500] == 20 + tint).all()  # of the sixth, in the second row
    assert (picture[450, 700] == (20 + tint) // 2 + np.array(_ADDED) // 2).all()
    assert (picture[450, 1100] == 20 + np.array(_TAKEN) // 2).all()
    assert (picture[450, 1500] == 40).all()  # no view is there
    assert picture[10:25, 8:50].max() > 200  # a camera's name
    assert picture[310:325, 1210:1250].max() == 40
