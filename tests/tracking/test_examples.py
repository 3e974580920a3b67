"""A hand and robots are tracked as people are: shipped characters, motions of this project, made masks with faults."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.formats.usd.usd_body import read_body, read_motions
from mmocap_warp.rigging.shipped import body_file
from mmocap_warp.synthesis.any_body import recorded
from mmocap_warp.synthesis.footage.made_recording import Recording
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.track_config import TrackConfig

HAND = 0.212  # [m], from the wrist's cut to the longest finger's tip


def tracked(name: str, motion: str, cameras: int, first: int, frames: int) -> tuple[Recording, np.ndarray]:
    """A recording of some frames of a motion, and its poses (frame, coordinate) as the tracker finds them."""
    body, whole = read_body(body_file(name)), read_motions(body_file(name))[motion]
    recording = recorded(body, replace(whole, pose=whole.pose[first : first + frames]), cameras)
    subject = Subject(body, recording.root_base, recording.poses[0], {})
    tracker = ContourTracker(subject, recording.rig, TrackConfig(algorithm="contour", threads=1), recording.fps)
    return recording, np.stack([tracker.step(recording.observation(frame)).pose[0] for frame in range(frames)])


def test_a_hand_that_opens_before_four_cameras() -> None:
    recording, pose = tracked("hand", "Opening", 4, 38, 10)  # out of the fist
    place = Poser(recording.body, recording.root_base).joint_transforms(pose)[:, :, :3, 3]
    tips = [number for number, name in enumerate(recording.body.skeleton.joints) if name.endswith("_tip")]
    apart = np.linalg.norm(place - recording.truth().joints, axis=2)[:, tips]
    assert len(tips) == 5
    assert apart.mean() < 0.03 * HAND  # measured: 0.013


@pytest.mark.parametrize(
    ("name", "motion", "cameras"), [pytest.param("anymal", "Trot", 6, marks=pytest.mark.nightly), ("panda", "Pick", 4)]
)
def test_angles_of_robots(name: str, motion: str, cameras: int) -> None:
    recording, pose = tracked(name, motion, cameras, 10, 8)
    searched = recording.body.skeleton.searched()
    angles = searched[searched >= ROOT_ANGLES.stop]
    off = np.degrees(np.abs(pose[:, angles] - recording.poses[:, angles]))
    assert np.median(off) < 1.0  # measured: 0.3
