"""Joint limits: mirror images of each other, wide enough for every pose within the clinical ranges, and hardly wider.

A clinical pose of a ball joint is a plane or order of movements with a twist, not our three Euler angles. The tests
sample clinical poses, turn them into Euler angles from each shipped body's zero pose and ask that one of the two
solutions lies within the limits; and that of some pose none would if any limit were tighter.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from make_body import joint_limits
from person_skeleton import JOINTS
from reference import rotation

from mmocap_warp.body.model import BodyModel
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.scenes import ROOT

DOWN = np.array([0.0, -1.0, 0.0])
FORWARD = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module", params=["adult_man", "adult_woman", "tall_slim_adult"])
def body(request: pytest.FixtureRequest) -> BodyModel:
    return read_body(Path(ROOT) / "bodies" / f"{request.param}.usdc")


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' rotation about a unit axis."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def swing(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The shortest rotation that takes direction a to direction b."""
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    return about(axis / sine, np.arctan2(sine, a @ b)) if sine > 1e-9 else np.eye(3)


def euler_solutions(turn: np.ndarray) -> np.ndarray:
    """Both (solution, axis) sets of angles with ``turn = Rz Ry Rx``, each within plus and minus 180 degrees."""
    y = np.arcsin(np.clip(-turn[2, 0], -1, 1))
    x, z = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    solutions = np.array([[x, y, z], [x + np.pi, np.pi - y, z + np.pi]])
    return (solutions + np.pi) % (2 * np.pi) - np.pi


def within(solutions: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Whether one of the solutions (pose, solution, axis) of each pose lies within limits (axis, 2)."""
    return ((solutions >= limits[:, 0]) & (solutions <= limits[:, 1])).all(axis=2).any(axis=1)


def degrees(start: float, stop: float, count: int) -> np.ndarray:
    return np.radians(np.linspace(start, stop, count))


def shoulder_poses():
    """Direction of the left upper arm and the direction in which its forearm flexes."""
    for plane in np.linspace(-90, 130, 23):  # 0 sideways, 90 forward
        highest = 60 + 0.8 * (plane + 90) if plane < 0 else 180 if plane <= 100 else 120
        for elevation in np.linspace(0, highest, 13):
            p, e = np.radians([plane, elevation])
            arm = np.array([np.sin(e) * np.cos(p), -np.cos(e), np.sin(e) * np.sin(p)])
            twists = (-80, 90) if elevation <= 100 else (-45, 60)
            for twist in degrees(*twists, 8):
                yield arm, about(arm, -twist) @ swing(DOWN, arm) @ FORWARD


def shoulder_turns(body: BodyModel) -> list[np.ndarray]:
    frame = body.skeleton.frame[JOINTS.index("LShoulder")]
    return [frame.T @ np.stack([arm, np.cross(flexing, arm), flexing], axis=1) for arm, flexing in shoulder_poses()]


def hip_turns(body: BodyModel) -> list[np.ndarray]:
    """Flexion about the pelvis, then abduction, then rotation about the thigh (Grood and Suntay's order)."""
    hip, knee = body.joint_rest[[JOINTS.index("LHip"), JOINTS.index("LKnee")]]
    rest = swing(DOWN, (knee - hip) / np.linalg.norm(knee - hip))
    ranges = degrees(-30, 120, 11), degrees(-30, 45, 6), degrees(-45, 45, 7)
    return [rotation(0, -x) @ rotation(2, z) @ rotation(1, y) @ rest.T for x, z, y in product(*ranges)]


def bent(bend: tuple[int, int], side: int, twist: int) -> list[np.ndarray]:
    """Side bend and rotation are coupled: nobody has both in full."""
    ranges = degrees(*bend, 7), degrees(-side, side, 5), degrees(-twist, twist, 5)
    return [
        rotation(1, y) @ rotation(2, z) @ rotation(0, x)
        for x, z, y in product(*ranges)
        if np.abs([z / np.radians(side), y / np.radians(twist)]).sum() <= 1
    ]


CLINICAL = {
    "LShoulder": shoulder_turns,
    "LHip": hip_turns,
    "Neck": lambda body: bent((-60, 50), 45, 70),
    "BottomSpine": lambda body: bent((-30, 70), 30, 30),
    "UpperSpine": lambda body: bent((-25, 50), 30, 35),
    "LAnkle": lambda body: bent((-30, 50), 30, 30),
}
TIGHT = {  # no limit about x, y, z has more to spare [degrees]
    "LShoulder": (7, 45, 83),
    "LHip": (14, 26, 26),
    "Neck": (6, 16, 17),
    "BottomSpine": (8, 17, 17),
    "UpperSpine": (17, 17, 17),
    "LAnkle": (13, 17, 17),
}


@pytest.mark.parametrize("joint", CLINICAL)
def test_limits_hold_every_clinical_pose_and_hardly_more(body: BodyModel, joint: str) -> None:
    turns = CLINICAL[joint](body)
    solutions = np.stack([euler_solutions(turn) for turn in turns])
    limits = body.skeleton.limits[JOINTS.index(joint)].astype(float)
    reached = within(solutions, limits)
    assert reached.all(), turns[int(reached.argmin())]
    for axis, end in product(range(3), range(2)):
        tighter = limits.copy()
        tighter[axis, end] += (1 - 2 * end) * np.radians(TIGHT[joint][axis])
        assert not within(solutions, tighter).all(), (axis, end)


def test_limits_mirror(body: BodyModel) -> None:
    for left, name in enumerate(JOINTS):
        if name.startswith("R") and name != "Root":
            continue
        right = JOINTS.index("R" + name[1:]) if name.startswith("L") else left  # the middle mirrors itself
        mirrored = body.skeleton.limits[left].copy()
        mirrored[1:] = -mirrored[1:, ::-1]
        np.testing.assert_array_equal(body.skeleton.limits[right], mirrored)


def test_shipped_bodies_have_the_limits_that_are_made_now(body: BodyModel) -> None:
    """Of all joints but elbows and knees, whose limits count from how far each body's rest bends them."""
    for j, name in enumerate(JOINTS):
        if name[1:] not in ("Elbow", "Knee"):
            np.testing.assert_array_equal(body.skeleton.limits[j], joint_limits(0.0, 0.0)[j], err_msg=name)


def test_zero_pose_is_within_the_limits_and_the_root_is_free(body: BodyModel) -> None:
    assert (body.skeleton.limits[..., 0] < 0).all()
    assert (body.skeleton.limits[..., 1] > 0).all()
    assert np.isinf(body.skeleton.limits[0]).all()
    assert np.isfinite(body.skeleton.limits[1:]).all()


def test_hinges_count_from_the_bent_rest() -> None:
    limits = np.degrees(joint_limits(elbow_flexion=np.radians(45), knee_flexion=np.radians(5)))
    np.testing.assert_allclose(limits[JOINTS.index("LElbow"), 1], [-105, 55], atol=1e-4)
    np.testing.assert_allclose(limits[JOINTS.index("RElbow"), 1], [-55, 105], atol=1e-4)
    np.testing.assert_allclose(limits[JOINTS.index("RKnee"), 0], [-15, 145], atol=1e-4)


def test_wrists_flex_about_either_axis_and_hardly_further() -> None:
    wrist = np.degrees(joint_limits(0.0, 0.0)[JOINTS.index("LWrist")])
    assert (np.abs(wrist[1:]) >= 80).all()  # flexion
    assert (np.abs(wrist[1:]) <= 90).all()
