"""A part of a result, and the same at another rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic import SKELETON, synthetic_result

from mmocap_warp.body.rotations import between, near_zyx_angles, turn, zyx_rotation
from mmocap_warp.result.excerpt import at_rate, before_smoothing, evenly, of_run


def test_angles_of_a_rotation_near_to_others():
    rng = np.random.default_rng(3)
    angles = rng.uniform(-9, 9, (500, 3))
    angles[:100, 1] = np.pi / 2 * rng.choice([-3, -1, 1, 3], 100)  # where two of the angles are one
    angles[100:200, 1] = np.pi / 2 + rng.uniform(-1e-7, 1e-7, 100)
    found = near_zyx_angles(zyx_rotation(angles), angles + rng.uniform(-0.1, 0.1, angles.shape))
    np.testing.assert_allclose(zyx_rotation(found), zyx_rotation(angles), rtol=0, atol=1e-7)
    np.testing.assert_allclose(found[200:], angles[200:], rtol=0, atol=1e-6)


def test_between_two_rotations_is_the_shortest_way():
    first, second = turn("y", 3.0), turn("y", -3.0)
    share = np.array([0.0, 0.25, 1.0])
    way = 2 * np.pi - 6.0
    found = between(np.tile(first, (3, 1, 1)), np.tile(second, (3, 1, 1)), share)
    np.testing.assert_allclose(found, turn("y", 3.0 + way * share), rtol=0, atol=1e-12)


@pytest.mark.parametrize("fps", [24.0, 59.94, 60.0, 240.0])
def test_a_steady_turn_stays_steady_at_any_rate(fps):
    """A root that turns 10 degrees a frame about y and a shoulder about x, across the seam of the angles."""
    result = synthetic_result(frames=40, runs=1)
    second = result.frame_numbers / result.fps
    pose = np.tile(result.pose[:, :1], (1, 40, 1))
    pose[0, :, 4] = (10.0 * second + np.pi) % (2 * np.pi) - np.pi
    pose[0, :, SKELETON.angles("LShoulder")] = second[:, None] * [4.0, 0, 0]
    pose[0, :, 0] = 2.0 * second
    resampled = at_rate(replace(result, pose=pose, raw_pose=pose), fps)
    now = resampled.frame_numbers / fps
    assert (resampled.fps, resampled.rate) == (fps, fps)
    assert now[0] - second[0] < 1 / fps
    assert second[-1] - now[-1] < 1 / fps
    assert (now >= second[0] - 1e-7).all()
    assert (now <= second[-1] + 1e-7).all()
    np.testing.assert_allclose(resampled.pose[0, :, 0], 2.0 * now, rtol=0, atol=1e-7)
    root = zyx_rotation(resampled.pose[0, :, 3:6])
    np.testing.assert_allclose(root, turn("y", 10.0 * now), rtol=0, atol=1e-6)
    shoulder = zyx_rotation(resampled.pose[0, :, SKELETON.angles("LShoulder")])
    np.testing.assert_allclose(shoulder, turn("x", 4.0 * now), rtol=0, atol=1e-6)
    np.testing.assert_array_equal(resampled.raw_pose, resampled.pose)
    assert resampled.cost.shape == (1, len(now))


def test_the_same_rate_gives_the_same_motion():
    result = synthetic_result()
    same = at_rate(result, result.fps)
    np.testing.assert_array_equal(same.frame_numbers, result.frame_numbers)
    np.testing.assert_allclose(same.joints(), result.joints(), rtol=0, atol=1e-6)
    np.testing.assert_array_equal(same.status, result.status)
    np.testing.assert_array_equal(same.iou, result.iou)


@pytest.mark.parametrize("fps", [0.0, -1.0, np.inf, np.nan, 6001.0])
def test_a_rate_that_is_none(fps):
    with pytest.raises(ValueError, match="fps must be positive and at most 6000, got"):
        at_rate(replace(synthetic_result(), fps=60.0), fps)


def test_some_frames_took_their_share_of_the_time():
    result = synthetic_result(frames=9)
    assert result.at([0, 1, 2]).seconds == pytest.approx(result.seconds / 3)


def test_frames_of_uneven_steps_are_filled_in():
    result = synthetic_result(frames=9)
    assert evenly(result) is result
    assert evenly(result.at(range(0, 9, 2))).frame_numbers.tolist() == [10, 12, 14, 16, 18]
    filled = evenly(result.at([0, 1, 2, 5, 8]))
    np.testing.assert_array_equal(filled.frame_numbers, result.frame_numbers)
    np.testing.assert_allclose(filled.joints()[:, [0, 1, 2, 5, 8]], result.joints()[:, [0, 1, 2, 5, 8]], atol=1e-6)
    strided = evenly(result.at([0, 2, 8]))
    assert strided.frame_numbers.tolist() == [10, 12, 14, 16, 18]
    assert (strided.fps, strided.rate) == (result.fps, result.fps / 2)
    assert evenly(result.at([1, 3, 7])).frame_numbers.tolist() == [11, 13, 15, 17]  # whichever it begins with


def test_one_run_and_the_track_before_smoothing():
    result = synthetic_result()
    raw = replace(result, raw_pose=result.pose + 1.0, angle_sigma=result.pose)
    np.testing.assert_array_equal(of_run(raw, 1).raw_pose, raw.raw_pose[1:])
    assert of_run(raw, 0).best_run == 0
    np.testing.assert_array_equal(before_smoothing(raw).pose, raw.raw_pose)
    assert before_smoothing(raw).angle_sigma is None
    with pytest.raises(ValueError, match="was not smoothed"):
        before_smoothing(result)
