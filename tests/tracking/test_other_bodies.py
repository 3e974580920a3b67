"""Bodies that are no people go all the way: written, fitted, tracked by every algorithm, exported, judged."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from one_frame import fit_observation
from other_bodies import arm_robot, burdened, quadruped
from random_scenes import perfect_masks
from scipy.spatial.transform import Rotation
from synthetic import ring_rig

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rotations import zyx_angles, zyx_rotation
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.fitting.subject_fit import FitConfig, fit_clip
from mmocap_warp.formats.usd.usd_body import read_body, read_subject, write_body, write_subject
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.formats.usd.usd_result import export_animation, read_result, write_result
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.truth import Truth
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig

RIG = ring_rig(cameras=4, size=(160, 120), distance=3.0)
FPS = 60.0
FRAMES = 5
BODIES = {"quadruped": quadruped, "arm": arm_robot, "burdened": burdened}


@cache
def subject_of(name: str) -> Subject:
    body = BODIES[name]()
    pose = np.zeros(body.skeleton.coordinates)
    pose[:3] = body.joint_rest[0]
    return Subject(body, np.eye(3), pose, {"source": "tests"})


@cache
def motion(name: str) -> tuple[np.ndarray, list[Observation]]:
    """Poses (frame, coordinate) that drift by about 0.03 rad a frame in all that is searched, and their masks."""
    subject = subject_of(name)
    index = subject.body.skeleton.searched()
    direction = np.random.default_rng(3).choice([-1.0, 1.0], len(index))
    poses = np.tile(subject.pose, (FRAMES, 1))
    poses[:, index] += np.where(index < 3, 0.01, 0.03) * direction * np.arange(FRAMES)[:, None]
    return poses, [Observation.from_masks(perfect_masks(subject, RIG, pose)) for pose in poses]


def corner_error(body: BodyModel, pose: np.ndarray, truth: np.ndarray) -> float:
    """Mean distance of the mesh's vertices [m]."""
    poser = Poser(body, np.eye(3))
    return float(np.linalg.norm(poser.vertices(pose) - poser.vertices(truth), axis=-1).mean())


@pytest.mark.parametrize("name", BODIES)
def test_its_usd_reads_back(name: str, tmp_path: Path) -> None:
    body = BODIES[name]()
    write_body(tmp_path / "body.usda", body)
    assert not faults(tmp_path / "body.usda")
    back = read_body(tmp_path / "body.usda").skeleton
    assert (back.joints, back.parent, back.parts, back.part, back.pairs) == (
        body.skeleton.joints, body.skeleton.parent, body.skeleton.parts, body.skeleton.part, body.skeleton.pairs
    )  # fmt: skip
    np.testing.assert_array_equal(back.searched(), body.skeleton.searched())
    np.testing.assert_array_equal(back.limits, body.skeleton.limits)
    assert back.stands
    write_body(tmp_path / "lying.usda", replace(body, skeleton=replace(body.skeleton, stands=False)))
    assert not read_body(tmp_path / "lying.usda").skeleton.stands


NO_PEOPLE = ("quadruped", "arm")
PAIRS = list(itertools.product(NO_PEOPLE, ALGORITHMS))
SAMPLE = set(zip(itertools.cycle(NO_PEOPLE), ALGORITHMS))
"""By turns one and the other, so that every algorithm follows one of them."""


@pytest.mark.parametrize(
    ("name", "algorithm"),
    [pytest.param(*pair, marks=() if pair in SAMPLE else pytest.mark.nightly) for pair in PAIRS],
)
def test_every_algorithm_follows_it(name: str, algorithm: str) -> None:
    """From its start pose, with a third of the error that standing still makes; what is not searched stays."""
    subject, (truth, seen) = subject_of(name), motion(name)
    radii = {"rotation_radius": 0.06, "translation_radius": 0.02}
    config = TrackConfig(algorithm, evaluations=2400, device="cpu", threads=1, **radii)
    result = track_observations(subject, RIG, seen, FPS, config)
    assert result.config["dof"] == len(subject.body.skeleton.searched())
    stays = corner_error(subject.body, subject.pose[None], truth[-1:])
    assert corner_error(subject.body, result.pose[0, -1:], truth[-1:]) < 0.35 * stays
    held = np.setdiff1d(np.arange(subject.body.skeleton.coordinates), subject.body.skeleton.searched())
    np.testing.assert_array_equal(result.pose[0][:, held], truth[:, held].astype(np.float32))


