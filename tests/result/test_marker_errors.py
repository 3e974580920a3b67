"""Eq. 20 in both readings, on a body that only shifts: then a marker's place on the skin shifts with it, exactly."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import synthetic_result, synthetic_subject

from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rotations import zyx_angles, zyx_rotation
from mmocap_warp.cli.result_commands import summary
from mmocap_warp.result import marker_errors
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.result.marker_errors import attach
from mmocap_warp.result.truth import Truth

SINGLE_PRECISION_MM = 5e-3
FRAMES, MARKERS = 6, 5
OFF_THE_SKIN = np.array([0.0, 0.004, 0.011, 0.023, 0.047])  # [m], unequal


def shifts(seed, scale=0.03):
    """(frame, 3): how far the root is from where it began [m]."""
    return np.random.default_rng(seed).normal(0.0, scale, (FRAMES, 3))


def standing(moved):
    """(frame, coordinate): the subject's pose with its root shifted."""
    pose = np.repeat(synthetic_subject().pose[None], len(moved), axis=0)
    pose[:, :3] += moved
    return pose


def vertices_of(subject, pose):
    return Poser(subject.body, subject.root_base).vertices(pose[None])[0].astype(float)


def seen_markers(moved):
    """(frame, marker, 3): some points off the skin, unequally far, that shift with the body [m]."""
    subject = synthetic_subject()
    vertices = vertices_of(subject, subject.pose)
    rng = np.random.default_rng(3)
    away = rng.normal(size=(MARKERS, 3))
    away *= OFF_THE_SKIN[:, None] / np.linalg.norm(away, axis=1, keepdims=True)
    return vertices[subject.body.marker_vertex[:MARKERS]] + away + moved[:, None]


def truth_of(markers, moved):
    """The truth of the subject's own body, shifted."""
    subject = synthetic_subject()
    pose = standing(moved)
    joints = Poser(subject.body, subject.root_base).joint_transforms(pose)[:, :, :3, 3].astype(float)
    names = tuple("ABCDE"[: markers.shape[1]])
    skeleton = subject.body.skeleton
    return Truth(60.0, np.arange(10, 16), names, markers, skeleton.joints, joints, pose, subject.root_base)


def result_of(runs, start=None):
    """Runs that shift the root by ``runs`` (run, frame, 3) from a pose that is given ``start`` (3,) off [m]."""
    result = synthetic_result(FRAMES, len(runs))
    subject = result.subject
    if start is not None:
        subject = replace(subject, pose=subject.pose + np.append(start, np.zeros(len(subject.pose) - 3)))
    return replace(result, subject=subject, pose=np.stack([standing(moved) for moved in runs]))


def riding_error_mm(markers, body, where, frame, moved):
    """(frame,): the mean distance of markers put on the body shifted by ``where`` in ``frame``, as it shifts on.

    Args:
        markers: (frame, marker, 3) [m].
        body: the subject.
        where: (3,) [m].
        frame: whose markers are put on.
        moved: (frame, 3), how the body shifts [m].
    """
    shifted = vertices_of(body, synthetic_subject().pose) + where
    place = attach(markers[frame], shifted, body.body.skin.face).positions(shifted) - where
    return 1000 * np.linalg.norm(markers - place - moved[:, None], axis=2).mean(axis=1)


def series(report, name):
    return np.array(report["series"][name], float)


def test_offsets_from_the_skin_count_each_on_its_own():
    """A mean over markers of distances: neither the distance of the mean offset nor the offsets dropped."""
    true, tracked = shifts(0), shifts(1)
    true[0] = tracked[0] = 0.0
    markers = seen_markers(true)
    report = evaluate(result_of([tracked]), truth_of(markers, true))
    expected = riding_error_mm(markers, synthetic_subject(), np.zeros(3), 0, tracked)
    assert expected[0] > 5  # what lies between markers and skin
    for name in ("eq20_as_printed_mm", "marker_error_mm"):  # the first answer is the given pose: both are the same
        np.testing.assert_allclose(series(report, name)[0], expected, rtol=0, atol=SINGLE_PRECISION_MM)
        assert report[name] == pytest.approx(expected.mean(), abs=SINGLE_PRECISION_MM)


def test_as_printed_all_runs_have_the_given_first_pose():
    """Two runs whose first answers differ, and differ from the given pose, which is off by 62 mm itself."""
    true, start = shifts(0), np.array([0.05, -0.03, 0.02])
    runs = [shifts(seed) for seed in (1, 2)]
    markers = seen_markers(true)
    result = result_of(runs, start)
    report = evaluate(result, truth_of(markers, true))
    for run, moved in enumerate(runs):
        printed = riding_error_mm(markers, result.subject, start, 0, moved)
        own = riding_error_mm(markers, result.subject, moved[0], 0, moved)
        np.testing.assert_allclose(series(report, "eq20_as_printed_mm")[run], printed, rtol=0, atol=SINGLE_PRECISION_MM)
        np.testing.assert_allclose(series(report, "marker_error_mm")[run], own, rtol=0, atol=SINGLE_PRECISION_MM)
        assert report["per_run"][run]["eq20_as_printed_mm"] == pytest.approx(printed.mean(), abs=SINGLE_PRECISION_MM)
        assert report["per_run"][run]["marker_error_mm"] == pytest.approx(own.mean(), abs=SINGLE_PRECISION_MM)
        assert abs(printed.mean() - own.mean()) > 5


