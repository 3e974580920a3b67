"""A fox that walks is tracked as people are: a shipped character, its own motion, made masks with faults."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mmocap_warp.body.model import BodyMotion, Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.formats.usd.usd_body import read_body, read_motions
from mmocap_warp.rigging.shipped import body_file
from mmocap_warp.synthesis.any_body import recorded
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.track_config import TrackConfig

FRAMES = 8
LENGTH = 1.55  # [m], from nose to tail


def test_the_fox_walks_before_six_cameras() -> None:
    fox, walk = read_body(body_file("fox")), read_motions(body_file("fox"))["Walk"]
    recording = recorded(fox, replace(walk, pose=walk.pose[:FRAMES]), 6)
    subject = Subject(fox, recording.root_base, recording.poses[0], {})
    tracker = ContourTracker(subject, recording.rig, TrackConfig(algorithm="contour", threads=1), recording.fps)
    truth = recording.truth().joints
    apart, overlap = [], []
    for frame in range(FRAMES):
        answer = tracker.step(recording.observation(frame))
        apart.append(np.linalg.norm(_joints(subject, answer.pose[0]) - truth[frame], axis=1).mean())
        overlap.append(np.nanmean(answer.iou))
    assert np.mean(apart) < 0.006 * LENGTH  # measured: 0.003
    assert np.mean(overlap) > 0.9


def _joints(subject: Subject, pose: np.ndarray) -> np.ndarray:
    places: np.ndarray = Poser(subject.body, subject.root_base).joint_transforms(pose)[0, :, :3, 3]
    return places


def test_every_camera_sees_all_of_what_moves() -> None:
    fox, run = read_body(body_file("fox")), read_motions(body_file("fox"))["Run"]
    recording = recorded(fox, BodyMotion(run.fps, run.pose[::10]), 3, size=(320, 240), faulty=False)
    for frame in range(len(recording)):
        for mask in recording.masks(frame):
            assert mask.sum() > 1000
            assert mask[1:-1, 1:-1].sum() == mask.sum()
    assert min(recording.vertices(frame)[:, 2].min() for frame in range(len(recording))) > -1e-6
