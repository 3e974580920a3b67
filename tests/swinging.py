"""A figure whose joints swing back and forth, and rough tracks of it that are to be smoothed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from random_scenes import perfect_masks
from synthetic import SKELETON, ring_rig, synthetic_subject

from mmocap_warp.body.posing import joint_positions
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, FrameAnswer, Result
from mmocap_warp.tracking.frame_loop import collect
from mmocap_warp.tracking.track_config import TrackConfig

RIG = ring_rig(cameras=4, size=(240, 180))
SUBJECT = synthetic_subject()
FPS = 60.0
FRAMES = 24
NOISE = 0.03  # of the track's angles [rad]
CONFIG = TrackConfig(device="cpu", threads=1, smooth=10.8)


@cache
def swinging() -> tuple[np.ndarray, list[Observation]]:
    """Poses (frame, coordinate) of joints that swing back and forth, and what is seen of them."""
    time = np.arange(FRAMES)[:, None] / FPS
    index = SKELETON.searched()
    rng = np.random.default_rng(2)
    truth = np.tile(SUBJECT.pose, (FRAMES, 1))
    swing = np.where(index < 3, 0.03, 0.15) * np.sin(2 * np.pi * time + rng.uniform(0, 2 * np.pi, len(index)))
    limits = SKELETON.coordinate_limits[index]
    truth[:, index] = np.clip(truth[:, index] + swing, *limits.T)
    return truth, [Observation.from_masks(list(perfect_masks(SUBJECT, RIG, pose))) for pose in truth]


def rough_track(runs: int = 1, lost: tuple[int, ...] = (), config: TrackConfig = CONFIG) -> Result:
    """A track that errs by noise, with the last pose carried over in the frames that are ``lost``."""
    truth, _ = swinging()
    index = SKELETON.searched()
    pose = np.repeat(truth[:, None], runs, axis=1)
    pose[..., index] += np.random.default_rng(1).normal(0, NOISE, (FRAMES, runs, len(index)))
    answers = []
    for frame in range(FRAMES):
        if frame in lost and frame:
            pose[frame] = pose[frame - 1]
        iou = np.full((runs, len(RIG)), np.nan if frame in lost else 0.5)
        status = STATUS.index("lost" if frame in lost else "tracked")
        answers.append(FrameAnswer(pose[frame], np.zeros(runs), iou, 1, status, 0.0))
    return collect(SUBJECT, RIG, FPS, replace(config, runs=runs), answers)


def joint_errors(pose: np.ndarray) -> np.ndarray:
    """(frame, joint) [m]"""
    truth, _ = swinging()
    return np.linalg.norm(joint_positions(SUBJECT, pose) - joint_positions(SUBJECT, truth), axis=-1)


def hidden(seen: list[Observation], lost: tuple[int, ...]) -> list[Observation]:
    """The observations, with nothing in some frames."""
    empty = [np.zeros((height, width), bool) for width, height in RIG.size]
    return [Observation.from_masks(empty) if frame in lost else each for frame, each in enumerate(seen)]
