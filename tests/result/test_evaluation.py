import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from person_skeleton import JOINTS
from synthetic import synthetic_body, synthetic_poses, synthetic_result

from mmocap_warp.body.posing import Poser
from mmocap_warp.cli.result_commands import summary
from mmocap_warp.errors import InputError
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.marker_errors import attach, triangulated
from mmocap_warp.result.truth import Truth

SINGLE_PRECISION_MM = 2e-3


def truth_of(result, pose):
    """What perfect markers and joints would say of a body that moved through ``pose`` (frame, 51)."""
    body = result.subject.body
    poser = Poser(body, result.subject.root_base)
    return Truth(
        fps=result.fps,
        frame_numbers=result.frame_numbers[0] + np.arange(len(pose)),
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


def test_angles_are_judged_where_the_truth_has_poses_of_such_a_body():
    """One elbow is 20 degrees off in all frames, across the half turn at which angles begin anew."""
    result = moved(synthetic_result(runs=1), 0.0, slice(0))
    skeleton = result.subject.body.skeleton
    elbow = skeleton.angles("LElbow").start + 1
    true = result.pose[0].copy()
    true[:, elbow] = np.radians(170)
    off = result.pose.copy()
    off[0, :, elbow] = np.radians(-170)
    truth = replace(truth_of(result, result.pose[0]), pose=true)
    report = evaluate(replace(result, pose=off), truth)
    assert report["median_deg_by_angle"]["LElbow.Ry"] == pytest.approx(20)
    assert report["median_deg_by_angle"]["RElbow.Ry"] == 0
    assert report["median_angle_deg"] == 0
    assert not [name for name in report["median_deg_by_angle"] if name.startswith("Root")]
    assert "median_angle_deg" not in evaluate(result, replace(truth, pose=None))
    assert "angle" not in summary(report)
    assert "median angle error  0.00 degrees" in summary(report | {"marker_error_mm": None})


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


def test_statuses_are_counted_by_frame_and_by_run():
    result = synthetic_result(frames=4, runs=2)
    status = np.array([[0, 3, 0, 2], [1, 3, 4, 0]], np.int8)
    report = evaluate(replace(result, status=status))
    names = ("lost", "partial", "rescued", "interpolated")
    assert [report[name] for name in names] == [1, 1, 1, 1]
    assert [[run[name] for name in names] for run in report["per_run"]] == [[1, 0, 1, 0], [0, 1, 1, 1]]
    assert summary(report).splitlines()[0].endswith("4 (1 lost, 1 with a view lost, 1 rescued, 1 interpolated)")
    assert summary(evaluate(result)).splitlines()[0].endswith("4 (1 lost, 1 with a view lost)")


def test_standard_deviations_are_told_by_joint_and_by_angle():
    result = synthetic_result(frames=3, runs=1)
    joint, angle = np.full((1, 3, len(JOINTS), 3), 0.001), np.full(result.pose.shape, np.radians(2.0))
    joint[:, :, JOINTS.index("LWrist")] = 0.003, 0.004, 0.0
    joint[:, 1] = angle[:, 1] = np.nan  # what is unknown does not count
    report = evaluate(replace(result, joint_sigma=joint, angle_sigma=angle))
    assert report["sigma_mm_by_joint"]["LWrist"] == pytest.approx(5.0)
    assert report["sigma_deg_by_angle"]["LKnee.Rx"] == pytest.approx(2.0)
    assert "Tx" not in report["sigma_deg_by_angle"]
    assert not [name for name in evaluate(result) if name.startswith("sigma")]


def test_shake_is_the_second_difference():
    result = replace(synthetic_result(frames=5, runs=1), fps=60.0)
    pose = np.repeat(result.subject.pose[None, None], 5, axis=1)
    pose[0, :, 0] += [0, 0.01, 0, 0.01, 0]  # the whole body shakes by 10 mm: second differences of 20 mm
    assert evaluate(replace(result, pose=pose))["shake_mm"] == pytest.approx(20, abs=0.01)


@pytest.mark.parametrize(("fps", "step"), [(60.0, 1), (30.0, 1), (15.0, 1), (60.0, 4)])
def test_shake_is_told_at_60_hz(fps, step):
    """A body that falls has the same acceleration at any rate, and where frames are left out."""
    result = replace(synthetic_result(frames=5, runs=1), fps=fps, frame_numbers=step * np.arange(5))
    pose = np.repeat(result.subject.pose[None, None], 5, axis=1)
    pose[0, :, 1] -= 0.5 * 9.81 * (result.frame_numbers / fps) ** 2
    assert evaluate(replace(result, pose=pose))["shake_mm"] == pytest.approx(9810 / 60**2, abs=0.01)


def test_growth_is_the_last_third_over_the_first():
    result = moved(synthetic_result(frames=7, runs=2), 0.0, slice(0))
    off = np.array([[10, 10, 99, 99, 99, 20, 40], [20, 20, 99, 99, 99, 20, 20]]) / 1000
    pose = result.pose.copy()
    pose[:, :, 0] += off
    report = evaluate(replace(result, pose=pose), truth_of(result, result.pose[0]))
    assert [run["growth"] for run in report["per_run"]] == pytest.approx([3.0, 1.0], abs=1e-3)
    assert report["growth"] == pytest.approx(2.0, abs=1e-3)
    assert "growth of MPJPE         2.00 (last third over first)" in summary(report)
    assert evaluate(synthetic_result(frames=2), truth_of(result, result.pose[0][:2]))["growth"] is None


def test_constant_offsets_in_the_parents_axes_are_removed():
    """A source that puts every joint elsewhere on the same body is 50 mm off, and moves without error."""
    result = moved(synthetic_result(frames=9, runs=2), 0.0, slice(0))
    truth = truth_of(result, result.pose[0])
    skeleton = result.subject.body.skeleton
    away = np.random.default_rng(4).normal(size=(len(JOINTS), 3))
    away *= 0.05 / np.linalg.norm(away, axis=1, keepdims=True)
    axes = Poser(result.subject.body, result.subject.root_base).joint_transforms(result.pose[0])[:, :, :3, :3]
    joints = truth.joints + np.einsum("fjab,jb->fja", axes[:, np.maximum(skeleton.parent, 0)], away)
    joints[4, JOINTS.index("LWrist")] += 5.0  # one outlier does not move a median
    joints[:, JOINTS.index("RKnee")] = np.nan  # a joint that is never seen
    report = evaluate(result, replace(truth, joints=joints))
    assert report["median_joint_mm"] == pytest.approx(50, abs=0.01)
    assert report["median_joint_offsets_removed_mm"] < 0.01


def test_a_status_that_says_tracked_is_judged_by_the_root_and_the_limbs_ends():
    result = moved(synthetic_result(frames=6, runs=2), 0.0, slice(0))
    truth = truth_of(result, result.pose[0])
    joints = truth.joints.copy()
    joints[0, JOINTS.index("LWrist")] += [0.201, 0, 0]
    joints[1, JOINTS.index("Root")] += [0, 0, 0.201]
    joints[2, JOINTS.index("LKnee")] += [0.3, 0, 0]  # neither the root nor an end
    joints[3, JOINTS.index("RAnkle")] += [0.06, 0, 0]  # neither near nor wrong
    status = np.array([[0, 2, 0, 0, 1, 3], [2, 4, 0, 2, 0, 0]], np.int8)
    report = evaluate(replace(result, status=status), replace(truth, joints=joints))
    assert report["wrongly_tracked"] == 1
    assert [run["wrongly_tracked"] for run in report["per_run"]] == [1, 0]
    assert [run["near_tracked"] for run in report["per_run"]] == pytest.approx([2 / 3, 1.0])
    assert report["near_tracked"] == pytest.approx(5 / 6)
    assert summary(report).endswith("wrongly tracked         1 frames")


def test_a_truth_of_another_rate_is_matched_by_time():
    """At 120 frames a second its frame 2n is the recording's frame n."""
    result = moved(replace(synthetic_result(frames=6, runs=1), fps=60.0), [0.0, 0.05, 0.0], slice(None))
    still = np.repeat(result.pose[0], 2, axis=0)
    truth = replace(truth_of(result, still), fps=120.0, frame_numbers=np.arange(20, 32))
    truth = replace(truth, joints=truth.joints - [0.0, 0.05, 0.0], markers=truth.markers - [0.0, 0.05, 0.0])
    report = evaluate(result, truth)
    assert report["truth_frames"] == 6
    assert report["mpjpe_mm"] == pytest.approx(50, abs=SINGLE_PRECISION_MM)
    with pytest.raises(InputError, match="truth: has 30 frames a second, and the recording 60"):
        evaluate(result, replace(truth, fps=30.0))


def test_shake_is_not_measured_across_a_gap():
    """The body shakes by 10 mm in three consecutive frames; two that are seconds apart say nothing of how it shakes."""
    result = synthetic_result(frames=5, runs=1)
    pose = np.repeat(result.subject.pose[None, None], 5, axis=1)
    pose[0, :, 0] += [0, 0.01, 0, 1.0, 1.0]
    gap = replace(result, fps=60.0, pose=pose, frame_numbers=np.array([0, 1, 2, 200, 201]))
    assert evaluate(gap)["shake_mm"] == pytest.approx(20, abs=0.01)


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
    with pytest.raises(InputError, match="has frames 110-115, of which the result, with 10-15, has none"):
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


def test_points_attach_to_the_nearest_place_of_those_allowed():
    """As where the rest of the mesh is not there."""
    body = synthetic_body()
    points = np.random.default_rng(0).uniform((-1, 0, -0.5), (1, 2, 0.5), (20, 3))
    allowed = np.random.default_rng(1).random((20, len(body.skin.rest))) < 0.1
    triangles = triangulated(body.skin.face)
    for i, point in enumerate(points):
        part = triangles[allowed[i, triangles].any(axis=1)]
        alone = attach(point[None], body.skin.rest, part)
        among = attach(point[None], body.skin.rest, body.skin.face, allowed[i : i + 1])
        np.testing.assert_array_equal(among.corners, alone.corners)
        np.testing.assert_array_equal(among.weights, alone.weights)
    with pytest.raises(ValueError, match="allowed leaves no triangle for point 0"):
        attach(points[:1], body.skin.rest, body.skin.face, np.zeros((1, len(body.skin.rest)), bool))
