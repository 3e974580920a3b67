"""The shipped sequences: people who stand where they stand, bend as people do, and look the same each time."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
import pytest
from least_jerk import minimum_jerk
from person_skeleton import JOINTS
from sequence_motions import ACTIONS, made_motion, pack_poses
from standing_posture import Track

from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import check_rig, project
from mmocap_warp.cli import main
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.study.degradations import write_sequence
from mmocap_warp.study.sequences import (
    CLIP_PLANS,
    FPS,
    MARKER_NOISE,
    PLANS,
    SEQUENCES,
    make_sequence,
)
from mmocap_warp.synthesis.exact_posing import ExactPoser, led_by
from mmocap_warp.synthesis.footage.faults import draw_silhouettes
from mmocap_warp.synthesis.footage.outlines import Surface, fill
from mmocap_warp.synthesis.footage.segmentation import Contrast, segment
from mmocap_warp.synthesis.motion.limb_motion import Leg
from mmocap_warp.synthesis.motion.stored_poses import (
    MOTIONS,
    MOTIONS_SHA256,
    stored_poses,
    unpack_poses,
)

MOST_SLIDE = 2e-3  # [m/s], mean over a sequence, of the foot that stands
FLOOR = 2e-3  # [m]
SINGLE = 2e-6  # [m], what the tracker's single precision differs from ours
BOUNDARY = 0.01  # share of a silhouette that two renderers may see differently
LEAST_FLEXION = np.radians(2.0)
PAPER_FRAMES = 8366 / 3
SOME = ("S1/Walking", "S2/Gestures", "S3/Box")


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=() if name in SOME else pytest.mark.nightly) for name in SEQUENCES],
)
def sequence(request):
    return SEQUENCES[request.param]


@pytest.fixture(scope="module", params=SOME)
def some(request):
    return SEQUENCES[request.param]


def speeds(sequence, *joints):
    """[m/s], the greatest of each joint."""
    places = sequence.truth.joints[:, [JOINTS.index(name) for name in joints]]
    return np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=0) * FPS


def feet(sequence):
    """(frame, vertex, 3) of the left and of the right foot."""
    left, right = (led_by(sequence.recording.body, f"{side}Ankle") for side in "LR")
    frames = [sequence.recording.vertices(frame) for frame in range(sequence.frame_count)]
    return [np.stack([vertices[of] for vertices in frames]) for of in (left, right)]


def flexion(sequence, joint, straight):
    """(frame,) [rad]."""
    return sequence.recording.poses[:, 3 + 3 * JOINTS.index(joint)] - straight


# Who moves, and how


def test_there_are_nine_as_long_as_a_third_of_the_papers():
    names = [f"{person}/{action}" for person in ("S1", "S2", "S3") for action in ("Walking", "Gestures", "Box")]
    assert sorted(SEQUENCES) == sorted(names)
    assert "S4/Walking" not in SEQUENCES
    assert abs(sum(plan.frames for plan in PLANS.values()) - PAPER_FRAMES) < 9


def test_joint_limits_hold_and_no_knee_or_elbow_is_overstretched(sequence):
    body, poses = sequence.recording.body, sequence.recording.poses
    limits = body.skeleton.limits.reshape(-1, 2)
    assert (poses[:, 3:] >= limits[:, 0]).all()
    assert (poses[:, 3:] <= limits[:, 1]).all()
    joints = sequence.truth.joints
    for side in "LR":
        assert flexion(sequence, f"{side}Knee", Leg.of(body, side).straight).min() > LEAST_FLEXION
        shoulder, elbow, wrist = (joints[:, JOINTS.index(side + name)] for name in ("Shoulder", "Elbow", "Wrist"))
        upper, fore = elbow - shoulder, wrist - elbow
        cosine = (upper * fore).sum(axis=1) / np.linalg.norm(upper, axis=1) / np.linalg.norm(fore, axis=1)
        assert np.arccos(cosine).min() > LEAST_FLEXION
        assert np.arccos(cosine).max() < np.radians(150)


def test_feet_stand_on_the_floor_and_do_not_slide(sequence):
    speed, lowest = [], []
    for foot in feet(sequence):
        low = foot[..., 2].argmin(axis=1)[:-1]
        frame = np.arange(len(low))
        speed.append(np.linalg.norm((foot[frame + 1, low] - foot[frame, low])[:, :2], axis=1) * FPS)
        lowest.append(foot[..., 2].min(axis=1))
    assert np.min(speed, axis=0).mean() < MOST_SLIDE
    assert np.abs(np.min(lowest, axis=0)).max() < FLOOR


@pytest.mark.parametrize("name", [*ACTIONS, "passer-by"])
def test_shipped_motions_are_those_of_the_instruments(name):
    np.testing.assert_allclose(stored_poses(name), made_motion(name), atol=1e-9)
    assert name == "passer-by" or len(stored_poses(name)) == CLIP_PLANS[name].frames


def test_the_code_names_the_content_of_the_shipped_motions():
    assert hashlib.sha256(MOTIONS.read_bytes()).hexdigest() == MOTIONS_SHA256
    assert sorted(np.load(MOTIONS)) == sorted([*ACTIONS, "passer-by"])
    assert sorted(CLIP_PLANS) == sorted(ACTIONS)


@pytest.mark.parametrize("frames", [1, 3, 40])
def test_packed_poses_keep_their_bits(frames):
    random = np.random.default_rng(frames)
    poses = np.cumsum(random.normal(scale=1e-3, size=(frames, 5)), axis=0)
    poses[:, 3] = [-0.0, 5e-324, -1e300][frames % 3]
    poses[:, 4] = random.choice([-1.0, 1.0], frames) * 10.0 ** random.integers(-300, 300, frames)
    assert unpack_poses(pack_poses(poses)).tobytes() == poses.tobytes()


def test_hands_are_fast_in_boxing_and_nothing_else_moves_in_gestures(sequence):
    wrists = speeds(sequence, "LWrist", "RWrist").max()
    if sequence.name.endswith("Box"):
        assert 4.0 < wrists < 9.0  # maximal effort is 7 to 9 m/s
        assert speeds(sequence, "LAnkle", "RAnkle").min() > 0.5  # both feet step
    if sequence.name.endswith("Gestures"):
        assert 1.0 < wrists < 3.5
        assert speeds(sequence, "Root").max() < 0.2
        assert speeds(sequence, "LAnkle", "RAnkle").max() < 1e-4
    assert np.linalg.norm(np.diff(sequence.truth.joints, 2, axis=0), axis=-1).max() < 0.07  # 250 m/s^2


def test_the_cameras_are_a_calibration_and_see_all_of_everyone(sequence):
    rig = check_rig(sequence.rig, "study")
    assert len(rig) == 7
    assert not rig.distortion.any()
    for frame in range(0, sequence.frame_count, 7):
        pixel = project(rig, sequence.recording.vertices(frame))
        assert (pixel > 0).all()
        assert (pixel < np.asarray(rig.size)[:, None] - 1).all()


# What is known and where tracking starts


def test_double_precision_poses_are_the_trackers(some):
    recording = some.recording
    theirs, ours = (poser(recording.body, recording.root_base) for poser in (Poser, ExactPoser))
    pose = recording.poses[40:41]
    np.testing.assert_allclose(theirs.joint_transforms(pose), ours.joint_transforms(pose), atol=SINGLE)
    np.testing.assert_allclose(theirs.vertices(pose), ours.vertices(pose), atol=SINGLE)


def test_markers_ride_on_the_true_skin_with_2_mm_of_noise(some):
    skin = np.stack(
        [some.recording.vertices(f)[some.recording.body.marker_vertex] for f in range(0, some.frame_count, 10)]
    )
    error = some.truth.markers[::10] - skin
    assert error.std() == pytest.approx(MARKER_NOISE, rel=0.05)
    assert np.abs(error.mean(axis=(0, 1))).max() < 3e-4


def test_the_start_is_near_the_truth_but_of_another_body(sequence):
    subject, truth = sequence.subject, sequence.truth
    joints = Poser(subject.body, subject.root_base).joint_transforms(subject.pose)[0, :, :3, 3]
    error = np.linalg.norm(joints - truth.joints[0, : len(JOINTS)], axis=1)
    assert 0.005 < error.mean() < 0.05
    assert error.max() < 0.12
    assert subject.pose[4] == pytest.approx(0.0, abs=np.radians(6))  # the heading is in the base
    assert np.abs(subject.body.skin.rest - sequence.recording.body.skin.rest).max() > 0.01
    limits = subject.body.skeleton.limits.reshape(-1, 2)
    assert ((subject.pose[3:] >= limits[:, 0]) & (subject.pose[3:] <= limits[:, 1])).all()


# What is seen


def test_masks_are_the_same_in_any_order_and_when_made_again(some):
    again = make_sequence(some.name, PLANS[some.name])
    frames = (30, 3, 17)
    seen = {frame: some.observation(frame) for frame in sorted(frames)}
    for frame in frames:
        other = again.observation(frame)
        np.testing.assert_array_equal(other.words, seen[frame].words)
        np.testing.assert_array_equal(other.foreground, seen[frame].foreground)


def test_a_shorter_sequence_begins_alike(some):
    short = some.first(5)
    assert short.frame_count == len(short.truth.frame_numbers) == 5
    np.testing.assert_array_equal(short.truth.markers, some.truth.markers[:5])
    np.testing.assert_array_equal(short.observation(4).words, some.observation(4).words)
    assert some.first(None).frame_count == some.first(10**6).frame_count == some.frame_count


def test_silhouettes_are_opencvs_up_to_the_boundary(some):
    recording, frame = some.recording, 25
    drawn = draw_silhouettes(some.rig, recording.vertices(frame), recording.body.skin.face)
    silhouettes = recording.segmentation.silhouettes(some.rig, recording.vertices(frame))
    for ours, theirs in zip(silhouettes, drawn, strict=True):
        assert (ours ^ theirs).sum() < BOUNDARY * theirs.sum()


def test_faults_spoil_the_masks_but_leave_most(sequence):
    overlap = []
    for frame in (0, 60, 120):
        silhouettes = sequence.recording.segmentation.silhouettes(sequence.rig, sequence.recording.vertices(frame))
        for mask, silhouette in zip(sequence.recording.masks(frame), silhouettes, strict=True):
            if mask.any():
                overlap.append((mask & silhouette).sum() / (mask | silhouette).sum())
    assert min(overlap) > 0.70
    assert 0.85 < np.mean(overlap) < 0.96


def test_cameras_drop_out_now_and_then_but_never_at_the_start(sequence):
    recording = sequence.recording
    out = np.array([[recording.segmentation.dropped_out(k, f) for k in range(7)] for f in range(sequence.frame_count)])
    assert not out[0].any()
    assert out.any()
    assert out.mean() < 0.05
    frame = int(out.any(axis=1).argmax())
    np.testing.assert_array_equal(sequence.observation(frame).foreground == 0, out[frame])


# The parts


def test_a_square_fills_whole_pixels():
    corners = np.array([[2.0, 1.0], [2.0, 4.0], [7.0, 4.0], [7.0, 1.0]])
    filled = fill(corners, np.roll(corners, -1, axis=0), np.ones(4), 10, 8)
    expected = np.zeros((8, 10), bool)
    expected[1:4, 2:7] = True
    np.testing.assert_array_equal(filled, expected)


def test_what_leaves_the_image_is_cut_off():
    corners = np.array([[-5.0, -5.0], [-5.0, 3.0], [50.0, 3.0], [50.0, -5.0]])
    filled = fill(corners, np.roll(corners, -1, axis=0), np.ones(4), 10, 8)
    assert filled[:3].all()
    assert not filled[3:].any()
    outside = fill(corners + 100, np.roll(corners, -1, axis=0) + 100, np.ones(4), 10, 8)
    assert not outside.any()


def test_an_open_surface_ends_in_an_outline():
    quad = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    surface = Surface.of(np.array([[0, 1, 2, 3]]))
    facing = surface.facing(quad, np.array([[0.5, 0.5, 3.0], [0.5, 0.5, -3.0], [0.0, 0.0, 1e6]]))
    assert facing[:, 0].tolist() == [True, False, True]
    assert len(surface.contour(facing[0])[0]) == 4
    assert len(surface.contour(facing[1])[0]) == 0


def test_perfect_contrast_changes_nothing():
    mask = np.zeros((60, 60), bool)
    mask[20:40, 10:50] = True
    empty = np.zeros_like(mask)
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(segment(mask, mask, [], Contrast(), rng), mask)
    assert segment(mask, empty, [], Contrast(halo=2.0), rng)[30, 51]
    assert not segment(empty, mask, [], Contrast(shadow=0.5), rng).any()
    assert Contrast(halo=1.0, shadow=0.6, dropouts=2.0).worse(2.0).shadow < 1


def test_least_jerk_paths_start_and_end_at_rest():
    track = Track(np.array([1.0, 2.0]))
    track.out_and_back(0.5, 0.4, 0.1, 0.3, (1.0, -1.0))
    values = track.at(np.array([0.0, 0.9, 0.95, 2.0]))
    np.testing.assert_allclose(values, [[1, 2], [2, 1], [2, 1], [1, 2]], atol=1e-12)
    s = np.linspace(0, 1, 1001)
    assert np.diff(minimum_jerk(s)).max() * 1000 == pytest.approx(1.875, rel=1e-3)  # of the mean speed


# As scenes


def test_a_written_sequence_is_a_scene_with_the_same_masks(tmp_path):
    short = SEQUENCES["S2/Box"].first(3)
    scene = load_scene(write_sequence(tmp_path / "S2" / "Box", short))
    assert (scene.name, scene.fps, scene.frame_count) == ("S2/Box", FPS, 3)
    for frame, seen in enumerate(scene.observations()):
        np.testing.assert_array_equal(seen.words, short.observation(frame).words)
    np.testing.assert_allclose(scene.rig().t, short.rig.t, atol=1e-9)
    subject = read_subject(scene.subject)
    np.testing.assert_allclose(subject.pose, short.subject.pose, atol=1e-12)
    np.testing.assert_allclose(load_truth(scene.truth).markers, short.truth.markers, atol=1e-6)


def test_make_writes_what_is_asked_for(tmp_path, capsys):
    folder = tmp_path / "made"
    argv = ["study", "make", str(folder), "--sequence", "S1/Gestures", "--sequence", "S3/Box", "--frames", "2"]
    assert main([*argv, "--quiet"]) == 0
    said = capsys.readouterr().out.split()
    assert said == [str(folder / name / "scene.toml") for name in ("S1/Gestures", "S3/Box")]
    assert sorted(path.name for path in (folder / "S3" / "Box" / "masks" / "BW4").iterdir()) == ["0000.png", "0001.png"]
    assert main([*argv, "--quiet"]) == 3  # the folder holds files
    assert "--force" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--sequence", "S4/Jog"], "S1/Walking"),
        (["--frames", "0"], "at least 1"),
        (["--clip", "walk.bvh"], "one --sequence"),
    ],
)
def test_make_says_which_flag_is_wrong(tmp_path, capsys, flags, says):
    assert main(["study", "make", str(tmp_path / "made"), *flags]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "made").exists()


def test_a_recording_of_a_body_out_of_view_is_empty():
    recording = SEQUENCES["S1/Box"].recording
    poses = recording.poses[:1].copy()
    poses[:, 0] += 40.0
    away = replace(recording, poses=poses, rig=recording.rig.select(("C2",)))
    assert not away.masks(0)[0].any()