def test_runs_that_end_alike_err_alike_as_printed_only():
    """The same poses but for the first answer: only the flattering reading tells them apart later."""
    true, start = shifts(0), np.array([0.0, 0.02, 0.0])
    runs = [true.copy(), true.copy()]
    runs[1][0] += [0.06, 0.0, 0.08]
    report = evaluate(result_of(runs, start), truth_of(seen_markers(true), true))
    printed, own = series(report, "eq20_as_printed_mm"), series(report, "marker_error_mm")
    np.testing.assert_array_equal(printed[0, 1:], printed[1, 1:])
    assert (np.abs(own[0, 1:] - own[1, 1:]) > 10).all()


def test_each_reading_has_the_floor_of_its_anchor():
    """The tracked body at the true angles, from the given pose and from its own: whatever was tracked."""
    true, start = shifts(0), np.array([0.05, -0.03, 0.02])
    markers = seen_markers(true)
    result = result_of([shifts(1), shifts(2)], start)
    report = evaluate(result, truth_of(markers, true))
    printed = riding_error_mm(markers, result.subject, start, 0, true)
    own = riding_error_mm(markers, result.subject, true[0], 0, true)
    assert report["eq20_as_printed_floor_mm"] == pytest.approx(printed.mean(), abs=SINGLE_PRECISION_MM)
    assert report["marker_error_floor_mm"] == pytest.approx(own.mean(), abs=SINGLE_PRECISION_MM)
    assert printed.mean() > own.mean() + 5
    at_true_angles = evaluate(replace(result, pose=standing(true)[None].repeat(2, axis=0)), truth_of(markers, true))
    for name in ("eq20_as_printed", "marker_error"):
        assert at_true_angles[f"{name}_mm"] == pytest.approx(report[f"{name}_floor_mm"], abs=1e-9)


def test_a_body_of_other_proportions_has_its_joints_about_the_true_ones():
    """Not its root on the true root: here all joints but that are 40 mm too high above it."""
    true = shifts(0)
    markers = seen_markers(true)
    result = result_of([shifts(1)])
    body = result.subject.body
    joints = body.joint_rest + np.where(np.arange(len(body.joint_rest)) > 0, 0.04, 0.0)[:, None] * [0, 1, 0]
    body = replace(body, joint_rest=joints.astype(np.float32))
    result = replace(result, subject=replace(result.subject, body=body))
    truth = truth_of(markers, true)
    placed = standing(true)
    rest = [
        Poser(each.body, each.root_base).joint_transforms(placed)[0, :, :3, 3]
        for each in (synthetic_subject(), result.subject)
    ]
    shift = (rest[0] - rest[1]).mean(axis=0)
    assert shift[1] == pytest.approx(-0.0375, abs=1e-6)
    placed[:, :3] += shift
    expected = evaluate(replace(result, pose=placed[None]), truth)
    hidden = truth.joints.copy()
    hidden[4] = np.nan  # there the root is on the true one
    report = evaluate(result, truth)
    for name in ("eq20_as_printed", "marker_error"):
        assert report[f"{name}_floor_mm"] == pytest.approx(expected[f"{name}_mm"], abs=SINGLE_PRECISION_MM)
        partly = evaluate(result, replace(truth, joints=hidden))[f"{name}_floor_mm"]
        assert np.isfinite(partly)
        assert partly != pytest.approx(report[f"{name}_floor_mm"], abs=0.1)


def test_true_angles_are_read_in_the_true_bodys_own_axes():
    """A start that was fitted has a heading of its own, and the root's angles are from that."""
    true = shifts(0)
    markers = seen_markers(true)
    result = result_of([shifts(1)])
    expected = evaluate(result, truth_of(markers, true))
    turn = zyx_rotation(np.array([0.0, 0.8, 0.0]))
    turned = result.subject.pose.copy()
    turned[3:6] = zyx_angles(turn.T @ zyx_rotation(turned[3:6]))
    subject = replace(result.subject, root_base=result.subject.root_base @ turn, pose=turned)
    report = evaluate(replace(result, subject=subject), truth_of(markers, true))
    for name in ("eq20_as_printed_floor_mm", "marker_error_floor_mm"):
        assert report[name] == pytest.approx(expected[name], abs=SINGLE_PRECISION_MM)


@pytest.mark.parametrize(
    "unknown",
    [
        lambda truth: replace(truth, pose=None),
        lambda truth: replace(truth, root_base=None),
        lambda truth: replace(truth, pose=truth.pose[:, :-3]),
        lambda truth: replace(truth, pose=np.pad(truth.pose, ((0, 0), (0, 3)))),
        lambda truth: replace(truth, joint_names=truth.joint_names[::-1], joints=truth.joints[:, ::-1]),
        lambda truth: replace(truth, joint_names=(), joints=truth.joints[:, :0]),
    ],
    ids=["no poses", "no axes", "fewer angles", "more angles", "other joints", "no joints"],
)
def test_without_the_true_angles_there_is_no_floor(unknown):
    true = shifts(0)
    report = evaluate(result_of([true]), unknown(truth_of(seen_markers(true), true)))
    assert report["eq20_as_printed_floor_mm"] is report["marker_error_floor_mm"] is None
    assert report["eq20_as_printed_mm"] is not None
    assert report["marker_error_mm"] is not None


