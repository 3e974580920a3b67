"""HumanEva-I: a made-up data set in its layout becomes a scene, and every part of it obeys the law it was made by."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import cv2
import humaneva_writer as made
import numpy as np
import pytest

from mmocap_warp import cli
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import project
from mmocap_warp.cli.console import OK
from mmocap_warp.formats.datasets.dataset_scene import DatasetScene
from mmocap_warp.formats.humaneva.humaneva_files import StreamOffset, read_ofs, synchronise
from mmocap_warp.formats.humaneva.sequence import (
    CAMERAS,
    FIRST_FRAME,
    SEQUENCES,
    read_humaneva,
)
from mmocap_warp.formats.humaneva.vicon_points import MARKERS
from mmocap_warp.formats.truth_file import load_truth
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.masks.frames import open_video
from mmocap_warp.result.result import Result
from mmocap_warp.result.truth import Truth
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.synthesis.footage.faults import draw_silhouettes

FRAMES = made.LAST - FIRST_FRAME + 1
HALF_FRAME = 0.5 + 0.05  # of video; scales differ by a thousandth from camera to camera
CALIBRATION_TOLERANCE = 1e-4  # [px] the published rotations have six digits
MARKER_TOLERANCE = 1e-6  # [m] single precision
SWING_TOLERANCE = 3e-4  # [m] what swings is not on the straight line between two frames of the motion capture


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "HumanEva_I"
    made.write_humaneva(folder)
    return folder


@pytest.fixture(scope="module")
def sequence(root: Path) -> DatasetScene:
    return read_humaneva(root, "S1", "Walking", last=str(made.LAST))


@pytest.fixture(scope="module")
def scene(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """What the command writes."""
    folder = tmp_path_factory.mktemp("scenes") / "s1-walking"
    assert cli.main([*command(root, folder), "--quiet"]) == OK
    return load_scene(folder)


def command(root: Path, folder: Path, last: int = made.LAST) -> list[str]:
    """What writes the sequence up to a frame as a scene."""
    return ["dataset", "humaneva", str(root), "S1", "Walking", str(FIRST_FRAME), str(last), "-o", str(folder)]


@pytest.fixture(scope="module")
def truth(scene: Scene) -> Truth:
    return load_truth(scene.truth)


@pytest.fixture
def positions(root: Path) -> np.ndarray:
    """Where the scene's frames lie in the motion capture, counted from 1."""
    sync = synchronise([read_ofs(root / f"S1/Sync_Data/Walking_1_({camera}).ofs") for camera in CAMERAS])
    return sync.mocap_position(np.arange(FIRST_FRAME, made.LAST + 1))


def test_the_scene_has_the_frames_and_cameras_of_the_sequence(scene):
    assert scene.calibrated.names == CAMERAS
    assert scene.frame_count == FRAMES
    assert scene.fps == 60
    assert scene.calibrated.up == "+z"
    assert scene.name == "S1 Walking"


def test_no_image_is_copied(scene):
    assert {path.name for path in scene.directory.iterdir()} == {"scene.toml", "calibration.toml", "truth.usdc"}


def test_the_rig_projects_as_opencv_does_with_the_numbers_of_the_files(scene, root):
    points = np.random.default_rng(0).uniform((-0.6, -0.6, 0), (0.6, 0.6, 1.8), (50, 3))
    seen = project(scene.calibrated, points)
    for k, camera in enumerate(CAMERAS):
        numbers = [float(line) for line in (root / f"S1/Calibration_Data/{camera}.cal").read_text().split()]
        fx, fy, cx, cy, _, *lens = numbers[:10]
        R, t = np.reshape(numbers[10:19], (3, 3)), np.array(numbers[19:22])
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        known, _ = cv2.projectPoints(1000 * points, cv2.Rodrigues(R)[0], t, K, np.array(lens))
        assert np.abs(seen[k] - known[:, 0]).max() < CALIBRATION_TOLERANCE


def test_each_camera_shows_the_same_moment_to_half_a_frame(scene, positions):
    """A video's frame has the time that its own .ofs says; the scene may pick none that another frame would beat."""
    for source in scene.cameras:
        frame = np.arange(FRAMES) + source.frame_offset + 1
        late = (made.mocap_index(source.name, frame) - positions) / 2
        assert np.abs(late).max() <= HALF_FRAME


def test_the_masks_are_the_figure_at_that_moment(scene, positions):
    """Against silhouettes at the true time, and much better than a few frames later."""
    poser = Poser(made.subject().body, made.subject().root_base)
    vertices = poser.vertices(made.poses_at(positions))

    def overlap(masks: list[np.ndarray], frame: int) -> float:
        known = draw_silhouettes(scene.rig(), vertices[frame], made.subject().body.skin.face)
        return float(np.mean([(a & b).sum() / (a | b).sum() for a, b in zip(masks, known, strict=True)]))

    masks = list(scene.masks())
    now = [overlap(masks[f], f) for f in range(FRAMES)]
    later = [overlap(masks[f], f + 4) for f in range(FRAMES - 4)]
    assert min(now) > 0.75
    assert max(later) < np.mean(now) - 0.1


