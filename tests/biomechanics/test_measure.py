"""All measures of a result, as a report and as tables."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
from measured import answer, made_walk
from other_bodies import arm_robot
from synthetic import synthetic_result

from mmocap_warp.biomechanics.measure_all import measure
from mmocap_warp.biomechanics.measure_tables import report, tables, write_tables
from mmocap_warp.rigging.shipped import load_body


@pytest.fixture(scope="module")
def walk():
    body = load_body("adult_woman")
    poses, _ = made_walk(body, cycles=2.3, fps=60.0)
    result = answer(body, poses, runs=2)
    told = {"body.bone.LKnee+RKnee.sigma": 0.011, "body.bone.LKnee+RKnee": 0.4, "body.height.sigma": 0.02}
    sigma = np.full((*result.pose.shape[:2], 16, 3), 0.004)
    raw = result.pose.copy()
    raw[..., 2] += 0.1
    return replace(
        result, subject=replace(result.subject, provenance=told), joint_sigma=sigma, raw_pose=raw,
        frame_numbers=result.frame_numbers + 100,
    )  # fmt: skip


def test_all_runs_or_one_the_smoothed_track_or_the_raw_one(walk):
    both, one, raw = measure(walk), measure(walk, run=1), measure(walk, run=1, raw=True)
    assert [run.run for run in both.runs] == [0, 1]
    assert [run.run for run in one.runs] == [1]
    np.testing.assert_array_equal(one.runs[0].joints, walk.joints()[1])
    np.testing.assert_allclose(raw.runs[0].joints[..., 2] - one.runs[0].joints[..., 2], 0.1, atol=1e-6)
    assert one.runs[0].joint_sigma is not None
    assert raw.runs[0].joint_sigma is None
    assert one.shown.run == 1
    assert both.shown.run == walk.best_run


def test_wrong_arguments(walk):
    with pytest.raises(ValueError, match="run must be 0 to 1, got 2"):
        measure(walk, run=2)
    with pytest.raises(ValueError, match="was not smoothed"):
        measure(synthetic_result(), raw=True)


def test_lengths_have_the_fits_standard_deviation(walk):
    lengths = measure(walk).lengths
    thigh = np.linalg.norm(np.diff(walk.subject.body.joint_rest[[10, 11]], axis=0))
    assert lengths["LHip to LKnee"] == pytest.approx((thigh, 0.011))
    assert lengths["RHip to RKnee"].sigma == 0.011
    assert math.isnan(lengths["LKnee to LAnkle"].sigma)
    assert len(lengths) == 15


def test_a_report_has_the_spread_of_what_was_measured(walk):
    measures = measure(walk)
    values = report(measures)
    assert values["track"] == "smoothed"
    assert values["left_out"] == []
    run, flexion = values["per_run"][0], measures.runs[0].angles["LKnee"]["flexion"]
    assert run["angles_deg"]["LKnee"]["flexion"] == {
        "min": flexion.min(), "mean": pytest.approx(flexion.mean()), "max": flexion.max()
    }  # fmt: skip
    assert run["cadence_per_minute"] == pytest.approx(112, abs=4)
    assert run["stance_share"]["left"] == pytest.approx(0.62, abs=0.03)
    assert 0.5 < run["step_length_m"]["right"] < 0.65
    assert run["strike_frames"]["left"][0] == 100 + measures.runs[0].feet["left"].strikes[0]
    assert run["centre_of_mass_height_m"]["mean"] == pytest.approx(measures.runs[0].centre_of_mass[:, 1].mean())


def read(path):
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    return head, rows


def test_tables_hold_every_frame_of_every_run(walk, tmp_path):
    measures = measure(walk)
    written = {path.stem: read(path) for path in write_tables(tmp_path, measures)}
    assert set(written) == {"lengths", "angles", "joints", "centre_of_mass", "contacts", "events"}
    frames = len(walk.frame_numbers)
    for name in ("angles", "joints", "centre_of_mass", "contacts"):
        head, rows = written[name]
        assert head[:4] == ["run", "frame", "seconds", "status"]
        assert len(rows) == 2 * frames
        assert all(len(row) == len(head) for row in rows)
    head, rows = written["joints"]
    column = head.index("LKnee.y_m")
    assert float(rows[frames + 3][column]) == pytest.approx(measures.runs[1].joints[3, 11, 1], rel=1e-8)
    assert rows[0][head.index("LKnee.y_sigma_m")] == "0.004"
    head, rows = written["angles"]
    flexion = [float(row[head.index("RKnee.flexion_deg")]) for row in rows[:frames]]
    np.testing.assert_allclose(flexion, measures.runs[0].angles["RKnee"]["flexion"], rtol=1e-8)
    assert (rows[1][1], float(rows[1][2])) == ("101", pytest.approx(101 / 60))


def test_tables_say_how_a_frames_pose_was_found():
    head, rows = tables(measure(synthetic_result(frames=4), run=1))["joints"]
    assert [row[head.index("status")] for row in rows] == ["tracked", "partial", "tracked", "lost"]


def test_events_come_in_their_order_with_their_step_and_stride(walk):
    measures = measure(walk, run=0)
    head, rows = tables(measures)["events"]
    events = [dict(zip(head, row, strict=True)) for row in rows]
    assert [event["frame"] for event in events] == sorted(event["frame"] for event in events)
    strikes = [event for event in events if event["event"] == "heel strike"]
    assert len(strikes) == sum(len(foot.strikes) for foot in measures.runs[0].feet.values())
    assert sum(not math.isnan(event["step_length_m"]) for event in strikes) == len(measures.runs[0].walking.steps)
    assert sum(not math.isnan(event["stance_share"]) for event in strikes) == len(measures.runs[0].walking.strides)
    assert all(math.isnan(event["step_seconds"]) for event in events if event["event"] == "toe off")


def test_what_is_not_known_is_empty_and_a_table_without_rows_is_not_written(tmp_path):
    arm = arm_robot()
    files = write_tables(tmp_path, measure(answer(arm, np.zeros((3, arm.skeleton.coordinates)))))
    assert [path.name for path in files] == ["lengths.csv", "angles.csv", "joints.csv"]
    assert read(files[0])[1][0][2] == ""