def test_a_marker_that_the_first_frame_does_not_show_is_left_out_as_printed():
    """B appears in the second frame, C is never seen, D is hidden in the fourth; only B is left out and counted."""
    true, tracked = shifts(0), shifts(1)
    markers = seen_markers(true)
    markers[0, 1] = markers[:, 2] = markers[3, 3] = np.nan
    result = result_of([tracked], np.array([0.0, 0.03, 0.0]))
    report = evaluate(result, truth_of(markers, true))
    assert report["eq20_as_printed_left_out"] == 1
    kept = markers[:, [0, 3, 4]]
    whole = evaluate(result, truth_of(kept, true))
    np.testing.assert_array_equal(series(report, "eq20_as_printed_mm"), series(whole, "eq20_as_printed_mm"))
    assert report["eq20_as_printed_floor_mm"] == whole["eq20_as_printed_floor_mm"]
    assert whole["eq20_as_printed_left_out"] == 0
    without_d = evaluate(result, truth_of(markers[:, [0, 4]], true))
    hidden = [series(each, "eq20_as_printed_mm")[0, 3] for each in (report, without_d)]
    assert hidden[0] == pytest.approx(hidden[1], abs=1e-9)  # D is left out of that frame's mean
    assert report["marker_error_mm"] != whole["marker_error_mm"]  # B counts from the second frame on
    assert "(floor " in summary(whole)
    assert "markers left out: 1)" in summary(report)
    assert "left out" not in summary(whole)


def test_the_initial_position_is_that_of_the_first_frame_that_was_tracked():
    """Where the truth begins a frame later, no marker can be put on the body as printed."""
    true = shifts(0)
    truth = truth_of(seen_markers(true), true)
    late = replace(
        truth,
        frame_numbers=truth.frame_numbers[1:],
        markers=truth.markers[1:],
        joints=truth.joints[1:],
        pose=truth.pose[1:],
    )
    report = evaluate(result_of([shifts(1)]), late)
    assert report["eq20_as_printed_mm"] is report["eq20_as_printed_floor_mm"] is None
    assert report["eq20_as_printed_left_out"] == MARKERS
    assert report["marker_error_mm"] is not None
    assert report["marker_error_floor_mm"] is not None
    assert "Eq. 20 as printed" not in summary(report)


def test_poses_are_posed_in_blocks(monkeypatch):
    """Blocks of any size give the same bits, gaps in the markers among them."""
    true = shifts(0)
    markers = seen_markers(true)
    markers[2] = markers[0, 1] = markers[4, 0] = np.nan
    result, truth = result_of([shifts(1), shifts(2)]), truth_of(markers, true)
    whole = evaluate(result, truth)
    monkeypatch.setattr(marker_errors, "POSES_AT_ONCE", 4)
    assert evaluate(result, truth) == whole
    assert whole["series"]["eq20_as_printed_mm"][0][2] is None


def test_a_hand_does_not_take_the_marker_of_another_part():
    """The chest's marker is nearest to a hand at first; then the arm goes away, and chest and marker stay."""
    result = synthetic_result(FRAMES, 2)
    subject = result.subject
    vertices = vertices_of(subject, subject.pose)
    chest, wrist = (subject.body.marker_vertex[subject.body.marker_names.index(name)] for name in ("CHEST", "LWRI"))
    marker = 0.2 * vertices[chest] + 0.8 * vertices[wrist]
    pose = np.repeat(subject.pose[None, None], FRAMES, axis=1)
    pose[:, 1:, subject.body.skeleton.angles("LShoulder")] += 0.5
    markers = np.broadcast_to(marker, (FRAMES, 1, 3)).copy()
    still = replace(truth_of(markers, np.zeros((FRAMES, 3))), marker_names=("CHEST",))
    moving = replace(result, pose=np.repeat(pose, 2, axis=0))
    for reading in ("eq20_as_printed_mm", "marker_error_mm"):
        as_named = series(evaluate(moving, still), reading)
        np.testing.assert_allclose(as_named, as_named[0, 0], rtol=0, atol=SINGLE_PRECISION_MM)
        nameless = series(evaluate(moving, replace(still, marker_names=("X",))), reading)
        assert (nameless[:, 1:] - nameless[:, :1] > 50).all()


def test_a_markers_part_is_the_skin_of_the_joints_that_move_it():
    body = synthetic_subject().body
    leading = body.skin.joint[np.arange(len(body.skin.rest)), body.skin.weight.argmax(axis=1)]
    (wrist,) = marker_errors.allowed_skin(body, ("LWRI",))
    assert {body.skeleton.joints[joint] for joint in leading[wrist]} == {"LElbow"}
    assert marker_errors.allowed_skin(body, ("other",)).all()
