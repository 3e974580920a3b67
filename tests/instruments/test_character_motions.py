"""Motions that the project wrote for its characters: within their limits, and feet that stand still."""

from __future__ import annotations

import numpy as np
import pytest
from character_motions import MOTIONS
from least_jerk import through_poses

from mmocap_warp.body.model import BodyModel
from mmocap_warp.formats.usd.usd_body import read_motions
from mmocap_warp.rigging.shipped import body_file, load_body
from mmocap_warp.synthesis.exact_posing import ExactPoser

MOST_SLIDE = 1e-3  # [m] between two frames, of a foot that stands
STANDS = 0.005  # as low as that over the floor [m]


@pytest.mark.parametrize("name", MOTIONS)
def test_shipped_motions_are_those_of_the_code_and_keep_the_limits(name: str) -> None:
    body = load_body(name)
    shipped, made = read_motions(body_file(name)), MOTIONS[name](body)
    assert list(shipped) == list(made)
    searched = body.skeleton.searched()
    low, high = body.skeleton.coordinate_limits.T
    for label, motion in made.items():
        np.testing.assert_allclose(shipped[label].pose, motion.pose, atol=1e-6)
        assert (motion.pose >= low - 1e-6)[:, searched].all()
        assert (motion.pose <= high + 1e-6)[:, searched].all()
        held = np.delete(motion.pose, searched, axis=1)
        np.testing.assert_array_equal(held, 0.0)


def test_anymal_trots_on_two_diagonal_feet_that_do_not_slide() -> None:
    robot = load_body("anymal")
    motion = MOTIONS["anymal"](robot)["Trot"]
    feet = np.stack([_foot(robot, motion.pose, f"{leg}_KFE") for leg in ("LF", "RF", "LH", "RH")])
    floor = feet[..., 1].min()
    stands = feet[..., 1] < floor + STANDS  # (foot, frame)
    assert (stands.sum(axis=0) >= 2).all()
    for one, other in ((0, 3), (1, 2)):
        np.testing.assert_array_equal(stands[one], stands[other])
    slide = np.linalg.norm(np.diff(feet, axis=1), axis=2)[stands[:, 1:] & stands[:, :-1]]
    # a shank rolls over its round foot: the lowest part of it moves a little
    assert np.median(slide) < MOST_SLIDE
    assert motion.pose[-1, 2] - motion.pose[0, 2] == pytest.approx(0.4 * 1.4 * 1.5)


def _foot(robot: BodyModel, pose: np.ndarray, shank: str) -> np.ndarray:
    """(frame, 3), the middle of what is a shank's foot in the bind pose."""
    own = robot.skin.heaviest_joint == robot.skeleton.index(shank)
    low = own & (robot.skin.rest[:, 1] < robot.skin.rest[own, 1].min() + 0.02)
    return np.stack([place[low].mean(axis=0) for place in ExactPoser(robot, np.eye(3)).vertices(pose)])


def test_a_motion_rests_in_its_key_poses() -> None:
    hand = load_body("hand").skeleton
    bent = hand.coordinate_names.index("index_finger_phalanx_distal.Rx")
    keys = ((0.0, {"Ty": 0.1}), (0.5, {"index_finger_phalanx_distal.Rx": 30.0}), (1.0, {"Ty": 0.0}))
    pose = through_poses(hand, keys, 20.0).pose
    assert len(pose) == 21
    np.testing.assert_allclose(np.degrees(pose[[0, 5, 10, 20], bent]), (0, 15, 30, 30), atol=1e-9)
    np.testing.assert_allclose(pose[[0, 10, 15, 20], 1], (0.1, 0.1, 0.05, 0.0), atol=1e-12)
    with pytest.raises(ValueError, match="ascending"):
        through_poses(hand, ((0.0, {}), (0.0, {})), 20.0)
    with pytest.raises(ValueError, match="elbow"):
        through_poses(hand, ((0.0, {"elbow.Rx": 1.0}),), 20.0)