@pytest.mark.parametrize("name", BODIES)
def test_its_result_is_written_exported_and_judged(name: str, tmp_path: Path) -> None:
    subject, (poses, seen) = subject_of(name), motion(name)
    result = track_observations(subject, RIG, seen, FPS, TrackConfig(evaluations=120, device="cpu", threads=1))
    write_result(tmp_path / "result.usdc", result)
    np.testing.assert_array_equal(read_result(tmp_path / "result.usdc").pose, result.pose)
    export_animation(result, tmp_path / "animation.usda")
    assert not faults(tmp_path / "animation.usda")
    transforms = Poser(subject.body, subject.root_base).joint_transforms(poses)
    joints = transforms[:, :, :3, 3].astype(float)
    truth = Truth(FPS, np.arange(FRAMES), (), np.zeros((FRAMES, 0, 3)), subject.body.skeleton.joints, joints, poses)
    report = evaluate(result, truth)
    assert set(report["median_mm_by_group"]) == set(subject.body.skeleton.evaluation_groups)
    exact = evaluate(replace(result, pose=poses[None]), truth)
    assert exact["mpjpe_mm"] < 1e-3 < report["mpjpe_mm"]


def test_a_quadruped_is_fitted_from_the_masks_alone() -> None:
    """Its place, size and heading are found; it has no shape targets."""
    subject, (poses, seen) = subject_of("quadruped"), motion("quadruped")
    config = FitConfig(evaluations=600, finalists=2, device="cpu", threads=2)
    fitted = fit_observation(subject.body, RIG, seen[0], config)
    there = Poser(subject.body, subject.root_base).vertices(poses[:1])[0]
    found = Poser(fitted.body, fitted.root_base).vertices(fitted.pose)[0]
    assert np.linalg.norm(found - there, axis=-1).mean() < 0.04


def turned_about(body: BodyModel, pose: np.ndarray, seed: int = 4) -> np.ndarray:
    """A pose (coordinate,) whose root is turned any way."""
    turned = pose.copy()
    turned[ROOT_ANGLES] = zyx_angles(Rotation.random(random_state=seed).as_matrix())
    return turned


def test_a_body_that_lies_anyhow_is_found_too() -> None:
    """On its back or side, where nothing says which way is up."""
    subject, (poses, _) = subject_of("quadruped"), motion("quadruped")
    body = replace(subject.body, skeleton=replace(subject.body.skeleton, stands=False))
    pose = turned_about(body, poses[2])
    seen = Observation.from_masks(perfect_masks(subject, RIG, pose))
    fitted = fit_observation(body, RIG, seen, FitConfig(headings=4, evaluations=600, finalists=2, device="cpu"))
    there = Poser(subject.body, subject.root_base).vertices(pose[None])[0]
    found = Poser(fitted.body, fitted.root_base).vertices(fitted.pose)[0]
    assert np.linalg.norm(found - there, axis=-1).mean() < 0.04


def test_a_robot_and_where_its_base_stands_are_found_from_any_pose() -> None:
    """The base is solved for once, in all frames together, and its coordinates stay zero."""
    subject = subject_of("arm")
    body = replace(subject.body, rigid=True, skeleton=replace(subject.body.skeleton, spread=np.full(7, 1.0)))
    pose = np.tile(subject.pose, (3, 1))
    pose[:, :3] += (0.2, 0.0, -0.1)
    pose[:, body.skeleton.searched()] = [0.5, -1.1, 1.4, 0.6, 0.9, 0.3]
    pose[:, body.skeleton.searched()[1:3]] += 0.05 * np.arange(3)[:, None]
    seen = [Observation.from_masks(perfect_masks(subject, RIG, each)) for each in pose]
    fitted = fit_clip(body, RIG, FPS, seen, FitConfig(headings=4, evaluations=400, finalists=2, device="cpu"))
    assert fitted.body.skeleton.root_is_fixed
    assert not fitted.pose[ROOT_ANGLES].any()
    there = Poser(subject.body, subject.root_base).vertices(pose[:1])[0]
    found = Poser(fitted.body, fitted.root_base).vertices(fitted.pose)[0]
    assert np.linalg.norm(found - there, axis=-1).mean() < 0.01


