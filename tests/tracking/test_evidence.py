"""What masks say about a finished track, and what repeated frames do to it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest
from random_scenes import perfect_masks
from synthetic import SKELETON, ring_rig, synthetic_subject

from mmocap_warp.body.posing import joint_positions
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import FrameAnswer
from mmocap_warp.result.verdict import verdict
from mmocap_warp.tracking.body_masks import body_silhouettes
from mmocap_warp.tracking.evidence import with_evidence
from mmocap_warp.tracking.frame_loop import _finished, collect
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.track_config import TrackConfig

SUBJECT, RIG, FRAMES = synthetic_subject(), ring_rig(cameras=4, size=(240, 180)), 16
CONFIG = TrackConfig(device="cpu", threads=1, smooth=10.8)
PX = 4.0 / RIG.K[0, 0, 0]  # metres of a pixel at the body


@cache
def swinging():
    """Poses (frame, coordinate), and what is seen of them."""
    index, time = SKELETON.searched(), np.arange(FRAMES)[:, None] / 60
    truth = np.tile(SUBJECT.pose, (FRAMES, 1))
    phase = np.random.default_rng(2).uniform(0, 2 * np.pi, len(index))
    truth[:, index] += np.where(index < 3, 0.06, 0.2) * (np.sin(9 * time + phase) - np.sin(phase))
    truth = np.clip(truth, *SKELETON.coordinate_limits.T)
    return truth, [Observation.from_masks(list(perfect_masks(SUBJECT, RIG, pose))) for pose in truth]


def tracked(rig=RIG, poses=None):
    """A track through given poses, the true ones by default."""
    poses = swinging()[0] if poses is None else poses
    answers = [FrameAnswer(pose[None], np.zeros(1), np.full((1, len(rig)), 0.9), 1, 0, 0.0) for pose in poses]
    return collect(SUBJECT, rig, 60.0, CONFIG, answers)


def judged(result, seen=None):
    return with_evidence(result, CONFIG, swinging()[1] if seen is None else seen)


def test_nothing_speaks_against_the_truth():
    result = judged(tracked())
    assert result.view_shift.shape == (1, FRAMES, 4)
    assert result.view_shift.max() < 0.3 * PX
    assert verdict(result)["trusted"] == FRAMES


def test_a_limb_that_is_elsewhere_is_in_doubt_where_a_tracker_has_no_deviations():
    """The paper's trackers call all frames tracked."""
    poses = swinging()[0].copy()
    joint = SKELETON.index("LShoulder")
    poses[6:12, 3 * joint + 3 : 3 * joint + 6] += 1.2
    result = judged(tracked(poses=np.clip(poses, *SKELETON.coordinate_limits.T)))
    parts = result.config["parts_in_doubt"]  # those that are near what nothing covers
    assert parts
    assert all({*range(6, 12)} <= {*frames} for frames in parts.values())
    said = verdict(result)
    assert said["trusted"] <= FRAMES - 6
    assert said["parts"] == parts
    assert not said["holds"]
    # Of a smoothed track its deviations say so.
    smoothed = _finished(tracked(poses=poses), CONFIG, lambda: swinging()[1], pytest.fail, None)
    assert smoothed.view_shift is not None
    assert "parts_in_doubt" not in smoothed.config
    # What is tracked once more, without a view, is judged by itself.
    again = verdict(judged(replace(tracked(), config=result.config)))
    assert (again["trusted"], again["parts"]) == (FRAMES, {})


def test_a_view_that_is_off_is_measured_though_limbs_are_hidden_in_others():
    K = RIG.K.copy()
    K[1, 0, 2] += 5
    seen = [replace(each, words=each.words.copy()) for each in swinging()[1]]
    for each in seen:
        each.words[[0, 2], 110:] = 0  # something stands before the legs
    shift = np.median(judged(tracked(replace(RIG, K=K)), seen).view_shift[0], axis=0)
    assert shift.argmax() == 1
    assert shift[1] == pytest.approx(5 * PX, rel=0.45)  # others share in it, as when the body is put in between
    assert verdict(judged(tracked(), seen))["holds"]


