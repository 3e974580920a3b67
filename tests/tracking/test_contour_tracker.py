"""Each rung of the contour tracker's ladder of recovery rescues a frame that the rungs below it cannot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from random_scenes import perfect_masks
from synthetic import SKELETON, ring_rig, synthetic_subject

from mmocap_warp.body.posing import joint_positions
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.result.result import STATUS, FrameAnswer, Result
from mmocap_warp.result.verdict import verdict
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.smoothing import WIDE_SIGMA
from mmocap_warp.tracking.track_config import TrackConfig

RIG = ring_rig(cameras=4, size=(160, 120))  # a pixel is 25 mm wide
SUBJECT = synthetic_subject()
FPS = 60.0
KNOWN = 6  # frames after which the usual overlap is known, and the second look comes next
CONFIG = TrackConfig(device="cpu", threads=1)


@cache
def seen(key: tuple[tuple[int, float], ...] = ()) -> Observation:
    """What is seen of the first pose with some coordinates changed, each by a number."""
    pose = SUBJECT.pose.copy()
    for coordinate, change in key:
        pose[coordinate] += change
    return Observation.from_masks(list(perfect_masks(SUBJECT, RIG, pose)))


def moved(observation_key: tuple[tuple[int, float], ...]) -> np.ndarray:
    pose = SUBJECT.pose.copy()
    for coordinate, change in observation_key:
        pose[coordinate] += change
    return pose


def tracker(monkeypatch=None, **settings) -> ContourTracker:
    """A tracker that has seen the first pose for some frames; its search finds nothing if it is to be left out."""
    made = ContourTracker(SUBJECT, RIG, replace(CONFIG, **settings), FPS)
    for _ in range(KNOWN):
        made.step(seen())
    if monkeypatch:
        monkeypatch.setattr(made.search, "run", lambda: None)
    return made


def status(answer: FrameAnswer) -> str:
    return STATUS[int(np.ravel(answer.status)[0])]


def error(answer: FrameAnswer, truth: np.ndarray) -> float:
    """How far the farthest joint is off [m]."""
    away = joint_positions(SUBJECT, answer.pose) - joint_positions(SUBJECT, truth[None])
    return float(np.linalg.norm(away, axis=-1).max())


SHOULDER, ELBOW = SKELETON.angles("LShoulder").start, SKELETON.angles("LElbow").start
RAISED = ((SHOULDER + 2, 1.0),)
LOWERED = ((SHOULDER + 2, -1.0),)
ELSEWHERE = ((0, 1.0), (4, 1.5))
FOLDED = ((ELBOW + 1, -2.4),)


def test_what_a_search_remembers_is_read_after_a_search_only(monkeypatch):
    made = tracker(seed=9)
    counter = made.state.counter
    monkeypatch.setattr(made.search, "counter", None)
    made.step(seen())
    assert made.state.counter is counter
    monkeypatch.undo()
    made.step(seen(RAISED))
    assert (made.state.counter != counter).all()


def test_a_frame_that_falls_short_is_searched(monkeypatch):
    """The arm is too far for the contours, and nothing is scattered. With one seed of six the search finds it."""
    made = tracker(seed=9)
    assert made.step(seen()).evaluations == 0
    monkeypatch.setattr(made._starts, "scattered", lambda pose, _: np.repeat(pose[:, None], 40, axis=1))
    answers = [made.step(seen(RAISED)) for _ in range(2)]
    assert answers[0].evaluations == CONFIG.budget
    assert error(answers[1], moved(RAISED)) < 0.05


def test_after_a_climb_in_vain_a_frame_does_without_but_not_where_the_body_is_lost(monkeypatch):
    made = tracker()
    short = np.ones(1, bool)
    monkeypatch.setattr(made, "_falls_short", lambda answer, fall=0.012, exposed=0.12: short & (fall < 0.06))
    climbs = [made.step(seen()).evaluations > 0 for _ in range(6)]
    assert climbs == [True, False] * 3
    monkeypatch.setattr(made, "_falls_short", lambda answer, fall=0.012, exposed=0.12: short)
    assert all(made.step(seen()).evaluations for _ in range(3))


@pytest.mark.parametrize(
    ("cameras", "fall", "pose", "searched"),
    [(5, 0.018, (), False), (4, 0.018, (), True), (5, 0.03, (), True), (5, 0.018, ((ELBOW + 1, -0.7),), True)],
    ids=["a fault of a mask", "few views", "a clear fall", "mask that is not covered"],
)
def test_a_small_fall_is_searched_where_more_shows_that_a_limb_is_elsewhere(monkeypatch, cameras, fall, pose, searched):
    rig = ring_rig(cameras=cameras, size=(160, 120))
    observation = Observation.from_masks(list(perfect_masks(SUBJECT, rig, SUBJECT.pose)))
    made = ContourTracker(SUBJECT, rig, CONFIG, FPS)
    for _ in range(2):  # the second frame rests after the climb of the first
        made.step(observation)
    posed = moved(pose)[None].astype(np.float32)
    monkeypatch.setattr(made, "_best", lambda count, seen, best=made._best: replace(best(count, seen), pose=posed))
    overlap = made._best(1, observation).overlap
    levels = np.full_like(made._state.overlap_levels, overlap + fall)
    made._state = replace(made._state, overlap_levels=levels, uncovered_levels=made._state.uncovered_levels * 0)
    assert (made.step(observation).evaluations > 0) == searched


def test_a_limb_that_the_search_does_not_find_is_scattered(monkeypatch):
    answer = tracker(monkeypatch).step(seen(LOWERED))
    assert status(answer) == "rescued"
    assert error(answer, moved(LOWERED)) < 0.05


def test_a_body_that_stays_lost_is_looked_for_anywhere(monkeypatch):
    made = tracker(monkeypatch)
    answers = [made.step(seen(ELSEWHERE)) for _ in range(4)]
    assert [status(answer) for answer in answers] == ["lost", "lost", "lost", "rescued"]
    assert error(answers[2], moved(ELSEWHERE)) > 0.5
    assert error(answers[3], moved(ELSEWHERE)) < 0.05


def with_folded_arm(**settings) -> ContourTracker:
    """A tracker that folded an arm away long ago, so that it overlaps as usual."""
    made = tracker(**settings)
    pose = moved(FOLDED)[None].astype(np.float32)
    levels = np.full_like(made._state.overlap_levels, 0.8)
    made._state = replace(made._state, pose=pose, previous_pose=pose, overlap_levels=levels)
    return made


@pytest.mark.parametrize("settings", [{}, {"algorithm": "h-de", "polish": True, "evaluations": 200}], ids=str)
def test_an_arm_that_masks_show_is_in_doubt_until_it_is_found(settings):
    made = with_folded_arm(**settings)
    levels = made._state.overlap_levels
    answers = [made.step(seen()) for _ in range(KNOWN)]
    assert {status(answer) for answer in answers} == {"partial"}
    np.testing.assert_array_equal(made._state.overlap_levels, levels)  # nothing is learnt from frames in doubt
    found = made.step(seen())
    assert status(found) == "rescued"
    assert error(answers[-1], SUBJECT.pose) > 0.4
    assert error(found, SUBJECT.pose) < 0.1
    assert status(made.step(seen())) == "tracked"


def test_a_tracker_that_never_searches_says_that_an_arm_is_elsewhere():
    made = with_folded_arm(algorithm="contour")
    answers = [made.step(seen()) for _ in range(2 * KNOWN + 1)]
    assert {status(answer) for answer in answers} == {"partial"}
    assert sum(answer.evaluations for answer in answers) == 0


def test_a_fault_of_one_view_is_no_limb_that_is_exposed():
    """A block is cut out of one view: there the body is exposed, and the second longest outline is that of others."""
    masks = unpack_masks(seen().words, RIG.size)
    masks[1] = masks[1].copy()
    masks[1][80:] = False
    made = tracker()
    level = made._state.overlap_levels
    made._state = replace(made._state, overlap_levels=np.full_like(level, 0.8))
    assert made.step(Observation.from_masks(masks)).evaluations == 0


def beside(views: tuple[int, ...] = (), instead: tuple[int, ...] = ()) -> Observation:
    """What is seen with somebody like the body beside it in some views, and in others instead of it."""
    masks = unpack_masks(seen().words, RIG.size)
    other = [np.roll(mask, 40, axis=1) for mask in masks]
    shown = [mask | other[k] if k in views else other[k] if k in instead else mask for k, mask in enumerate(masks)]
    return Observation.from_masks(shown)


@pytest.mark.parametrize(
    ("observation", "expected"),
    [
        (beside((0, 1, 2, 3)), "tracked"),
        (beside((0, 1, 2), instead=(3,)), "tracked"),
        (beside(instead=(2, 3)), "lost"),
        (Observation.from_masks([np.ones((120, 160), bool)] * 4), "lost"),  # which shows no outline
    ],
    ids=["beside", "instead in one view", "instead in two", "everything"],
)
def test_who_else_is_seen_does_not_lose_the_body(observation, expected):
    answer = tracker().step(observation)
    assert status(answer) == expected
    if expected == "tracked":
        assert error(answer, SUBJECT.pose) < 0.03


@pytest.mark.parametrize(("change", "expected"), [(LOWERED, "rescued"), (ELSEWHERE, "lost")])
def test_the_result_says_what_happened(change, expected):
    frames = [*[seen()] * KNOWN, *[seen(change)] * 2]
    result = track_observations(SUBJECT, RIG, frames, FPS, replace(CONFIG, smooth=0.0))
    assert [STATUS[each] for each in result.status[0, :KNOWN]] == ["tracked"] * KNOWN
    assert STATUS[result.status[0, KNOWN]] == expected


FOLDED_FRAMES = 8


def folded_clip() -> Result:
    """A clip by a tracker that never searches: an arm is folded, then it is not, and contours do not bring it back."""
    folded = replace(SUBJECT, pose=moved(FOLDED))
    frames = [*[seen(FOLDED)] * FOLDED_FRAMES, *[seen()] * 12]
    return track_observations(folded, RIG, frames, FPS, replace(CONFIG, algorithm="contour"))


def test_a_clip_without_second_opinion_names_the_limb_that_is_in_doubt(monkeypatch):
    monkeypatch.setattr("mmocap_warp.tracking.smoothing.BackwardPass", lambda *_: None)
    result = folded_clip()
    assert {STATUS[each] for each in result.status[0, FOLDED_FRAMES + 1 :]} == {"partial"}
    parts = verdict(result)["parts"]
    assert set(parts) == {"left arm"}
    assert set(range(FOLDED_FRAMES + 1, FOLDED_FRAMES + 12)) <= set(parts["left arm"])
    sigma = result.joint_sigma[0, FOLDED_FRAMES + 1 :]
    assert (sigma[:, SKELETON.index("LWrist")] >= WIDE_SIGMA).all()
    assert (sigma[:, SKELETON.index("RWrist")] < WIDE_SIGMA / 2).all()


def test_a_second_opinion_finds_a_limb_that_no_frame_knew():
    result = folded_clip()
    assert np.linalg.norm(result.raw_pose - SUBJECT.pose, axis=2).min() > 1.0
    away = joint_positions(SUBJECT, result.pose[0, FOLDED_FRAMES + 3 :]) - joint_positions(SUBJECT, SUBJECT.pose[None])
    assert np.linalg.norm(away, axis=-1).max() < 0.12
    assert {STATUS[each] for each in result.status[0]} == {"tracked"}