def test_a_start_pose_is_taken_from_where_the_body_usually_is_not() -> None:
    """Folded legs: poses that are given are turned to all headings, and the best are fitted."""
    subject = subject_of("quadruped")
    pose = subject.pose.copy()
    knees = [subject.body.skeleton.angles(f"{leg}Knee").start for leg in ("LFore", "RFore", "LHind", "RHind")]
    pose[knees] = 1.1
    pose[ROOT_ANGLES] = (0.0, 2.0, 0.0)
    seen = Observation.from_masks(perfect_masks(subject, RIG, pose))
    given = np.where(np.isin(np.arange(len(pose)), knees), 1.0, 0.0)[None]
    config = FitConfig(headings=2, evaluations=200, finalists=1, device="cpu")
    fitted = fit_observation(subject.body, RIG, seen, config, start_poses=given)
    there = Poser(subject.body, subject.root_base).vertices(pose[None])[0]
    found = Poser(fitted.body, fitted.root_base).vertices(fitted.pose)[0]
    assert np.linalg.norm(found - there, axis=-1).mean() < 0.04


def anywhere(tracker: ContourTracker, observation: Observation) -> np.ndarray:
    """(run, start, coordinate) where a tracker looks for a body that it lost."""
    return tracker._starts.anywhere(tracker.state.pose, tracker.state.counter, observation)


def test_a_lost_arm_is_looked_for_where_its_base_stands() -> None:
    subject, (_, seen) = subject_of("arm"), motion("arm")
    tracker = ContourTracker(subject, RIG, TrackConfig(device="cpu", threads=1), FPS)
    starts = anywhere(tracker, seen[0])
    skeleton = subject.body.skeleton
    bent = skeleton.searched()
    held = np.setdiff1d(np.arange(skeleton.coordinates), bent)
    np.testing.assert_array_equal(
        starts[..., held], np.broadcast_to(subject.pose[held].astype(np.float32), starts[..., held].shape)
    )
    assert np.ptp(starts[0][:, bent], axis=0).min() > 2.5  # of limits 4 rad apart


def test_a_lost_body_that_lies_anyhow_is_turned_any_way() -> None:
    subject, (_, seen) = subject_of("quadruped"), motion("quadruped")
    lying = replace(subject, body=replace(subject.body, skeleton=replace(subject.body.skeleton, stands=False)))
    tracker = ContourTracker(lying, RIG, TrackConfig(device="cpu", threads=1), FPS)
    up = zyx_rotation(anywhere(tracker, seen[0])[0][:, ROOT_ANGLES].astype(float))[..., 1]
    assert (up @ (0.0, 1.0, 0.0)).min() < -0.8
    standing = ContourTracker(subject, RIG, TrackConfig(device="cpu", threads=1), FPS)
    up = zyx_rotation(anywhere(standing, seen[0])[0][:, ROOT_ANGLES].astype(float))[..., 1]
    np.testing.assert_allclose(up @ (0.0, 1.0, 0.0), 1.0, atol=1e-5)


@pytest.mark.parametrize("said_by", ["body", "setting"])
def test_of_a_rigid_body_the_pose_alone_is_found(said_by: str, tmp_path: Path) -> None:
    subject, (poses, seen) = subject_of("quadruped"), motion("quadruped")
    body = replace(subject.body, rigid=said_by == "body")
    config = FitConfig(
        evaluations=600, finalists=2, device="cpu", threads=2, rigid=True if said_by == "setting" else None
    )
    fitted = fit_clip(body, RIG, FPS, seen, config)
    np.testing.assert_array_equal(fitted.body.skin.rest, body.skin.rest)
    np.testing.assert_array_equal(fitted.body.joint_rest, body.joint_rest)
    assert not [name for name in fitted.provenance if name.startswith(("shape.", "body.bone."))]
    assert fitted.provenance["body.height.sigma"] == 0
    there = Poser(body, subject.root_base).vertices(poses[:1])[0]
    found = Poser(fitted.body, fitted.root_base).vertices(fitted.pose)[0]
    assert np.linalg.norm(found - there, axis=-1).mean() < 0.01
    write_subject(tmp_path / "dog.usda", fitted)
    assert read_subject(tmp_path / "dog.usda").body.rigid
