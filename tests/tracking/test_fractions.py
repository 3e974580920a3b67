"""A clip whose cameras were not triggered together is tracked as well as one whose cameras were, nearly."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.fitting.clip_body import follow
from mmocap_warp.masks.observation import Observation
from mmocap_warp.study.sequences import SEQUENCES, StudySequence
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig

EVERY = 4  # of the clip's frames is one of 15 a second
SHIFT = np.array([0, 2, -2, 1])  # of four of its cameras
FRAMES = range(4, 76, EVERY)
FPS = 60.0 / EVERY


@cache
def clip() -> StudySequence:
    """What is tracked, and some frames more for the cameras that are late."""
    return SEQUENCES["S1/Walking"].first(80)


@cache
def rig() -> CameraRig:
    return clip().rig.select(clip().rig.names[: len(SHIFT)])


@cache
def true_joints() -> np.ndarray:
    """(frame, joint, 3) of the body's joints [m]."""
    named = [clip().truth.joint_names.index(name) for name in clip().subject.body.skeleton.joints]
    return clip().truth.joints[list(FRAMES)][:, named]


def observed(late: bool) -> list[Observation]:
    """Frames whose cameras took them up to two of the clip's frames earlier or later."""
    seen = []
    for frame in FRAMES:
        taken = {shift: clip().recording.masks(frame + shift) for shift in set(SHIFT.tolist())}
        masks = [taken[int(shift)][k] for k, shift in enumerate(SHIFT)]
        seen.append(Observation.from_masks(masks, SHIFT / 60.0 if late else None))
    return seen


@pytest.fixture(scope="module")
def clips() -> dict[bool, list[Observation]]:
    ignored = observed(late=False)
    return {False: ignored, True: [replace(each, late=SHIFT / 60.0) for each in ignored]}


def start():
    moved = clip().recording.poses[FRAMES[0]] - clip().recording.poses[0]
    return replace(clip().subject, pose=clip().subject.pose + moved)


def off(pose: np.ndarray) -> float:
    """Mean distance of the joints from the true ones [m]."""
    joints = Poser(clip().subject.body, clip().subject.root_base).joint_transforms(pose)[:, :, :3, 3]
    return float(np.linalg.norm(joints - true_joints(), axis=2).mean())


def test_tracks_and_clips(clips, device):
    config = TrackConfig("contour", device=device, threads=1)
    found = {late: track_observations(start(), rig(), seen, FPS, config) for late, seen in clips.items()}
    assert off(found[True].pose[0]) < 0.75 * off(found[False].pose[0])
    assert off(found[True].raw_pose[0]) < 0.85 * off(found[False].raw_pose[0])


def test_followed_there_and_back(clips, device):
    """On the way back the frame before is the one after."""
    config = TrackConfig("contour", device=device, threads=1)
    followed = {late: follow(start(), rig(), seen, FPS, config) for late, seen in clips.items()}
    count = min(len(each.rooted) for each in followed.values())
    assert count > 15
    errors = {}
    for late, each in followed.items():
        joints = [
            Poser(clip().subject.body, base).joint_transforms(pose[None])[0, :, :3, 3]
            for base, pose in zip(each.rooted.base[:count], each.rooted.pose[:count], strict=True)
        ]
        errors[late] = float(np.linalg.norm(np.stack(joints) - true_joints()[:count], axis=2).mean())
    assert errors[True] < 0.85 * errors[False], errors
