"""HumanEva's fifteen joints: by hand on a figure whose arms hang straight, and against the figure that moved."""

from __future__ import annotations

import humaneva_writer as made
import numpy as np
import pytest
from person_skeleton import JOINTS
from scipy.spatial.transform import Rotation, Slerp
from synthetic import SKELETON

from mmocap_warp.body.posing import Poser
from mmocap_warp.formats.humaneva.vicon_points import (
    JOINT_NAMES,
    MissingPointError,
    joint_positions,
    torso_radius,
)
from mmocap_warp.formats.motion.captured_points import PointTracks
from mmocap_warp.study.metrics import TRUNK

Measures = tuple[float, tuple[float, float]]  # the torso's radius, and the shoulders' offsets [m]
NO_MEASURES: Measures = (0.0, (0.0, 0.0))
EXACT = 1e-9  # [m]
SINGLE = 2e-6  # [m] poses are posed in single precision
SWING = 3e-4  # [m] what swings is not on the straight line between two frames of the motion capture
SLERP = 1e-4  # [m] at the head's top


def tracks(points: dict[str, np.ndarray]) -> PointTracks:
    """Points (frame, 3) by name."""
    positions = np.stack(list(points.values()), axis=1)
    return PointTracks(120.0, np.arange(len(positions)), tuple(points), positions)


def standing() -> dict[str, np.ndarray]:
    """Two equal frames of a figure that faces +x with its left at +y, arms and legs straight down [m]."""
    origin = {"PEL": (0.1, 0, 1.0), "TRX": (0.1, 0, 1.5), "HED": (0.05, 0, 1.7)}
    for side, y in (("L", 0.2), ("R", -0.2)):
        origin |= {f"{side}CL": (0, y, 1.4), f"{side}HU": (0, y, 1.1), f"{side}RA": (0, y, 0.85)}
        origin |= {f"{side}FE": (0, y / 2, 0.5), f"{side}TI": (0, y / 2, 0.1)}
    length = {"FE": 0.4, "TI": 0.4, "HU": 0.3, "RA": 0.25}
    points = {}
    for name, place in origin.items():
        ends = np.array([(0, 0, 0), (0, 0, length.get(name[1:], 0.2)), (0.1, 0, 0), (0, 0.1, 0)])
        points |= {name + letter: place + end for letter, end in zip("OPAL", ends, strict=True)}
    return {name: np.tile(place, (2, 1)) for name, place in points.items()}


def joints_of(points: dict[str, np.ndarray], measures: Measures, position: float = 0.5) -> dict[str, np.ndarray]:
    found = joint_positions(tracks(points), np.array([position]), *measures)[0]
    return dict(zip(JOINT_NAMES, found, strict=True))


def test_the_names_are_the_ones_that_results_are_judged_by():
    assert sorted(JOINT_NAMES) == sorted(
        (*TRUNK, *(name for pair in SKELETON.evaluation_groups.values() for name in pair))
    )


def test_a_straight_figure_by_hand():
    """Offsets of 80 and 0 mm: the left elbow goes back by 0.3 sin(atan(0.04 / 0.3)) and up by the rest of the arc."""
    joints = joints_of(standing(), (0.18, (0.08, 0.0)))
    angle, lean = np.arctan2(0.04, 0.3), np.arctan2(0.09, 0.5)
    elbow = np.array([-0.3 * np.sin(angle), 0.2, 1.4 - 0.3 * np.cos(angle)])
    known = {
        "Root": (0.05, 0, 1.0),
        "Neck": np.mean([(0.05 - 0.5 * np.sin(lean), 0, 1.0 + 0.5 * np.cos(lean)), (0.1, 0, 1.5)], axis=0),
        "HeadTop": (0.1, 0, 1.816103),
        "LShoulder": (0, 0.2, 1.4),
        "LElbow": elbow,
        "LWrist": elbow + 0.25 * np.array([np.sin(angle), 0, -np.cos(angle)]),
        "RElbow": (0, -0.2, 1.1),
        "RWrist": (0, -0.2, 0.85),
        "LHip": (0, 0.1, 0.9),
        "RKnee": (0, -0.1, 0.5),
        "RAnkle": (0, -0.1, 0.1),
    }
    for name, place in known.items():
        assert np.abs(joints[name] - place).max() < EXACT, name


