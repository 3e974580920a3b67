"""Fisheye lenses against OpenCV, and the pinhole that their images are undistorted to."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from synthetic import ring_rig

from mmocap_warp.cameras.fisheye import FIELD
from mmocap_warp.cameras.rig import CameraRig, check_rig, describe_rig, project
from mmocap_warp.cameras.undistort import undistortion
from mmocap_warp.errors import InputError
from mmocap_warp.scene.kept_masks import calibration_hash

PIXEL = 1e-6  # [px], OpenCV inverts the lens by iteration
CENTROID = 0.15  # [px], of a disc 120 px wide, whose recorded pixels are up to 2.4 px wide in the pinhole
COVERAGE = 0.03  # of a disc's area, whose edge is rounded to pixels
LENS = np.array([0.04, -0.01, 0.004, -0.001, 0.0])


def fisheye_rig(focal: float = 300.0) -> CameraRig:
    """One camera of 640x480; with 300 px its image reaches 59 degrees to the sides and 74 in the corners."""
    rig = ring_rig(1)
    K = rig.K.copy()
    K[0, 0, 0], K[0, 1, 1] = focal, 0.99 * focal
    return replace(rig, K=K, distortion=LENS[None], fisheye=rig.names)


def seen_directions(rig: CameraRig, pixels: np.ndarray) -> np.ndarray:
    """(n, 2) on the image plane at focal length 1, by OpenCV."""
    return cv2.fisheye.undistortPoints(pixels[:, None], rig.K[0], rig.distortion[0, :4])[:, 0]


def all_pixels(rig: CameraRig) -> np.ndarray:
    columns, rows = (np.arange(length, dtype=float) for length in rig.size[0])
    return np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("focal", [180.0, 300.0, 900.0])
def test_the_pinhole_holds_all_that_was_seen_in_its_field(focal: float) -> None:
    rig = fisheye_rig(focal)
    K, size = rig.pinhole(0)
    plane = seen_directions(rig, all_pixels(rig))
    plane = plane[np.linalg.norm(plane, axis=1) < np.tan(FIELD)]
    pixels = plane * K[[0, 1], [0, 1]] + K[:2, 2]
    assert (pixels > -0.5 - PIXEL).all()
    assert (pixels < size - 0.5 + PIXEL).all()
    np.testing.assert_allclose([pixels.min(0), size - 1 - pixels.max(0)], 0, atol=8)  # and is not larger than it must
    np.testing.assert_array_equal(K[[0, 1], [0, 1]], rig.K[0, [0, 1], [0, 1]])
    assert (size < 1.7 * rig.size[0]).all()


def test_a_pinholes_own_stay_as_they_are() -> None:
    rig = ring_rig(2)
    K, size = rig.pinhole(1)
    np.testing.assert_array_equal(K, rig.K[1])
    np.testing.assert_array_equal(size, rig.size[1])
    assert rig.undistorted().fisheye == ()


def test_a_lens_as_weak_as_a_pinhole_gives_its_image() -> None:
    rig = replace(fisheye_rig(20000.0), distortion=np.zeros((1, 5)))
    K, size = rig.pinhole(0)
    np.testing.assert_allclose(K, rig.K[0], rtol=0, atol=1)
    np.testing.assert_allclose(size, rig.size[0], rtol=0, atol=2)


@pytest.mark.parametrize(("scale", "recorded_scale", "offset"), [(1.0, 1.0, (0.0, 0.0)), (0.5, 1.5, (10.0, 6.0))])
def test_masks_lie_where_the_pinhole_sees_them(scale: float, recorded_scale: float, offset: tuple) -> None:
    """A disc near the image's edge: what OpenCV says of each recorded pixel against the pinhole's own rays."""
    rig = fisheye_rig()
    width, height = (np.array(rig.size[0]) * recorded_scale).astype(int)
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    recorded = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    inside = in_disc(seen_directions(rig, (recorded - offset) / recorded_scale)).reshape(height, width)
    seen = undistortion(rig, 0, scale, recorded_scale, offset).mask(inside)
    pinhole = rig.undistorted(scale)
    columns, rows = np.meshgrid(*(np.arange(length, dtype=float) for length in pinhole.size[0]))
    plane = (np.stack([columns, rows], -1) - pinhole.K[0, :2, 2]) / pinhole.K[0, [0, 1], [0, 1]]
    expected = in_disc(plane)
    assert seen.shape == expected.shape
    assert seen.sum() == pytest.approx(expected.sum(), rel=COVERAGE)
    for axis in np.indices(expected.shape):
        assert axis[seen].mean() == pytest.approx(axis[expected].mean(), abs=CENTROID / scale)


def in_disc(plane: np.ndarray) -> np.ndarray:
    return np.linalg.norm(plane - [1.1, -0.4], axis=-1) < 0.2


def test_what_lies_outside_the_field_is_black() -> None:
    rig = fisheye_rig(180.0)
    image = undistortion(rig, 0, 1.0).image(np.full((480, 640), 255, np.uint8))
    K, _ = rig.pinhole(0)
    row, column = np.indices(image.shape)
    radius = np.hypot((column - K[0, 2]) / K[0, 0], (row - K[1, 2]) / K[1, 1])
    assert not image[radius > np.tan(FIELD)].any()
    assert (image[radius < np.tan(FIELD) - 0.05] == 255).mean() > 0.9


def test_summary_of_a_fisheye_is_its_pinholes() -> None:
    across, _ = describe_rig(fisheye_rig())[0].field_of_view
    assert 100 < across <= 120.1


def test_points_project_onto_the_fisheye() -> None:
    rig = fisheye_rig()
    points = np.random.default_rng(0).uniform([-2, 0, -2], [2, 1.8, 2], (50, 3))
    turn, t = cv2.Rodrigues(rig.R[0])[0], rig.t[0][:, None]
    expected, _ = cv2.fisheye.projectPoints(points[:, None], turn, t, rig.K[0], rig.distortion[0, :4])
    np.testing.assert_allclose(project(rig, points)[0], expected[:, 0], rtol=0, atol=PIXEL)


def test_masks_of_a_fisheye_are_no_masks_of_another_lens() -> None:
    rig = fisheye_rig()
    one, other = (calibration_hash(each, 0, 1.0, (0.0, 0.0), False) for each in (rig, replace(rig, fisheye=())))
    assert one != other


@pytest.mark.parametrize(
    ("lens", "focal", "problem"),
    [
        ([-0.9, 0, 0, 0, 0], 300.0, "the fisheye distortion folds the image over itself"),
        ([1e8, 0, 0, 0, 0], 300.0, r"undistorted, this fisheye's image has \dx\d pixels"),
        ([-0.9, 0.4, 0.35, 0, 0], 2000.0, None),
    ],
)
def test_lenses_that_are_none_are_refused(lens: list[float], focal: float, problem: str | None) -> None:
    rig = replace(fisheye_rig(focal), distortion=np.array([lens]))
    if problem is None:
        assert check_rig(rig, "c.toml") is rig  # it folds far outside the image
        return
    with pytest.raises(InputError, match=problem):
        check_rig(rig, "c.toml")


def test_the_pinhole_ends_where_the_image_does_though_the_polynomial_folds_beyond() -> None:
    """The lens reaches 45 degrees in the corners, is widest at 49, and comes back to less at 60."""
    rig = replace(fisheye_rig(548.0), distortion=np.array([[-0.01, 0.1, -0.5, 0.1, 0.0]]))
    assert check_rig(rig, "c.toml") is rig
    pinhole = rig.undistorted()
    corner = np.hypot(*(np.maximum(pinhole.K[0, :2, 2], pinhole.size[0] - pinhole.K[0, :2, 2]) / 548.0))
    assert np.degrees(np.arctan(corner)) < 50
