"""The built-in walk with nothing to forgive: the true body, perfect masks, and from its true pose no error at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import perfect_masks
from walk_scene import walking

from mmocap_warp.body.model import Subject
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.result import STATUS
from mmocap_warp.tracking.frame_loop import collect, track_observations
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker

FRAMES = 3
MOST_ERROR_MM = 1.0  # at the true pose; what is left is single precision
MOST_TRACKED_MM = 10.0  # tracked for three frames at 160 x 120, where a pixel is 25 mm wide
SCALE = 0.25


@pytest.fixture(scope="module")
def recording():
    return walking()


@pytest.fixture(scope="module")
def subject(recording) -> Subject:
    return Subject(recording.body, recording.root_base, recording.poses[0], {})


@pytest.fixture(scope="module")
def rig(recording):
    return recording.rig.undistorted(SCALE)


@pytest.fixture(scope="module")
def seen(recording, subject, rig) -> list[Observation]:
    """The tracking mesh's own silhouettes at the true poses, by the twin of the renderer."""
    return [Observation.from_masks(perfect_masks(subject, rig, pose)) for pose in recording.poses[:FRAMES]]


def test_the_true_pose_costs_nothing_and_is_never_left(device, recording, subject, rig, seen):
    config = TrackConfig("h-cmaes", evaluations=200, runs=2, device=device)
    tracker = Tracker(subject, rig, config, recording.fps)
    answers = []
    for pose, observation in zip(recording.poses, seen, strict=False):
        there = np.repeat(pose[None].astype(np.float32), config.runs, axis=0)
        tracker.state = replace(tracker.state, pose=there)
        answers.append(tracker.step(observation))
    result = collect(subject, rig, recording.fps, config, answers)
    assert (result.cost == 0).all()
    assert (result.iou == 1).all()
    report = evaluate(result, recording.truth())
    assert report["truth_frames"] == FRAMES
    assert report["marker_error_mm"] < MOST_ERROR_MM
    assert report["mpjpe_mm"] < MOST_ERROR_MM
    assert max(max(run) for run in np.array(report["series"]["marker_error_mm"])) < MOST_ERROR_MM


def test_the_true_body_is_tracked_from_its_true_pose(device, recording, subject, rig, seen):
    config = TrackConfig("h-cmaes", evaluations=500, runs=2, device=device)
    result = track_observations(subject, rig, seen, recording.fps, config)
    assert (result.cost[:, 0] == 0).all()
    report = evaluate(result, recording.truth())
    assert max(run["marker_error_mm"] for run in report["per_run"]) < MOST_TRACKED_MM


def test_a_calibration_that_is_off_is_not_taken_for_a_person_who_is_lost(recording, subject, rig):
    """With every camera 10 px of 640 off, much of the outline lies outside of the masks in every frame."""
    angle = np.random.default_rng([0, 6]).uniform(0, 2 * np.pi, len(rig))
    K = rig.K.copy()
    K[:, :2, 2] += 10 * SCALE * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    masks = [Observation.from_masks(perfect_masks(subject, rig, pose)) for pose in recording.poses[:9]]
    config = TrackConfig("contour", device="cpu")
    result = track_observations(subject, replace(rig, K=K), masks, recording.fps, config)
    assert {STATUS[each] for each in result.status.ravel()} == {"tracked"}