def test_an_elbow_off_the_upper_arms_axis_is_the_mean_of_both_limbs_ends():
    """The humerus's axis misses the shoulder by 20 mm: without an offset, the ends are 20 mm apart."""
    points = standing()
    for letter in "OPAL":
        points[f"LHU{letter}"] = points[f"LHU{letter}"] + (0, 0.02, 0)
    joints = joints_of(points, NO_MEASURES)
    length = np.hypot(0.3, 0.02)
    assert np.abs(joints["LElbow"] - [0, 0.21, (1.4 - length + 1.1) / 2]).max() < EXACT


def test_without_measures_limbs_have_the_joints_of_the_figure_that_moved():
    position = np.arange(10.0, 40.0)
    captured = tracks(made.captured_points(np.arange(1, made.MOCAP_FRAMES + 1)))
    joints = joint_positions(captured, position - 1, *NO_MEASURES)
    poser = Poser(made.subject().body, made.subject().root_base)
    known = poser.joint_transforms(made.poses_at(position))[:, :, :3, 3]
    for i, name in enumerate(JOINT_NAMES):
        if name[1:] in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle"):
            assert np.abs(joints[:, i] - known[:, JOINTS.index(name)]).max() < SINGLE, name


def test_between_frames_joints_are_between():
    position = np.arange(10.25, 40.0)
    captured = tracks(made.captured_points(np.arange(1, made.MOCAP_FRAMES + 1)))
    finer = tracks(made.captured_points(position))
    measures = (0.18, (0.04, 0.044))
    joints = joint_positions(captured, position - 1, *measures)
    known = joint_positions(finer, np.arange(len(position), dtype=float), *measures)
    assert np.abs(joints - known).max() < SWING


def test_orientations_between_frames_are_nearly_those_on_the_sphere():
    """A head that turns by 0.1 rad in a frame of the motion capture, as fast as a boxer's arm."""
    points = standing()
    axis = np.array([0.6, 0.7, 0.2]) / np.linalg.norm([0.6, 0.7, 0.2])
    turns = Rotation.from_rotvec([np.zeros(3), 0.1 * axis])
    for letter, end in zip("PAL", 0.1 * np.eye(3)[[2, 0, 1]], strict=True):
        points[f"HED{letter}"] = points["HEDO"] + turns.apply(end)
    for share in (0.25, 0.5, 0.9):
        top = joints_of(points, NO_MEASURES, share)["HeadTop"]
        known = points["TRXO"][0] + Slerp([0, 1], turns)(share).apply([0, 0, 0.316103])
        assert np.abs(top - known).max() < SLERP


def test_a_lost_point_takes_its_joints_away_and_no_others():
    points = standing()
    points["LRAO"][1] = np.nan
    joints = joints_of(points, NO_MEASURES)
    assert np.isnan(joints["LWrist"]).all()
    assert all(np.isfinite(place).all() for name, place in joints.items() if name != "LWrist")


def test_beyond_the_ends_nothing_is_known():
    for position in (-0.5, 1.5):
        assert np.isnan(joint_positions(tracks(standing()), np.array([position]), *NO_MEASURES)).all()


def test_the_torsos_radius_is_half_the_shoulders_less_a_markers_radius():
    shoulders = {"LSHO": np.array([[0, 0.2, 1.4], [np.nan] * 3]), "RSHO": np.array([[0, -0.2, 1.4], [0, -9, 0]])}
    assert torso_radius(tracks(shoulders)) == pytest.approx(0.193)


def test_a_missing_point_is_named():
    points = standing()
    del points["RTIO"]
    with pytest.raises(MissingPointError, match="has no RTIO"):
        joints_of(points, NO_MEASURES)
