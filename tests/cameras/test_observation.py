"""Packing masks into words."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mmocap_warp.masks.observation import Observation, pack_masks, unpack_masks, words_per_row


@pytest.mark.parametrize(("width", "words"), [(1, 1), (31, 1), (32, 1), (33, 2), (640, 20)])
def test_words_hold_a_row(width: int, words: int) -> None:
    assert words_per_row(width) == words


def test_pixel_x_is_bit_x() -> None:
    mask = np.zeros((2, 40), bool)
    mask[0, 0] = mask[1, 31] = mask[1, 33] = True
    words = pack_masks([mask])
    assert words.dtype == np.uint32
    np.testing.assert_array_equal(words, [[[1, 0], [1 << 31, 2]]])


def test_masks_of_different_sizes_unpack_unchanged() -> None:
    rng = np.random.default_rng(0)
    masks = [rng.random(shape) < 0.5 for shape in ((5, 70), (9, 32), (1, 3))]
    words = pack_masks(masks)
    assert words.shape == (3, 9, 3)
    assert np.bitwise_count(words).sum() == sum(mask.sum() for mask in masks)  # padding is background
    sizes = np.array([mask.shape[::-1] for mask in masks])
    for mask, again in zip(masks, unpack_masks(words, sizes), strict=True):
        np.testing.assert_array_equal(again, mask)


def test_observation_counts_foreground() -> None:
    observation = Observation.from_masks([np.eye(4, dtype=bool), np.zeros((2, 6), bool)])
    np.testing.assert_array_equal(observation.foreground, [4, 0])


def test_what_is_near_hides_as_a_dilation_says() -> None:
    rng, hides, square = np.random.default_rng(0), [], np.ones((17, 17), np.uint8)
    for _ in range(100):
        mask, other = np.zeros((2, 61, 83), bool)
        for drawn in (mask, other):
            top, left, height, width = rng.integers([0, 0, 1, 1], [30, 40, 7, 9])
            drawn[top : top + height, left : left + width] = True
        near = (cv2.dilate(mask.view(np.uint8), square).view(bool) & other).any()
        hidden = Observation.from_masks([mask], None, [other]).unpacked_hidden(np.array([[83, 61]]))
        hides.append(hidden is not None)
        assert hides[-1] == near
        if hidden is not None:
            np.testing.assert_array_equal(hidden[0], other & ~mask)
    assert 10 < sum(hides) < 90
