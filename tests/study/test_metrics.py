import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from person_skeleton import JOINTS
from synthetic import SKELETON, ring_rig, synthetic_poses, synthetic_result, synthetic_subject

from mmocap_warp.body.posing import Poser
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.pose_errors import HEAD_TOP, aligned_error, head_top
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.study.metrics import TRUNK, foot_slide, jerk, measure

SINGLE_PRECISION = 2e-6  # [m]


def still_result(pose, frame_numbers=None, fps=50.0):
    """A result of the given poses (run, frame, 51)."""
    runs, frames, _ = pose.shape
    numbers = np.arange(frames) if frame_numbers is None else frame_numbers
    return Result(
        subject=synthetic_subject(),
        cameras=ring_rig(2, size=(320, 240)),
        fps=fps,
        frame_numbers=numbers,
        pose=pose.copy(),
        cost=np.zeros((runs, frames)),
        iou=np.full((runs, frames, 2), 0.9),
        evaluations=np.full((runs, frames), 500),
        status=np.zeros((runs, frames), np.int8),
        seconds=2.0,
        config={},
        versions={},
    )


def truth_of(result, pose):
    """What perfect markers, joints and the head's top would say of a body that moved through ``pose`` (frame, 51)."""
    body = result.subject.body
    poser = Poser(body, result.subject.root_base)
    vertices = poser.vertices(pose).astype(float)
    top = vertices[:, [head_top(body)]]
    return Truth(
        fps=result.fps,
        frame_numbers=result.frame_numbers,
        marker_names=body.marker_names,
        markers=vertices[:, body.marker_vertex],
        joint_names=(*JOINTS, HEAD_TOP),
        joints=np.concatenate([poser.joint_transforms(pose)[:, :, :3, 3].astype(float), top], axis=1),
        pose=pose.copy(),
        root_base=result.subject.root_base,
    )


def test_a_shifted_body_is_off_by_the_shift():
    """By a 3-4-5 triangle of 50 mm from the second frame on; alignment takes it out."""
    pose = np.repeat(synthetic_poses(8)[None], 3, axis=0)
    truth = truth_of(still_result(pose), pose[0])
    pose[:, 1:, :3] += [0.03, 0.0, 0.04]
    per_frame, per_run = measure(still_result(pose), truth)
    for name in ("eq20_as_printed", "marker_error", "joint_error", "mpjpe"):
        assert per_frame[name].shape == (3, 8)
        np.testing.assert_allclose(per_frame[name][:, 0], 0.0, rtol=0, atol=SINGLE_PRECISION)
        np.testing.assert_allclose(per_frame[name][:, 1:], 0.05, rtol=0, atol=SINGLE_PRECISION)
    np.testing.assert_allclose(per_frame["pa_mpjpe"], 0.0, rtol=0, atol=SINGLE_PRECISION)
    for name in ("eq20_as_printed_floor", "marker_error_floor", "eq20_as_printed_left_out"):
        np.testing.assert_allclose(per_run[name], np.zeros(3), rtol=0, atol=SINGLE_PRECISION)
    np.testing.assert_array_equal(per_run["limb_lost"], [0, 0, 0])
    np.testing.assert_array_equal(per_run["evaluations"], [4000, 4000, 4000])
    np.testing.assert_array_equal(per_run["seconds"], [2, 2, 2])


def test_humanevas_fifteen_joints():
    """One of fifteen that is 150 mm off makes a mean of 10 mm; the head's top is no joint of MPJPE."""
    assert len(TRUNK) + sum(map(len, SKELETON.evaluation_groups.values())) == 15
    pose = synthetic_poses(4)[None]
    truth = truth_of(still_result(pose), pose[0])
    joints = truth.joints.copy()
    joints[2, -1] += [0.15, 0, 0]
    joints[3, JOINTS.index("LWrist")] += [0, 0.3, 0]
    per_frame, per_run = measure(still_result(pose), replace(truth, joints=joints))
    np.testing.assert_allclose(per_frame["joint_error"][0], [0, 0, 0.01, 0.02], rtol=0, atol=SINGLE_PRECISION)
    np.testing.assert_allclose(per_frame["mpjpe"][0], [0, 0, 0, 0.025], rtol=0, atol=SINGLE_PRECISION)
    assert per_run["limb_lost"] == [1]


def test_it_agrees_with_the_evaluation_of_a_single_result():
    result = synthetic_result(frames=6, runs=2)
    truth = truth_of(result, synthetic_poses(6, seed=4))
    unseen = truth.markers.copy()
    unseen[0, :2] = np.nan
    truth = replace(truth, markers=unseen)
    whole = evaluate(result, truth)
    report = whole["series"]
    per_frame, per_run = measure(result, truth)
    for name in ("eq20_as_printed", "marker_error", "mpjpe", "pa_mpjpe"):
        np.testing.assert_allclose(per_frame[name] * 1000, np.array(report[f"{name}_mm"]), rtol=1e-6)
    for name in ("eq20_as_printed_floor", "marker_error_floor"):
        np.testing.assert_allclose(per_run[name] * 1000, [whole[f"{name}_mm"]] * 2, rtol=1e-9)
    assert list(per_run["eq20_as_printed_left_out"]) == [whole["eq20_as_printed_left_out"]] * 2 == [2, 2]
    np.testing.assert_allclose(per_frame["iou"], np.array(report["iou"], float), rtol=1e-6)
    np.testing.assert_array_equal(per_frame["cost"], result.cost.astype(np.float32))
    assert list(per_run["frames_lost"]) == [1, 1]
    for name in ("shake", "growth"):
        scale = 1000 if name == "shake" else 1
        told = [run[f"{name}_mm" if name == "shake" else name] for run in whole["per_run"]]
        np.testing.assert_allclose(per_run[name] * scale, told, rtol=1e-6)


