"""Two answers for each frame: at once, and smoothed by a process beside; the same frames get the same answers."""

from __future__ import annotations

import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import replace
from multiprocessing import Pipe

import cv2
import numpy as np
import pytest
from synthetic import synthetic_subject
from tracked_motion import FPS, FRAMES, RIG, marker_errors, motion

from mmocap_warp.errors import InputError
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.tracking import live_process
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.live import LiveTracker
from mmocap_warp.tracking.live_process import LiveHere, LiveProcess, make_live
from mmocap_warp.tracking.live_smoothing import LiveFrame, SmoothingProcess
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


def test_frames_of_several_people_that_are_begun_together_get_the_answers_of_each_alone(device):
    seen = motion(device)[1][:4]
    config = replace(CONFIG, device=device)
    first_is_lost = [each.without(np.arange(len(each.foreground)) == 0) for each in seen]

    def tracker() -> LiveTracker:
        return stack.enter_context(closing(LiveTracker(synthetic_subject(), RIG, FPS, config)))

    with ExitStack() as stack:
        one, other, alone, other_alone = (tracker() for _ in range(4))
        for number, (of_one, of_other) in enumerate(zip(seen, first_is_lost, strict=True)):
            one.begin(number, of_one)
            other.begin(number, of_other)
            np.testing.assert_array_equal(one.finish().pose, alone.step(number, of_one).pose)
            np.testing.assert_array_equal(other.finish().pose, other_alone.step(number, of_other).pose)


def test_only_every_so_many_frames_may_be_searched_for():
    tracker = ContourTracker(synthetic_subject(), RIG, TrackConfig(device="cpu", threads=1, evaluations=20), FPS)
    tracker.search_interval = 2
    evaluations = [tracker.step(seen).evaluations for seen in motion("cpu")[1][:3]]
    assert [spent > 0 for spent in evaluations] == [True, False, True]  # no level is known yet: all fall short


def test_across_missing_frames_the_motion_goes_on():
    seen = motion("cpu")[1]
    tracker = ContourTracker(synthetic_subject(), RIG, CONFIG, FPS)
    for each in seen[:3]:
        tracker.step(each)
    last, before = tracker.state.pose, tracker.state.previous_pose
    tracker.skip(2)
    np.testing.assert_allclose(tracker.state.pose - tracker.state.previous_pose, 3 * (last - before), atol=1e-5)
    tracker.step(seen[5])
    moved = tracker.state.pose - tracker.state.previous_pose
    np.testing.assert_allclose(moved, (tracker.state.pose - last) / 3, atol=1e-5)  # of a frame again
    kept = tracker.state
    tracker.skip(20)
    np.testing.assert_array_equal(tracker.state.previous_pose, kept.previous_pose)  # nobody knows where to


def test_live_a_body_is_searched_for_once_it_stays_lost(monkeypatch):
    seen, climbed = motion("cpu")[1], []
    tracker = ContourTracker(synthetic_subject(), RIG, TrackConfig(device="cpu", threads=1, evaluations=20), FPS)
    tracker.search_interval = 100
    tracker.step(seen[0])
    tracker.state = tracker.state.settled()
    elsewhere = Observation.from_masks([np.roll(mask, 30, axis=1) for mask in unpack_masks(seen[1].words, RIG.size)])
    recover = ContourTracker._recovered

    def watched(*given):
        climbed.append(len(found))
        return recover(*given)

    monkeypatch.setattr(ContourTracker, "_recovered", watched)
    found = []
    for _ in range(4):
        found.append(tracker.step(elsewhere).status[0])
    assert climbed == []  # it was searched for in the first frame
    tracker.next_search = 0
    found.append(tracker.step(elsewhere).status[0])
    assert climbed == [4]


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


def test_another_process_gives_each_person_the_same_answers(answers):
    with closing(LiveProcess([(synthetic_subject(), RIG, FPS, CONFIG)] * 2)) as trackers:
        trackers.wait()
        seen = motion("cpu")[1][: DROPPED[0]]
        found = [trackers.step(n, [each, each]) for n, each in enumerate(seen)]
        rest = trackers.rest()
        found = [each.result() for each in found]
    for person in range(2):
        for one, (at_once, _) in zip(answers[0], found, strict=False):
            np.testing.assert_array_equal(one.pose, at_once[person].pose)
        smoothed = [frame for _, later in [*found, ([], rest)] for frame in later[person]]
        assert [frame.number for frame in smoothed] == [*range(DROPPED[0])]


def test_on_a_gpu_a_process_tracks_three_people(monkeypatch):
    monkeypatch.setattr("mmocap_warp.tracking.live_process.resolve_device", lambda name: name)
    for kind in ("LiveProcess", "LiveTracker"):
        monkeypatch.setattr(f"mmocap_warp.tracking.live_process.{kind}", Made)
    five = [(name,) for name in "abcde"]
    assert [each.about for each in make_live("cuda:0", five)] == [(five[:3],), (five[3:],)]
    assert [each.about for each in make_live("cpu", five)] == [([each],) for each in five]
    (one,) = make_live("cuda:0", five[:1])
    assert isinstance(one, LiveHere)
    assert one._tracker.about == ("a",)


