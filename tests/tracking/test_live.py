"""Live tracking: each frame is final soon after it was taken in, and nearly where the whole clip puts it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from synthetic import synthetic_subject
from tracked_motion import FPS, FRAMES, RIG, marker_errors, motion

from mmocap_warp.masks.observation import unpack_masks
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.live import track_live
from mmocap_warp.tracking.live_smoothing import LiveFrame
from mmocap_warp.tracking.track_config import TrackConfig

CONFIG = TrackConfig("contour", device="cpu", threads=1)
LONGEST = 9  # frames between a frame and its answer


def masks(hidden: tuple[int, ...] = ()) -> list[list[np.ndarray]]:
    """Of each frame of the motion, with nothing in some."""
    seen = [unpack_masks(each.words, RIG.size) for each in motion("cpu")[1]]
    return [[mask & (frame not in hidden) for mask in views] for frame, views in enumerate(seen)]


def live(seen: list[list[np.ndarray]], **settings) -> list[LiveFrame]:
    return list(track_live(synthetic_subject(), RIG, seen, FPS, CONFIG, **settings))


def test_a_frame_is_final_at_most_nine_frames_later():
    taken = 0

    def camera() -> Iterator[list[np.ndarray]]:
        nonlocal taken
        for views in masks():
            taken += 1
            yield views

    numbers = []
    for frame in track_live(synthetic_subject(), RIG, camera(), FPS, CONFIG):
        assert taken - 1 - frame.number <= LONGEST
        numbers.append(frame.number)
    assert numbers == list(range(FRAMES))


def test_live_poses_are_nearly_those_of_the_whole_clip():
    truth, seen = motion("cpu")
    whole = track_observations(synthetic_subject(), RIG, seen, FPS, CONFIG)
    frames = live(masks())
    np.testing.assert_array_equal([frame.raw_pose for frame in frames], np.moveaxis(whole.raw_pose, 0, 1))
    pose = np.stack([frame.pose[0] for frame in frames])
    assert marker_errors(pose, truth).mean() < 1.1 * marker_errors(whole.pose[0], truth).mean()
    joints = np.stack([frame.joints[0] for frame in frames])
    assert np.linalg.norm(joints - whole.joints()[0], axis=-1).max() < 0.01


def test_lost_frames_are_filled_in_and_say_so():
    hidden = (5, 6, FRAMES - 1)
    frames = live(masks(hidden))
    assert [frames[i].status for i in (4, *hidden)] == [("tracked",), ("interpolated",), ("interpolated",), ("lost",)]
    truth = motion("cpu")[0]
    errors = marker_errors(np.stack([frame.pose[0] for frame in frames]), truth)
    carried = marker_errors(np.stack([frame.raw_pose[0] for frame in frames]), truth)
    assert errors[5:7].mean() < 0.7 * carried[5:7].mean()
    assert np.isnan(frames[5].iou).all()


def test_a_run_has_the_same_bits_alone():
    alone, two = live(masks()[:12]), live(masks()[:12], runs=2)
    for one, both in zip(alone, two, strict=True):
        np.testing.assert_array_equal(one.pose[0], both.pose[0])
        assert both.pose.shape[0] == both.joints.shape[0] == len(both.status) == 2


def test_without_smoothing_there_is_nothing_to_wait_for():
    with pytest.raises(ValueError, match="smooth must be more than 0 to track live, h-cmaes has 0"):
        next(track_live(synthetic_subject(), RIG, masks(), FPS, TrackConfig("h-cmaes", device="cpu")))
