"""Masks around a tracked body find the contour that the image has, not the body's own."""

from __future__ import annotations

import numpy as np
import pytest

from mmocap_warp.masks.subtraction import mask_around_body

PIXELS_PER_METRE = 60.0


def ellipse(x: float, y: float) -> np.ndarray:
    row, column = np.indices((160, 200))
    return np.hypot((column - x) / 18, (row - y) / 48) < 1


def picture(subject: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(2)
    image = rng.normal((60, 120, 90), 12, (160, 200, 3))
    image[subject] = rng.normal((150, 70, 60), 12, (int(subject.sum()), 3))
    return image.clip(0, 255).astype(np.uint8)


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return (a & b).sum() / (a | b).sum()


@pytest.mark.parametrize("off", [0, 1])
def test_the_contour_is_the_image_s(off: int) -> None:
    subject, body = ellipse(100, 80), ellipse(100 + off, 80 - off)
    found = mask_around_body(picture(subject), body, PIXELS_PER_METRE)
    assert iou(found, subject) > 0.97
    np.testing.assert_array_equal(mask_around_body(picture(subject), body, PIXELS_PER_METRE), found)


def test_what_is_far_from_the_body_is_not_the_subject() -> None:
    subject, bystander = ellipse(60, 80), ellipse(150, 80)
    found = mask_around_body(picture(subject | bystander), subject, PIXELS_PER_METRE)
    assert not (found & bystander).any()
    assert iou(found, subject) > 0.97


def test_a_body_out_of_sight_has_no_mask() -> None:
    nothing = np.zeros((160, 200), bool)
    assert not mask_around_body(picture(nothing), nothing, PIXELS_PER_METRE).any()


def test_a_body_that_fills_the_image_is_its_own_mask() -> None:
    whole = np.ones((160, 200), bool)
    assert mask_around_body(picture(whole), whole, PIXELS_PER_METRE).all()
