"""A short made-up motion, tracked."""

from __future__ import annotations

from functools import cache

import numpy as np
from random_scenes import perfect_masks
from synthetic import SKELETON, ring_rig, synthetic_poses, synthetic_subject

from mmocap_warp.body.posing import Poser
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import Result
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker

RIG = ring_rig(cameras=4, size=(160, 120))  # a pixel is 25 mm wide
FPS = 60.0
FRAMES = 15
TRACKED = 1 / 3  # of what standing still errs by


@cache
def motion(device: str) -> tuple[np.ndarray, list[Observation]]:
    """Poses (frame, 51) in which every searched angle moves by about 0.02 rad a frame, and what is seen of them."""
    subject, index = synthetic_subject(), SKELETON.searched(39)
    truth = np.tile(subject.pose, (FRAMES, 1))
    truth[:, index] = synthetic_poses(120)[:FRAMES, index]
    return truth, [Observation.from_masks(list(perfect_masks(subject, RIG, pose, device))) for pose in truth]


def track_motion(algorithm: str, device: str, frames: int = 6, **settings: int) -> tuple[Result, np.ndarray]:
    """The result, and each run's mean distance of the markers over the first frames (run,) [m]."""
    truth, seen = (values[:frames] for values in motion(device))
    result = track_observations(synthetic_subject(), RIG, seen, FPS, TrackConfig(algorithm, device=device, **settings))
    return result, np.array([marker_errors(pose, truth).mean() for pose in result.pose])


def standing_still(frames: int = 6) -> float:
    """What a tracker that never moves errs by over the first frames, mean distance of the markers [m]."""
    truth = motion("cpu")[0][:frames]
    return float(marker_errors(np.tile(truth[0], (frames, 1)), truth).mean())


def marker_errors(poses: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Mean distance of the markers in each frame (frame,) [m]."""
    subject = synthetic_subject()
    poser, marker = Poser(subject.body, subject.root_base), subject.body.marker_vertex
    return np.linalg.norm(poser.vertices(poses)[:, marker] - poser.vertices(truth)[:, marker], axis=-1).mean(axis=1)


def tracker_of(algorithm: str, device: str, **settings: int) -> tuple[Tracker, list[int]]:
    """A tracker at the motion's start, and the list of how many candidates each call of its objective will judge."""
    tracker = Tracker(synthetic_subject(), RIG, TrackConfig(algorithm, device=device, threads=1, **settings), FPS)
    calls, evaluate = [], tracker.search.objective.evaluate

    def counted(candidates):
        calls.append(candidates)
        return evaluate(candidates)

    tracker.search.objective.evaluate = counted
    return tracker, calls
