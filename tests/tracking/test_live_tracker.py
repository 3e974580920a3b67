"""Two answers for each frame: at once, and smoothed by a process beside; the same frames get the same answers."""

from __future__ import annotations

import pickle
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import cv2
import numpy as np
import pytest
from synthetic import synthetic_subject
from tracked_motion import FPS, FRAMES, RIG, marker_errors, motion

from mmocap_warp.errors import InputError
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.live import LiveFrame, LiveTracker
from mmocap_warp.tracking.live_process import LiveProcess
from mmocap_warp.tracking.track_config import TrackConfig

CONFIG = TrackConfig("contour", device="cpu", threads=1)
DROPPED = (6, 7)


LATE = range(FRAMES + 100, FRAMES + 112)
HOLED = {LATE[0]: False, LATE[1]: True, LATE[2]: True, LATE[6]: True, LATE[7]: False, LATE[11]: True}
"""Frames of which the trunk is missing, and others: those between are dropped."""


@pytest.fixture(scope="module")
def answers() -> tuple[list[LiveFrame], list[LiveFrame], list[bool]]:
    """Those at once, and those smoothed, of a motion of which two frames were dropped; then of others, much later.

    Last comes in which of these something may be hidden.
    """
    seen = [unpack_masks(each.words, RIG.size) for each in motion("cpu")[1]]
    holed = [mask.copy() for mask in seen[-1]]
    for mask in holed:
        x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
        mask[y + height // 4 : y + 3 * height // 4, x : x + width] = False
    step, hidden = ContourTracker.step, []

    def watched(tracker, observation):
        hidden.append(observation.hidden is not None)
        return step(tracker, observation)

    with pytest.MonkeyPatch.context() as patch, closing(LiveTracker(synthetic_subject(), RIG, FPS, CONFIG)) as tracker:
        patch.setattr(ContourTracker, "step", watched)
        at_once = [tracker.step(n, Observation.from_masks(masks)) for n, masks in enumerate(seen) if n not in DROPPED]
        later = {n: Observation.from_masks(holed if is_holed else seen[-1]) for n, is_holed in HOLED.items()}
        at_once += [tracker.step(n, each) for n, each in later.items()]
        return at_once, list(tracker.rest()), hidden[-len(HOLED) :]


def test_a_hole_is_followed_across_dropped_frames_and_begins_only_where_it_is_seen_to_open(answers):
    assert answers[2] == [False, True, True, True, False, False]


def test_answers_at_once_are_those_of_the_tracker(answers):
    whole = track_observations(synthetic_subject(), RIG, motion("cpu")[1], FPS, CONFIG)
    for frame in answers[0][: DROPPED[0]]:  # until a frame is dropped
        np.testing.assert_array_equal(frame.pose, whole.raw_pose[:, frame.number].astype(float))
        assert frame.status == ("tracked",)
    assert [frame.number for frame in answers[0]] == [n for n in range(FRAMES) if n not in DROPPED] + [*HOLED]


def test_smoothed_answers_fill_what_was_dropped(answers):
    smoothed = answers[1]
    assert [frame.number for frame in smoothed] == [*range(FRAMES), *LATE]
    assert [smoothed[n].status for n in DROPPED] == [("interpolated",)] * 2
    truth = motion("cpu")[0]
    errors = marker_errors(np.stack([frame.pose[0] for frame in smoothed[:FRAMES]]), truth)
    assert errors[list(DROPPED)].max() < 2 * np.delete(errors, DROPPED).max()
    raw = {frame.number: frame.pose for frame in answers[0]}
    for frame in smoothed[:FRAMES]:
        if frame.number not in DROPPED:
            np.testing.assert_array_equal(frame.raw_pose, raw[frame.number])


def test_only_every_so_many_frames_may_be_searched_for():
    tracker = ContourTracker(synthetic_subject(), RIG, TrackConfig(device="cpu", threads=1, evaluations=20), FPS)
    tracker.search_interval = 2
    evaluations = [tracker.step(seen).evaluations for seen in motion("cpu")[1][:3]]
    assert [spent > 0 for spent in evaluations] == [True, False, True]  # no level is known yet: all fall short


def test_after_one_frame_that_was_searched_the_usual_overlap_may_be_known():
    tracker = ContourTracker(synthetic_subject(), RIG, CONFIG, FPS)
    tracker.step(motion("cpu")[1][0])
    assert not tracker.state.level_known
    settled = tracker.state.settled()
    assert settled.level_known
    assert settled.overlap_levels.max() == tracker.state.overlap_levels.max()


def test_without_smoothing_there_is_no_second_answer():
    with pytest.raises(ValueError, match="smooth must be more than 0 to track live, h-cmaes has 0"):
        LiveTracker(synthetic_subject(), RIG, FPS, TrackConfig("h-cmaes", device="cpu"))


def test_another_process_gives_the_same_answers(answers):
    with closing(LiveProcess(synthetic_subject(), RIG, FPS, CONFIG)) as tracker:
        tracker.wait()
        *first, last = enumerate(motion("cpu")[1][: DROPPED[0]])
        at_once = [tracker.step(n, seen) for n, seen in first]
        with ThreadPoolExecutor(1) as pool:  # as a thread that waits for a step when Ctrl-C is pressed
            at_last = pool.submit(tracker.step, *last)
            while not tracker._turn.locked():
                time.sleep(0.001)
            later = list(tracker.rest())
        at_once.append(at_last.result())
    for one, other in zip(answers[0], at_once, strict=False):
        np.testing.assert_array_equal(one.pose, other.pose)
    assert [frame.number for frame in later] == [*range(DROPPED[0])]


def test_what_goes_wrong_in_another_process_is_raised_here():
    with closing(LiveProcess(synthetic_subject(), RIG, FPS, TrackConfig("h-cmaes", device="cpu"))) as tracker:
        with pytest.raises(ValueError, match="smooth must be more than 0 to track live"):
            tracker.wait()
        with pytest.raises(RuntimeError, match="a process that tracks ended with exit code 0"):
            tracker.wait()
    assert str(pickle.loads(pickle.dumps(InputError("a.png", "is none", "make one")))) == "a.png: is none; make one"


@pytest.mark.nightly
def test_the_same_frames_get_the_same_answers(answers):
    seen = [unpack_masks(each.words, RIG.size) for each in motion("cpu")[1]]
    with closing(LiveTracker(synthetic_subject(), RIG, FPS, CONFIG)) as tracker:
        again = []
        for n, masks in enumerate(seen):
            if n not in DROPPED:
                tracker.step(n, masks)
                again += tracker.smoothed()
        again += tracker.rest()
    for one, other in zip(answers[1][:FRAMES], again, strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
        assert one.status == other.status


@pytest.mark.nightly
def test_a_process_that_dies_is_told_of():
    seen = [unpack_masks(each.words, RIG.size) for each in motion("cpu")[1]]
    with closing(LiveTracker(synthetic_subject(), RIG, FPS, CONFIG)) as tracker:
        tracker._process.kill()
        tracker._process.join()
        tracker.step(0, seen[0])
        with pytest.raises(RuntimeError, match="the process that smooths ended with exit code -9"):
            list(tracker.rest())