def test_a_body_beside_its_place_in_all_views_is_no_cameras_fault():
    beside = swinging()[0] + np.eye(SUBJECT.pose.size)[0] * 0.05
    assert np.median(judged(tracked(poses=beside)).view_shift) < 0.4 * PX


def test_a_view_that_shows_nothing_has_no_shift():
    seen = [each.without(np.arange(4) == 2) for each in swinging()[1]]
    assert np.isnan(judged(tracked(), seen).view_shift[..., 2]).all()


def test_every_second_frame_repeated_is_smoothed_as_if_it_were_not_there():
    truth, seen = swinging()
    again = np.arange(FRAMES) // 2 * 2
    raw = tracked(poses=truth[again])

    def error(masks):
        result = _finished(raw, CONFIG, lambda: masks, pytest.fail, None)
        off = joint_positions(SUBJECT, result.pose[0]) - joint_positions(SUBJECT, truth)
        return np.linalg.norm(off, axis=-1)[:-1].mean(), result

    before, as_motion = error([replace(seen[i], words=seen[i].words ^ _speck(n)) for n, i in enumerate(again)])
    after, result = error([seen[i] for i in again])
    assert verdict(as_motion)["repeated"] == 0
    assert after < 0.5 * before
    told = verdict(result)
    assert (told["repeated"], told["holds"]) == (FRAMES // 2, True)
    assert np.isnan(result.view_shift[0, 1::2]).all()


def _speck(number):
    """Noise that differs from frame to frame, far from the body."""
    words = np.zeros_like(swinging()[1][0].words)
    words[:, :: 2 + number % 3, number % 2] = 0xF
    return words


def followed(tracker, shown):
    silhouettes_of = body_silhouettes(SUBJECT, RIG)
    return [tracker.step(each) for each in shown(lambda _: silhouettes_of(tracker.state.pose))]


def test_a_frozen_view_is_left_out_and_named():
    truth, seen = swinging()
    frozen = [replace(each, words=each.words.copy()) for each in seen]
    for i in range(4, 15):
        frozen[i].words[3] = seen[3].words[3]
    misled = tracked(poses=truth + np.eye(SUBJECT.pose.size)[0] * 0.1 * (np.arange(FRAMES)[:, None] > 3))
    for config in (CONFIG, replace(CONFIG, smooth=0.0)):
        closed = []  # what smooths meanwhile smooths a track that is not wanted
        beside = SimpleNamespace(close=lambda closed=closed: closed.append(True))
        tracker = make_tracker(SUBJECT, RIG, config, 60.0)
        result = _finished(misled, config, lambda: frozen, partial(followed, tracker), None, beside)
        assert closed == [True]
        assert result.config["frozen_views"] == {"cam04": list(range(4, 15))}
        assert np.isnan(result.iou[0, 4:15, 3]).all()
        assert result.frame_numbers.tolist() == list(range(FRAMES))
        off = joint_positions(SUBJECT, result.pose[0]) - joint_positions(SUBJECT, truth)
        assert np.linalg.norm(off, axis=-1).mean() < 0.3 * PX


def test_a_view_that_was_moved_is_left_out_from_there_on_and_named():
    """At a rate at which these frames are seconds; the whole body is smoothed once with the view and once without."""
    truth, seen = swinging()
    moved = [replace(each, words=each.words.copy()) for each in seen]
    for each in moved[12:]:
        each.words[3] = np.roll(each.words[3], 12, axis=0)
    raw = replace(tracked(poses=truth), fps=6.0)
    tracker = make_tracker(SUBJECT, RIG, CONFIG, 6.0)
    result = _finished(raw, CONFIG, lambda: moved, partial(followed, tracker), None)
    assert result.config["moved_views"] == {"cam04": list(range(12, FRAMES))}
    assert np.isnan(result.iou[0, 12:, 3]).all()
    assert np.isfinite(result.iou[0, :12, 3]).all()
    assert verdict(result)["holds"]
    off = joint_positions(SUBJECT, result.pose[0]) - joint_positions(SUBJECT, truth)
    assert np.linalg.norm(off, axis=-1).mean() < 0.5 * PX
