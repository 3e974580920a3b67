import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from synthetic import synthetic_body, synthetic_poses, synthetic_result

from mmocap_warp.bodies.human import JOINTS
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.skin_points import attach, triangulated
from mmocap_warp.errors import InputError
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.truth import Truth

SINGLE_PRECISION_MM = 2e-3


def truth_of(result, pose):
    """What perfect markers and joints would say of a body that moved through ``pose`` (frame, 51)."""
    body = result.subject.body
    poser = Poser(body, result.subject.root_base)
    return Truth(
        fps=result.fps,
        frame_numbers=result.frame_numbers,
        marker_names=body.marker_names,
        markers=poser.vertices(pose)[:, body.marker_vertex].astype(float),
        joint_names=JOINTS,
        joints=poser.joint_transforms(pose)[:, :, :3, 3].astype(float),
    )


def moved(result, offset, frames):
    """Every run moves as ``synthetic_poses`` does, but for an offset [m] of the root in some frames."""
    pose = np.repeat(synthetic_poses(len(result.frame_numbers))[None], len(result.pose), 0)
    pose[:, frames, :3] += offset
    return replace(result, pose=pose)


def test_a_perfect_result_has_no_error():
    result = moved(synthetic_result(runs=2), 0.0, slice(0))
    report = evaluate(result, truth_of(result, result.pose[0]))
    assert report["marker_error_mm"] < SINGLE_PRECISION_MM
    assert report["mpjpe_mm"] < SINGLE_PRECISION_MM
    assert report["pa_mpjpe_mm"] < SINGLE_PRECISION_MM
    assert report["limb_lost_frames"] == []


def test_marker_error_is_the_mean_over_markers_then_frames():
    """Off by a 3-4-5 triangle of 50 mm in two of six frames, never in the first, where markers are attached."""
    result = moved(synthetic_result(runs=3), [0.03, 0.0, 0.04], [2, 5])
    report = evaluate(result, truth_of(result, synthetic_poses(6)))
    assert report["marker_error_mm"] == pytest.approx(100 / 6, abs=SINGLE_PRECISION_MM)
    assert report["series"]["marker_error_mm"][1] == pytest.approx([0, 0, 50, 0, 0, 50], abs=SINGLE_PRECISION_MM)
    assert [run["marker_error_mm"] for run in report["per_run"]] == pytest.approx([100 / 6] * 3, abs=0.01)


def test_a_marker_rides_from_the_frame_where_it_is_first_seen():
    result = moved(synthetic_result(runs=1), [0.03, 0.0, 0.04], slice(2, 4))
    truth = truth_of(result, synthetic_poses(6))
    markers = truth.markers.copy()
    markers[0] = markers[4, 1:] = np.nan
    report = evaluate(result, replace(truth, markers=markers))
    assert report["series"]["marker_error_mm"][0][0] is None
    assert report["series"]["marker_error_mm"][0][1:] == pytest.approx([0, 50, 50, 0, 0], abs=SINGLE_PRECISION_MM)
    assert report["marker_error_mm"] == pytest.approx(20, abs=SINGLE_PRECISION_MM)


def test_joint_errors_of_a_shifted_body():
    result = moved(synthetic_result(runs=2), [0.0, 0.06, 0.0], slice(None))
    report = evaluate(result, truth_of(result, synthetic_poses(6)))
    assert report["mpjpe_mm"] == pytest.approx(60, abs=SINGLE_PRECISION_MM)
    assert report["median_joint_mm"] == pytest.approx(60, abs=SINGLE_PRECISION_MM)
    assert report["pa_mpjpe_mm"] < SINGLE_PRECISION_MM
    assert set(report["median_mm_by_group"]) == {"shoulders", "elbows", "wrists", "hips", "knees", "ankles"}


def test_alignment_takes_out_a_similarity_but_no_mirror():
    result = moved(synthetic_result(runs=1), 0.0, slice(0))
    truth = truth_of(result, result.pose[0])
    turned = 1.1 * truth.joints @ np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0.0]]) + 0.3
    assert evaluate(result, replace(truth, joints=turned))["pa_mpjpe_mm"] < SINGLE_PRECISION_MM
    assert evaluate(result, replace(truth, joints=-truth.joints))["pa_mpjpe_mm"] > 10


def test_a_limb_over_200_mm_off_is_lost():
    result = moved(synthetic_result(runs=2), 0.0, slice(0))
    truth = truth_of(result, result.pose[0])
    joints = truth.joints.copy()
    joints[1, JOINTS.index("LWrist")] += [0.201, 0, 0]
    joints[2, JOINTS.index("RAnkle")] += [0, 0.199, 0]
    joints[3, JOINTS.index("LKnee")] += [0, 0, 0.3]  # no end of a limb
    assert evaluate(result, replace(truth, joints=joints))["limb_lost_frames"] == [11]