def test_markers_are_where_the_figure_carried_them(truth, positions):
    poser = Poser(made.subject().body, made.subject().root_base)
    vertices = poser.vertices(made.poses_at(positions))
    assert truth.marker_names == MARKERS
    known = vertices[:, [made.marker_vertices()[name] for name in MARKERS]]
    seen = np.isfinite(truth.markers)
    assert seen.any(axis=(1, 2)).sum() >= FRAMES // 2
    assert np.abs(truth.markers - known)[seen].max() < SWING_TOLERANCE


def test_markers_are_interpolated_between_frames_of_the_motion_capture(truth, positions):
    before, after = (made.captured_points(whole(positions)) for whole in (np.floor, np.ceil))
    share = (positions - np.floor(positions))[:, None]
    assert 0 < share.min() < share.max() < 1
    for i, name in enumerate(MARKERS):
        known = (1 - share) * before[name] + share * after[name]
        seen = np.isfinite(truth.markers[:, i, 0])
        assert np.abs(truth.markers[:, i] - known)[seen].max() < MARKER_TOLERANCE


def test_a_frame_is_without_truth_if_a_marker_is_lost_on_either_side_of_it(truth, positions):
    lost = {frame for frames in made.LOST.values() for frame in frames}
    invalid = np.array([bool({int(np.floor(p)), int(np.ceil(p))} & lost) for p in positions])
    assert 0 < invalid.sum() < FRAMES
    assert np.isnan(truth.markers[invalid]).all()
    assert np.isnan(truth.joints[invalid]).all()
    assert np.isfinite(truth.markers[~invalid]).all()
    assert np.isfinite(truth.joints[~invalid]).all()


def test_frames_after_the_motion_capture_have_no_truth(root, positions, tmp_path):
    shorter = made.copied(root, tmp_path)
    points = made.captured_points(np.arange(1, 41))
    made.write_c3d(shorter / "S1/Mocap_Data/Walking_1.c3d", points, {})
    read = read_humaneva(shorter, "S1", "Walking", last=str(made.LAST))
    inside = positions <= 40
    assert 0 < inside.sum() < FRAMES
    assert (np.isfinite(read.truth.markers).all(axis=(1, 2)) == inside).all()


def test_the_background_clip_is_the_one_that_looks_like_the_recording(scene):
    assert {source.background.path.name for source in scene.cameras} == {
        f"Background_2_({name}).avi" for name in CAMERAS
    }


def offsets(scene: DatasetScene) -> list[int]:
    return [camera.frame_offset for camera in scene.cameras]


def test_a_range_of_ones_own_starts_at_its_first_frame(root, sequence):
    later = read_humaneva(root, "S1", "Walking", first="9", last="12")
    assert later.frames == 4
    assert offsets(later) == [offset + 3 for offset in offsets(sequence)]
    np.testing.assert_array_equal(later.truth.markers, sequence.truth.markers[3:7])


def test_names_in_other_case_and_folders_of_images_are_read_too(root, sequence, tmp_path):
    other = made.copied(root, tmp_path)
    (other / "S1/Calibration_Data").rename(other / "S1/Calibration_DATA")
    (other / "S1/Calibration_DATA/BW1.cal").rename(other / "S1/Calibration_DATA/bw1.CAL")
    video = other / "S1/Image_Data/Walking_1_(C2).avi"
    folder = video.with_suffix("")
    folder.mkdir()
    for i, image in enumerate(open_video(sequence.cameras[1].video).read()):
        cv2.imwrite(str(folder / f"{i + 1:04d}.png"), image)
    video.unlink()
    read = read_humaneva(other, "S1", "Walking", last=str(made.LAST))
    assert read.cameras[1].video == folder
    assert offsets(read) == offsets(sequence)
    np.testing.assert_array_equal(read.rig.K, sequence.rig.K)


def test_the_forearm_marker_may_have_its_other_name(root, sequence, tmp_path):
    other = made.copied(root, tmp_path)
    points = made.captured_points(np.arange(1, made.MOCAP_FRAMES + 1))
    points = {name.replace("FRM", "FRA"): place for name, place in points.items()}
    made.write_c3d(other / "S1/Mocap_Data/Walking_1.c3d", points, made.LOST)
    read = read_humaneva(other, "S1", "Walking", last=str(made.LAST))
    np.testing.assert_array_equal(read.truth.markers, sequence.truth.markers)


def test_without_vicons_segments_there_are_markers_but_no_joints(root, tmp_path, capsys):
    other = made.copied(root, tmp_path)
    points = made.captured_points(np.arange(1, made.MOCAP_FRAMES + 1))
    made.write_c3d(other / "S1/Mocap_Data/Walking_1.c3d", {name: points[name] for name in MARKERS}, {})
    assert cli.main(command(other, tmp_path / "scene")) == OK
    out, err = capsys.readouterr()
    assert f"{FRAMES} frames, {FRAMES} with truth" in out
    assert "no joints: Walking_1.c3d has no PELO" in err
    truth = load_truth(tmp_path / "scene" / "truth.usdc")
    assert len(truth.marker_names) == len(MARKERS)
    assert truth.joint_names == ()