class Failing:
    """A tracker whose process that smooths has died."""

    def __init__(self, *_, **__) -> None:
        pass

    def begin(self, *_) -> None:
        raise RuntimeError("the process that smooths ended")

    def close(self) -> None:
        """Nothing is open."""


def test_a_process_that_fails_ends_and_waits_for_no_other_frame(monkeypatch):
    for kind in ("LiveTracker", "SmoothingProcess"):
        monkeypatch.setattr(live_process, kind, Failing)
    monkeypatch.setattr(live_process, "start_beside", int)  # only a main thread may handle signals
    here, there = Pipe()
    with ThreadPoolExecutor(1) as pool, closing(here):
        process = pool.submit(live_process._serve, there)
        here.send([()])
        assert here.recv() is None
        here.send((0, [None]))
        with pytest.raises(RuntimeError, match="the process that smooths ended"):
            process.result(timeout=20)


class Made:
    """What is made of something."""

    def __init__(self, *about) -> None:
        self.about, self.close = about, None


def test_what_goes_wrong_in_another_process_is_raised_here():
    with closing(LiveProcess([(synthetic_subject(), RIG, FPS, TrackConfig("h-cmaes", device="cpu"))])) as tracker:
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
        tracker._smoother._process.kill()
        tracker._smoother._process.join()
        tracker.step(0, seen[0])
        with pytest.raises(RuntimeError, match="the process that smooths ended with exit code -9"):
            list(tracker.rest())


@pytest.mark.parametrize("kind", ["live_smoothing.SmoothingProcess", "live_process.LiveProcess"])
def test_a_process_that_would_run_its_callers_script_again_does_not_hang(kind, tmp_path):
    """More is handed to it than a pipe holds."""
    module, name = kind.split(".")
    wait = "made.rest(0).__next__()" if name == "SmoothingProcess" else "made.wait()"
    script = f"""
from mmocap_warp.tracking.{module} import {name}
made = {name}([(bytes(2**20),) * 4])
{wait}
"""
    (tmp_path / "script.py").write_text(script)
    done = subprocess.run([sys.executable, tmp_path / "script.py"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "ended with exit code 1" in done.stderr.splitlines()[-1]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals between processes")
@pytest.mark.parametrize(("grace", "code"), [(60.0, 0), (0.01, 1)], ids=["until it is asked", "but not for ever"])
def test_a_process_beside_outlives_the_signals_that_its_parent_winds_up_on(grace, code):
    program = (
        "import os, signal, time; from mmocap_warp.tracking import live_smoothing as beside\n"
        f"beside.start_quietly, beside._GRACE = int, {grace}; beside.start_beside()\n"
        "for each in signal.SIGINT, signal.SIGTERM, signal.SIGTERM: os.kill(os.getpid(), each)\n"
        f"print('answers', flush=True); time.sleep({5.0 if code else 0.0})"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (code, "answers\n"), done.stderr


def test_a_frame_is_handed_on_once_its_answer_was_given(monkeypatch):
    handed = []
    monkeypatch.setattr(SmoothingProcess, "hand_on", lambda self, person, number, *_: handed.append(number))
    monkeypatch.setattr(SmoothingProcess, "rest", lambda self, person: iter(()))
    seen = motion("cpu")[1]
    with closing(LiveTracker(synthetic_subject(), RIG, FPS, CONFIG)) as tracker:
        handed.clear()  # the rehearsal's
        tracker.step(0, seen[0])
        assert handed == []
        list(tracker.smoothed())
        assert handed == [0]
        tracker.step(1, seen[1])
        tracker.step(2, seen[2])
        assert handed == [0, 1]
        list(tracker.rest())
        assert handed == [0, 1, 2]


def test_wrong_frames_are_refused_and_the_next_is_tracked():
    seen = [unpack_masks(each.words, RIG.size) for each in motion("cpu")[1]]
    with closing(LiveTracker(synthetic_subject(), RIG, FPS, CONFIG)) as tracker:
        tracker.step(0, seen[0])
        for masks in ([mask[:-1] for mask in seen[1]], [mask[:, 1:] for mask in seen[1]], seen[1][:-1]):
            with pytest.raises(ValueError, match="masks must be one of each camera"):
                tracker.step(1, masks)
        assert tracker.step(1, seen[1]).status == ("tracked",)
        with pytest.raises(ValueError, match="frame 1 comes after frame 1: numbers must ascend"):
            tracker.step(1, seen[1])
    with pytest.raises(ValueError, match="fps must be above 0, got 0"):
        LiveTracker(synthetic_subject(), RIG, 0, CONFIG)
