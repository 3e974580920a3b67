"""Masks are made where there may be foreground; they are those that the whole image would give, bit for bit."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.undistort import undistortion
from mmocap_warp.masks.cleanup import clean_mask, dilated, keep_subject
from mmocap_warp.masks.mask_settings import ForegroundSettings
from mmocap_warp.masks.subtraction import GaussianBackground

HEIGHT, WIDTH = 90, 120


def blobs(rng: np.random.Generator, most: int = 4) -> np.ndarray:
    """(HEIGHT, WIDTH) bool: discs and rings anywhere, also over the border, with specks."""
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    for _ in range(rng.integers(0, most + 1)):
        centre = tuple(rng.integers(0, (WIDTH, HEIGHT)).tolist())
        cv2.circle(image, centre, int(rng.integers(1, 30)), 1, -1 if rng.random() < 0.5 else 2)
    return image.astype(bool) ^ (rng.random(image.shape) > 0.998)


def cleaned_whole(mask: np.ndarray, settings: ForegroundSettings) -> np.ndarray:
    """The steps of :func:`clean_mask` by OpenCV on the whole image."""

    def large(image: np.ndarray, area: float, connectivity: int) -> np.ndarray:
        _, label, statistics, _ = cv2.connectedComponentsWithStats(image, connectivity=connectivity)
        return ((statistics[:, cv2.CC_STAT_AREA] >= area)[label] & (image > 0)).astype(np.uint8)

    image = cv2.medianBlur(mask.astype(np.uint8), 5)
    for step, size in ((cv2.MORPH_OPEN, 5), (cv2.MORPH_CLOSE, 9)):
        image = cv2.morphologyEx(image, step, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
    image |= 1 - image - large(1 - image, settings.fill_holes, 4)
    return large(image, settings.min_area, 8).astype(bool)


@pytest.mark.parametrize("fill_holes", [40.0, 900.0, 1e6])
def test_cleaning_looks_around_the_foreground_alone(fill_holes: float) -> None:
    settings = ForegroundSettings(median=5, open=5, close=9, fill_holes=fill_holes, min_area=60, keep="all")
    rng = np.random.default_rng(1)
    for mask in (blobs(rng) for _ in range(150)):
        np.testing.assert_array_equal(clean_mask(mask, settings), cleaned_whole(mask, settings))


@pytest.mark.parametrize("diameter", [3, 7, 21, 65, 151])
def test_discs_are_those_of_opencv(diameter: int) -> None:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (diameter, diameter))
    mask = blobs(np.random.default_rng(diameter), 2).astype(np.uint8)
    np.testing.assert_array_equal(dilated(mask, diameter), cv2.dilate(mask, disc))
    np.testing.assert_array_equal(1 - dilated(1 - mask, diameter), cv2.erode(mask, disc))


def test_the_body_is_not_asked_for_where_a_mask_is_in_one_piece() -> None:
    def never() -> np.ndarray:
        raise AssertionError

    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[20:40, 30:50] = True
    np.testing.assert_array_equal(keep_subject(mask, 6.0, never), mask)
    mask[60, 90] = True
    with pytest.raises(AssertionError):
        keep_subject(mask, 6.0, never)


@pytest.mark.parametrize(("scale", "recorded"), [(1.0, 1.0), (0.5, 1.0), (0.7, 0.99), (0.3, 1.4)])
def test_resampling_looks_around_the_foreground_alone(scale: float, recorded: float) -> None:
    K = np.array([[[WIDTH, 0, WIDTH / 2], [0, WIDTH, HEIGHT / 2], [0, 0, 1.0]]])
    distortion = np.array([[0.2, -0.1, 0.01, -0.01, 0.0]])
    rig = CameraRig(("a",), K, np.eye(3)[None], np.zeros((1, 3)), np.array([[WIDTH, HEIGHT]]), distortion, "+y")
    resample, rng = undistortion(rig, 0, scale, recorded, (3.0, -2.0)), np.random.default_rng(2)
    for mask in (blobs(rng, 2) for _ in range(30)):
        whole = resample.image(mask.astype(np.uint8) * 255) > 127
        np.testing.assert_array_equal(resample.mask(mask), whole)


@pytest.mark.parametrize(("threshold", "noise"), [(7.0, 4.0), (0.5, 1.0), (15.0, 6.0)])
def test_pixels_like_the_background_are_not_judged(threshold: float, noise: float) -> None:
    """Nor would they be foreground, in light that makes the plate brighter than an image can be, either."""
    settings = ForegroundSettings(source="clean_plate", threshold=threshold, noise=noise)
    rng = np.random.default_rng(3)
    for _ in range(20):
        plates = rng.integers(0, 256, (rng.integers(1, 4), 40, 50, 3), dtype=np.uint8)
        image = plates[0] * rng.uniform(0.5, 2.5, 3) + rng.normal(0.0, rng.uniform(0.0, 12.0), plates[0].shape)
        image = np.clip(image, 0, 255).astype(np.uint8)
        background = GaussianBackground(plates, settings)
        gain = np.median((image.astype(np.float32) + 1) / (background._mean + 1), axis=(0, 1))
        everywhere = background._far(image, background._mean * gain, background._deviation)
        np.testing.assert_array_equal(background.foreground(image), everywhere)