def test_videos_that_start_elsewhere_than_published_are_told(root, tmp_path, capsys):
    assert cli.main(command(root, tmp_path / "scene")) == OK
    assert "Critical_Update_OFS_files" in capsys.readouterr().err


def test_the_papers_nine_sequences_have_the_papers_number_of_frames():
    nine = [last for (_, action), (last, _) in SEQUENCES.items() if action in ("Walking", "Gestures", "Box")]
    assert len(nine) == 9
    assert sum(nine) == 8366


def test_synchronisation_by_hand_where_a_video_starts_last():
    """Motion capture frame 41 is frames 21 and 31: at frame 1 of the first it is 1, so the second starts at 11."""
    sync = synchronise([StreamOffset(21, 41, 2), StreamOffset(31, 41, 2)])
    assert sync.start.tolist() == [1, 11]
    assert sync.mocap_start == pytest.approx(1)
    assert sync.mocap_position(np.array([1, 2, 6])).tolist() == pytest.approx([1, 3, 11])


def test_synchronisation_by_hand_where_the_motion_capture_starts_last():
    """Motion capture frame 5 is frames 11 and 10, so its frame 1 is frames 9 and 8."""
    sync = synchronise([StreamOffset(11, 5, 2), StreamOffset(10, 5, 2)])
    assert sync.start.tolist() == [9, 8]
    assert sync.mocap_start == 1


def test_starts_are_rounded_as_matlab_does():
    """Halves go up, not to the even number."""
    sync = synchronise([StreamOffset(1, 1, 2), StreamOffset(2, 0, 2), StreamOffset(3, 0, 2)])
    assert sync.start.tolist() == [1, 3, 4]  # 1, 2.5, 3.5


def test_the_true_motion_is_judged_faultless(scene, truth, positions, tmp_path, capsys):
    """End to end: a result with the law's poses, through ``mmocap eval``, errs by nothing in markers and joints."""
    result = true_result(scene, positions)
    write_result(tmp_path / "true.usdc", result)
    assert cli.main(["eval", str(tmp_path / "true.usdc"), "--scene", str(scene.path), "--json"]) == OK
    report = json.loads(capsys.readouterr().out)
    assert report["marker_error_mm"] < 0.05
    assert report["median_mm_by_group"]["knees"] < 0.05
    assert report["median_mm_by_group"]["wrists"] < 25  # HumanEva's are not where Vicon's are
    series = np.array(report["series"]["marker_error_mm"], float)
    assert (np.isnan(series[0]) == np.isnan(truth.markers[:, 0, 0])).all()


def test_a_frame_too_late_is_noticed(scene, positions, tmp_path, capsys):
    write_result(tmp_path / "late.usdc", true_result(scene, positions + 2))
    assert cli.main(["eval", str(tmp_path / "late.usdc"), "--scene", str(scene.path), "--json"]) == OK
    assert json.loads(capsys.readouterr().out)["median_joint_mm"] > 10


def test_the_scene_is_tracked_as_any_other(root, tmp_path, capsys):
    scene = tmp_path / "scene"
    assert cli.main([*command(root, scene, 8), "--quiet"]) == OK
    start = replace(made.subject(), pose=made.poses_at(np.array([22.5]))[0])
    write_subject(tmp_path / "subject.usdc", start)
    track = ["track", str(scene), "--subject", str(tmp_path / "subject.usdc"), "-o", str(tmp_path / "result.usdc")]
    capsys.readouterr()
    assert cli.main([*track, "--evaluations", "60", "--device", "cpu", "--quiet", "--json"]) == OK
    report = json.loads(capsys.readouterr().out)
    assert report["frames"] == 3
    assert report["mean_iou"] > 0.7
    assert report["marker_error_mm"] < 60


def test_paths_with_quotes_and_umlauts_survive_the_scene_file(root, tmp_path):
    odd = made.copied(root, tmp_path / 'a "küche" \\ ')
    scene = tmp_path / "scene"
    assert cli.main([*command(odd, scene, 8), "--quiet"]) == OK
    named = tomllib.loads((scene / "scene.toml").read_text(encoding="utf-8"))["cameras"]["C1"]["video"]
    assert Path(named) == odd / "S1/Image_Data/Walking_1_(C1).avi"


def true_result(scene: Scene, positions: np.ndarray) -> Result:
    """What a perfect tracker would answer."""
    poses = made.poses_at(positions)[None]
    ones = np.ones((1, FRAMES))
    return Result(
        subject=made.subject(),
        cameras=scene.rig(),
        fps=scene.fps,
        frame_numbers=np.arange(FRAMES),
        pose=poses,
        cost=0 * ones,
        iou=np.ones((1, FRAMES, len(CAMERAS))),
        evaluations=ones.astype(int),
        status=np.zeros((1, FRAMES), np.int8),
        seconds=1.0,
        config={},
        versions={},
    )
