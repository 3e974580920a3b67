"""A subject is followed there and back, and of each frame the better answer counts."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from walk_scene import walking

from mmocap_warp.body.model import Subject
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.fitting import clip_body
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.tracking.track_config import TrackConfig

THERE, BACK = 0.1, 0.2  # where the root is on the way there, and back [m]


@pytest.fixture
def subject() -> Subject:
    walk = walking()
    return Subject(walk.body, walk.root_base, walk.poses[0], {})


def followed(subject, monkeypatch, there, back, lost=()):
    """Frames 0, 1, ... followed by a tracker whose answers cost ``there`` and then ``back``, by frame."""

    class Tracker:
        def __init__(self, start, rig, config, fps):
            self.is_back = config.algorithm == "contour"
            assert start.pose[0] == pytest.approx(THERE if self.is_back else subject.pose[0])

        def step(self, frame):
            pose = subject.pose[None].astype(np.float32).copy()
            pose[:, 0] = BACK if self.is_back else THERE
            cost = np.array([(back if self.is_back else there)[frame]])
            status = np.array([STATUS.index("lost" if frame in lost else "tracked")])
            return FrameAnswer(pose, cost, np.ones((1, 5)), 0, status, 0.0)

    monkeypatch.setattr(clip_body, "ContourTracker", Tracker)
    monkeypatch.setattr(clip_body, "with_hidden", lambda frames, *_: frames)  # frames are numbers here
    found = clip_body.follow(subject, None, range(len(there)), 30.0, TrackConfig(device="cpu"))
    return found, found.rooted.pose[:, 0]


def test_a_frame_that_is_clearly_better_from_behind_is_taken_from_there(subject, monkeypatch):
    found, place = followed(subject, monkeypatch, there=[2.0, 1.0, 1.0, 1.0], back=[1.0, 0.99, 1.2, 0.0])
    np.testing.assert_allclose(place, [BACK, THERE, THERE, THERE], atol=1e-6)
    assert found.cost.tolist() == [1.0, 1.0, 1.0, 1.0]
    assert found.observation.tolist() == [0, 1, 2, 3]


def test_the_way_back_begins_before_the_first_lost_frame(subject, monkeypatch):
    _, place = followed(subject, monkeypatch, there=[2.0, 1.0, 9.0, 9.0], back=[1.0, 1.0, 0.0, 0.0], lost=(2, 3))
    np.testing.assert_allclose(place, [BACK, THERE], atol=1e-6)


def test_one_frame_alone_needs_no_tracker(subject, monkeypatch):
    _, place = followed(subject, monkeypatch, there=[2.0], back=[1.0])
    np.testing.assert_allclose(place, subject.pose[:1], atol=1e-6)


def test_a_body_that_lies_anyhow_is_as_long_as_its_longest_extent():
    def told(name: str) -> dict[str, float]:
        space = RestSpace(load_body(name))
        count = len(space.names)
        solution = SimpleNamespace(beta=np.zeros(count), cost=np.ones(1), covariance=np.zeros((count, count)))
        return clip_body.measurements(space, solution)

    hand, man = told("hand"), told("adult_man")
    assert hand["body.length"] == pytest.approx(0.212, abs=1e-3)
    assert hand["body.length.sigma"] < 0.2 * man["body.height.sigma"]  # of outlines, in proportion
    assert "body.length" not in man