def test_without_truth_errors_are_unknown():
    per_frame, per_run = measure(synthetic_result(frames=5, runs=2), None)
    errors = ("eq20_as_printed", "marker_error", "joint_error", "mpjpe", "pa_mpjpe")
    assert all(np.isnan(per_frame[name]).all() for name in errors)
    assert all(np.isnan(per_run[name]).all() for name in ("eq20_as_printed_floor", "marker_error_floor"))
    assert np.isfinite(per_frame["iou"][:, :-1]).all()
    assert np.isnan(per_run["limb_lost"]).all()
    assert np.isnan(per_run["growth"]).all()
    assert np.isfinite(per_run["shake"]).all()
    assert np.isfinite(per_run["jerk"]).all()


def test_frames_without_truth_are_unknown():
    pose = synthetic_poses(6)[None]
    truth = truth_of(still_result(pose), pose[0])
    joints, markers = truth.joints.copy(), truth.markers.copy()
    joints[4] = markers[4] = np.nan
    holey = replace(truth, joints=joints, markers=markers)
    partly = replace(holey, frame_numbers=holey.frame_numbers + np.array([0, 0, 0, 0, 0, 90]))
    per_frame, _ = measure(still_result(pose), partly)
    for name in ("eq20_as_printed", "marker_error", "joint_error", "mpjpe", "pa_mpjpe"):
        assert np.isnan(per_frame[name][0]).tolist() == [False, False, False, False, True, True]


def test_a_truth_of_another_rate_is_matched_by_time():
    result = still_result(np.repeat(synthetic_poses(6)[None], 2, axis=0), fps=50.0)
    whole = truth_of(result, result.pose[0])
    away = np.array([0.0, 0.01, 0.0])
    twice = replace(
        whole,
        fps=100.0,
        frame_numbers=np.arange(12),
        markers=np.repeat(whole.markers, 2, axis=0),
        joints=np.repeat(whole.joints, 2, axis=0) + away,
        pose=np.repeat(whole.pose, 2, axis=0),
    )
    per_frame, _ = measure(result, twice)
    np.testing.assert_allclose(per_frame["mpjpe"], np.full((2, 6), 0.01), rtol=0, atol=SINGLE_PRECISION)


def test_jerk_of_a_cubic_path():
    """x = a t³ has the third derivative 6 a; a gap in the numbers is not differentiated across."""
    time_of = np.arange(20) / 60.0
    path = np.zeros((2, 20, 3, 3))
    path[0, :, :, 0] = 0.5 * time_of[:, None] ** 3
    np.testing.assert_allclose(jerk(path, np.arange(20), 60.0), [3.0, 0.0], rtol=1e-6, atol=0)
    kept = np.array([0, 1, 2, 3, 4, 9, 10, 11, 12, 13])
    np.testing.assert_allclose(jerk(path[:, kept], kept, 60.0), [3.0, 0.0], rtol=1e-6, atol=0)
    np.testing.assert_allclose(jerk(path[:, ::2], np.arange(0, 20, 2), 60.0), [3.0, 0.0], rtol=1e-6, atol=0)
    assert np.isnan(jerk(path[:, :3], np.arange(3), 60.0)).all()


def test_a_body_that_glides_slides():
    """Run 0 stands, run 1 glides at 0.5 m/s, run 2 rises, run 3 stands on one leg and swings the other."""
    pose = np.repeat(synthetic_subject().pose[None, None], 4, axis=0).repeat(11, axis=1)
    pose[1, :, 0] += 0.01 * np.arange(11)  # 50 frames a second
    pose[2, :, 1] += 0.01 * np.arange(11)
    pose[3, :, 3 + 3 * JOINTS.index("LHip")] += 0.05 * np.arange(11)
    np.testing.assert_allclose(foot_slide(still_result(pose)), [0.0, 0.5, 0.0, 0.0], rtol=0, atol=1e-4)


def test_alignment_is_that_of_a_frame_on_its_own():
    """Against the textbook's solution, a frame at a time (Umeyama 1991); three joints are enough, two are not."""
    rng = np.random.default_rng(1)
    points, target = rng.normal(size=(3, 5, 12, 3)), rng.normal(size=(5, 12, 3))
    target[1, 3:] = target[2, 4] = target[3, 2:] = np.nan
    error = aligned_error(points, target)
    assert np.isnan(error[:, 3]).all()
    for run in range(3):
        for frame in (0, 1, 2, 4):
            known = np.isfinite(target[frame]).all(1)
            x, y = points[run, frame, known], target[frame, known]
            x, y = x - x.mean(0), y - y.mean(0)
            u, d, vt = np.linalg.svd(y.T @ x)
            sign = np.diag([1, 1, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
            scale = np.trace(np.diag(d) @ sign) / (x**2).sum()
            fitted = scale * x @ (u @ sign @ vt).T
            assert error[run, frame] == pytest.approx(np.linalg.norm(fitted - y, axis=1).mean(), rel=1e-9)


def test_a_long_result_takes_little_memory():
    """20,000 frames; the whole skin in every frame would be gigabytes on a real body."""
    poses = synthetic_poses(20_000)
    result = still_result(poses[None])
    truth = truth_of(still_result(poses[None, :100]), poses[:100])
    tracemalloc.start()
    evaluate(result, truth)
    measure(result, truth)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 250e6
