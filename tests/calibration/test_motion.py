"""A motion between its frames is where it would be, and its velocity is what steps have to make of it."""

from __future__ import annotations

import numpy as np
from planted import swung
from synthetic import synthetic_body

from mmocap_warp.body.rotations import turn
from mmocap_warp.calibration.adjust.footage import Motion
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.rooted import Rooting

BODY = synthetic_body()
FPS = 60.0
SEARCHED = BODY.skeleton.searched()
ROOTING = Rooting(BODY.skeleton, turn("y", 0.4) @ turn("x", 0.9), SEARCHED)
POINTS = MotionPoints(BODY.skeleton, BODY.joint_rest.astype(float), SEARCHED)


def motion() -> Motion:
    poses = swung(BODY, 30, FPS)
    poses[:, 4] += np.linspace(0, 2.0, 30)  # turning round
    return Motion(ROOTING, ROOTING.enter(poses), FPS)


def test_whole_frames_are_the_poses_and_halves_lie_between():
    clip = motion()
    np.testing.assert_allclose(
        POINTS.at(clip.at(np.array([3.0, 7.0]))), POINTS.at(clip.rooted[np.array([3, 7])]), atol=1e-9
    )
    middle = POINTS.at(clip.at(np.array([5.5])))
    ends = POINTS.at(clip.rooted[np.array([5, 6])])
    assert np.abs(middle - ends.mean(axis=0)).max() < 2e-3


def test_beyond_its_ends_it_stands_still():
    clip = motion()
    np.testing.assert_allclose(clip.at(np.array([-2.0, 99.0])).pose, clip.rooted.pose[[0, -1]])


def test_a_step_by_the_velocity_leads_to_the_next_frame():
    clip = motion()
    frames = np.arange(2, 28)
    there = ROOTING.stepped(clip.rooted[frames], clip.velocity(frames) / FPS)
    error = np.linalg.norm(POINTS.at(there) - POINTS.at(clip.rooted[frames + 1]), axis=-1)
    moved = np.linalg.norm(POINTS.at(clip.rooted[frames]) - POINTS.at(clip.rooted[frames + 1]), axis=-1)
    assert error.max() < 0.25 * moved.max()
