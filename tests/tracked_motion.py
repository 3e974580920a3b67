"""A short made-up motion, tracked."""

from __future__ import annotations

from functools import cache

import numpy as np
from random_scenes import perfect_masks
from synthetic import SKELETON, ring_rig, synthetic_poses, synthetic_subject

from mmocap_warp.body.posing import Poser
from mmocap_warp.result.result import Result
from mmocap_warp.tracking.config import TrackConfig
from mmocap_warp.tracking.track import track_observations
from mmocap_warp.tracking.tracker import Tracker
from mmocap_warp.views.observation import Observation

RIG = ring_rig(cameras=4, size=(160, 120))  # a pixel is 25 mm wide
FPS = 60.0


@cache
def motion(device: str) -> tuple[np.ndarray, list[Observation]]:
    """Poses (frame, 51) in which every searched angle moves by about 0.02 rad a frame, and what is seen of them."""
    subject, index = synthetic_subject(), SKELETON.searched(39)
    truth = np.tile(subject.pose, (6, 1))
    truth[:, index] = synthetic_poses(120)[:6, index]
    return truth, [Observation.from_masks(list(perfect_masks(subject, RIG, pose, device))) for pose in truth]


def track_motion(algorithm: str, device: str, frames: int = 6, **settings: int) -> tuple[Result, np.ndarray]:
    """The result, and each run's mean distance of the markers over the first frames (run,) [m]."""
    subject = synthetic_subject()
    truth, seen = (values[:frames] for values in motion(device))
    result = track_observations(subject, RIG, seen, FPS, TrackConfig(algorithm, device=device, **settings))
    poser, marker = Poser(subject.body, subject.root_base), subject.body.marker_vertex
    there = poser.vertices(truth)[:, marker]
    errors = [np.linalg.norm(poser.vertices(pose)[:, marker] - there, axis=-1).mean() for pose in result.pose]
    return result, np.array(errors)


def tracker_of(algorithm: str, device: str, **settings: int) -> tuple[Tracker, list[int]]:
    """A tracker at the motion's start, and the list of how many candidates each call of its objective will judge."""
    tracker = Tracker(synthetic_subject(), RIG, TrackConfig(algorithm, device=device, threads=1, **settings), FPS)
    calls, evaluate = [], tracker._objective.evaluate

    def counted(candidates):
        calls.append(candidates)
        return evaluate(candidates)

    tracker._objective.evaluate = counted
    return tracker, calls