def test_truth_may_cover_some_frames_and_name_some_joints():
    result = moved(synthetic_result(runs=1), [0.0, 0.05, 0.0], slice(None))
    truth = truth_of(result, synthetic_poses(6))
    partial = Truth(
        truth.fps,
        np.array([8, 12, 14, 99]),
        (),
        np.zeros((4, 0, 3)),
        ("Nose", "LWrist"),
        np.stack([truth.joints[[2, 2, 4, 2], JOINTS.index(name)] for name in ("Neck", "LWrist")], 1),
    )
    report = evaluate(result, partial)
    assert report["truth_frames"] == 2
    assert report["mpjpe_mm"] == pytest.approx(50, abs=SINGLE_PRECISION_MM)
    assert list(report["median_mm_by_joint"]) == ["LWrist"]
    assert report["median_mm_by_group"]["hips"] is None
    assert report["marker_error_mm"] is None
    assert [value is None for value in report["series"]["mpjpe_mm"][0]] == [True, True, False, True, False, True]


def test_overlap_counts_only_what_was_judged():
    result = synthetic_result(frames=4, runs=2, cameras=2)
    iou = np.full((2, 4, 2), 0.9)
    iou[1, 2] = 0.5, 0.7
    iou[:, 1, 0] = iou[:, 3] = np.nan
    report = evaluate(replace(result, iou=iou, evaluations=np.full((2, 4), 500), seconds=2.0))
    assert (report["frames"], report["runs"], report["lost"], report["partial"]) == (4, 2, 1, 1)
    assert (report["evaluations"], report["evaluations_per_second"]) == (4000, 2000)
    assert report["mean_iou"] == pytest.approx((0.9 + (0.9 + 0.9 + 0.6) / 3) / 2)
    assert (report["worst_iou"], report["worst_iou_frame"]) == (pytest.approx(0.6), 12)
    assert report["iou_by_camera"]["cam01"] == pytest.approx((3 * 0.9 + 0.5) / 4)
    assert [run["seed"] for run in report["per_run"]] == [7, 8]
    assert "marker_error_mm" not in report


def test_jitter_is_the_second_difference():
    result = synthetic_result(frames=5, runs=1)
    pose = np.repeat(result.subject.pose[None, None], 5, axis=1)
    pose[0, :, 0] += [0, 0.01, 0, 0.01, 0]  # the whole body shakes by 10 mm: second differences of 20 mm
    assert evaluate(replace(result, pose=pose))["jitter_mm"] == pytest.approx(20, abs=0.01)


def test_jitter_is_not_measured_across_a_gap():
    """The body shakes by 10 mm in three consecutive frames; two that are seconds apart say nothing of how it shakes."""
    result = synthetic_result(frames=5, runs=1)
    pose = np.repeat(result.subject.pose[None, None], 5, axis=1)
    pose[0, :, 0] += [0, 0.01, 0, 1.0, 1.0]
    gap = replace(result, pose=pose, frame_numbers=np.array([0, 1, 2, 200, 201]))
    assert evaluate(gap)["jitter_mm"] == pytest.approx(20, abs=0.01)


def test_nothing_judged_is_none_and_json(recwarn):
    result = synthetic_result(frames=3, runs=1)
    lost = replace(result, iou=np.full_like(result.iou, np.nan), cost=np.full_like(result.cost, np.nan), seconds=0.0)
    report = evaluate(lost)
    assert report["mean_iou"] is report["worst_iou"] is report["worst_iou_frame"] is None
    assert report["mean_cost"] is report["evaluations_per_second"] is None
    json.dumps(report, allow_nan=False)
    assert not [warning for warning in recwarn if warning.category is RuntimeWarning]


def test_truth_of_another_recording_is_refused():
    result = synthetic_result()
    truth = truth_of(result, result.pose[0])
    with pytest.raises(InputError, match="its frames 110-115 share none with the result's 10-15"):
        evaluate(result, replace(truth, frame_numbers=truth.frame_numbers + 100))
    nameless = replace(truth, marker_names=(), markers=truth.markers[:, :0], joint_names=tuple("abcdefghijklmnop"))
    with pytest.raises(InputError, match="no markers, and none of its joints"):
        evaluate(result, nameless)


def test_points_attach_to_the_nearest_place_on_the_skin():
    """As trimesh finds it."""
    body = synthetic_body()
    points = np.random.default_rng(0).uniform((-1, 0, -0.5), (1, 2, 0.5), (50, 3))
    points[0] = body.skin.rest[7]
    riding = attach(points, body.skin.rest, body.skin.face)
    found = riding.positions(body.skin.rest)
    corners = body.skin.rest[triangulated(body.skin.face)].astype(float)
    for point, place in zip(points, found, strict=True):
        places = trimesh.triangles.closest_point(corners, np.broadcast_to(point, (len(corners), 3)))
        nearest = np.linalg.norm(places - point, axis=1).min()
        assert np.linalg.norm(place - point) == pytest.approx(nearest, abs=1e-9)
    assert (riding.weights >= 0).all()
    np.testing.assert_allclose(riding.weights.sum(1), 1.0, rtol=0, atol=1e-12)
    shifted = riding.positions(np.stack([body.skin.rest, body.skin.rest + 1.0]))
    np.testing.assert_allclose(shifted[1] - shifted[0], 1.0, rtol=0, atol=1e-6)
