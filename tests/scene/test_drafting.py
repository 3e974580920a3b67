"""``mmocap init``: what it makes of the folders that people and other programs make."""

from __future__ import annotations

import json
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from ball_scene import FRAMES, HEIGHT, RIG, WIDTH, ball_mask, ball_scene, write_video
from calibration_files import caliscope, humaneva, multical, write_colmap_model, write_easymocap
from drafted import lay_out, project, sources, videos

from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.usd.usd_camera import write_usd_cameras
from mmocap_warp.scene.drafting import draft_scene
from mmocap_warp.scene.scene_toml import load_scene

__all__ = ["ball_scene", "project", "videos"]


def test_a_plain_folder(videos: Path) -> None:
    write_toml_rig(videos / "my cameras.toml", RIG)
    assert sources(videos) == {name: f"{name}.mkv" for name in RIG.names}
    assert draft_scene(videos).missing == []


def test_a_pose2sim_project(videos: Path, project: Path) -> None:
    (project / "Config.toml").write_text("[project]\nframe_rate = 'auto'\n")
    lay_out(videos, project, "videos/{}.mkv")
    lay_out(videos, project, "pose/{}_pose.mkv")
    (project / "calibration/intrinsics/int_cam01_img").mkdir(parents=True)
    cv2.imwrite(str(project / "calibration/intrinsics/int_cam01_img/0.png"), np.zeros((9, 9), np.uint8))
    write_toml_rig(project / "calibration" / "Calib_scene.toml", RIG)
    assert sources(project) == {name: f"videos/{name}.mkv" for name in RIG.names}
    assert draft_scene(project).project == "Pose2Sim"


def test_a_trial_of_a_pose2sim_session(videos: Path, project: Path) -> None:
    """Its calibration lies in the session's folder, above it."""
    write_toml_rig(write_config(project) / "Calib.toml", RIG)
    for trial in ("Trial_1", "Trial_2"):
        lay_out(videos, project, f"{trial}/videos/{{}}.mkv")
    assert set(sources(project / "Trial_2")) == set(RIG.names)
    assert draft_scene(project / "Trial_2").calibration == (project / "calibration/Calib.toml").resolve()
    with pytest.raises(InputError, match=r"several recordings: Trial_1/videos/\*, Trial_2/.*: mmocap init .*Trial_1"):
        draft_scene(project)


def write_config(project: Path) -> Path:
    (project / "Config.toml").touch()
    (project / "calibration").mkdir()
    return project / "calibration"


@pytest.mark.parametrize("images", [True, False])
def test_an_easymocap_project(videos: Path, project: Path, images: bool) -> None:
    """Sizes come from the videos; the images that were taken out of them are no second recording."""
    write_easymocap(project, RIG, "R", size=False)
    lay_out(videos, project, "videos/{}.mkv")
    for k, name in enumerate(RIG.names):
        for folder in ("images", "mask-schp") if images else ("mask-schp",):
            (project / folder / name).mkdir(parents=True)
            for frame in range(FRAMES):
                image = ball_mask(k, frame).astype(np.uint8) * 255
                cv2.imwrite(str(project / folder / name / f"{frame:06d}.jpg"), image)
    assert sources(project) == {name: f"videos/{name}.mkv" for name in RIG.names}
    draft = draft_scene(project)
    assert draft.project == "EasyMocap"
    assert 'masks = "mask-schp/cam01"' in draft.text
    (project / "stills").mkdir()
    for number in (1, 2, 3, 5):  # of which some were deleted
        cv2.imwrite(str(project / "stills" / f"IMG_{number:04d}.jpg"), np.zeros((HEIGHT, WIDTH), np.uint8))
    assert draft_scene(project).cameras == draft.cameras


def test_images_that_begin_at_other_numbers_are_told(project: Path) -> None:
    write_toml_rig(project / "calibration.toml", RIG)
    for k, name in enumerate(RIG.names):
        (project / "images" / name).mkdir(parents=True)
        for frame in range(2):
            image = project / "images" / name / f"{10 * k + frame:06d}.jpg"
            cv2.imwrite(str(image), np.zeros((HEIGHT, WIDTH), np.uint8))
    (told,) = (line for line in draft_scene(project).found if "unlike numbers" in line)
    assert told.startswith("images begin with unlike numbers (cam01 0, cam02 10, cam03 20)")


def test_masks_that_begin_at_other_numbers_are_told_though_there_are_videos(videos: Path, project: Path) -> None:
    write_toml_rig(project / "calibration.toml", RIG)
    lay_out(videos, project, "videos/{}.mkv")
    for k, name in enumerate(RIG.names):
        (project / "masks" / name).mkdir(parents=True)
        for frame in range(2):
            image = project / "masks" / name / f"{3 * k + frame:04d}.png"
            cv2.imwrite(str(image), ball_mask(k, frame).astype(np.uint8) * 255)
    assert any("unlike numbers (cam01 0, cam02 3, cam03 6)" in line for line in draft_scene(project).found)


def test_images_do_not_tell_the_rate(project: Path) -> None:
    write_easymocap(project, RIG, "R", size=False)
    for name in RIG.names:
        (project / "images" / name).mkdir(parents=True)
        for frame in range(2):
            cv2.imwrite(str(project / "images" / name / f"{frame:06d}.jpg"), np.zeros((HEIGHT, WIDTH), np.uint8))
    draft = draft_scene(project)
    assert any("rate: give fps" in line for line in draft.missing)
    (project / "scene.toml").write_text(draft.text)
    with pytest.raises(InputError, match="'fps' is missing"):
        load_scene(project)


@pytest.mark.parametrize("export", ["camera_array_aniposelib.toml", "calibration/extrinsic/capture_volume/a.toml"])
def test_a_caliscope_project(videos: Path, project: Path, export: str) -> None:
    """Cameras are matched by number; calibration videos are no recording, and what it can export is read."""
    own = dict(zip(RIG.names, ("cam_1", "cam_2", "cam_3"), strict=True))
    lay_out(videos, project, "calibration/extrinsic/{}.mkv", **own)
    lay_out(videos, project, "calibration/intrinsic/{}.mkv", **own)
    lay_out(videos, project, "recordings/walk_1/{}.mkv", **own)
    unplaced = caliscope(RIG).split("[cameras.1]")[0].replace("rotation_count = 0", "rotation_count = 0\nmatrix = []")
    (project / "camera_array.toml").write_text(unplaced)
    for name in ("camera_array.TOML", "camera_array.toml"):
        (project / "camera_array.toml").rename(project / name)
        with pytest.raises(InputError, match=f"{name}: is a camera array of Caliscope that does not say where"):
            draft_scene(project)
        (project / name).rename(project / "camera_array.toml")
    volume = project / "calibration/extrinsic/capture_volume"
    volume.mkdir()
    (volume / "camera_array.toml").write_text(caliscope(RIG))
    assert list(sources(project)) == ["cam_1", "cam_2", "cam_3"]
    shutil.rmtree(volume)
    (project / export).parent.mkdir(exist_ok=True)
    write_toml_rig(project / export, RIG)
    for folder in (project, project / "recordings/walk_1"):
        found = sources(folder)
        assert [Path(path).name for path in found.values()] == ["cam_1.mkv", "cam_2.mkv", "cam_3.mkv"]
    assert draft_scene(project).project == "Caliscope"


def test_a_colmap_model(videos: Path) -> None:
    """It has no unit, and its file of images is no calibration of its own."""
    write_colmap_model(videos, RIG)
    assert sources(videos) == {name: f"{name}.mkv" for name in RIG.names}
    draft = draft_scene(videos)
    assert draft.missing == ['the unit of the calibration\'s lengths: units = "m" under [cameras] is a guess']
    assert draft.calibration == videos / "cameras.txt"
    assert not any("also there" in line for line in draft.text.splitlines())


def test_a_multical_calibration(videos: Path) -> None:
    world = replace(RIG, R=RIG.R @ RIG.R[0].T, t=RIG.t - RIG.R @ RIG.R[0].T @ RIG.t[0])
    (videos / "calibration.json").write_text(multical(world))
    draft = draft_scene(videos)
    assert draft.cameras == RIG.names
    assert 'up = "-y"' in draft.text  # the world is the first camera's
    (videos / "scene.toml").write_text(draft.text)
    load_scene(videos, masks=False)


def test_cameras_of_a_usd_file(videos: Path) -> None:
    """One whose name says so: results and bodies lie about, too."""
    write_usd_cameras(videos / "calibration.usda", RIG)
    write_usd_cameras(videos / "other.usda", RIG)
    assert set(sources(videos)) == set(RIG.names)
    assert draft_scene(videos).calibration == videos / "calibration.usda"


def test_cameras_of_humaneva(videos: Path) -> None:
    """The size is that of all videos."""
    (videos / "Calibration_Data").mkdir()
    for k, name in enumerate(RIG.names):
        (videos / f"Calibration_Data/{name}.cal").write_text(humaneva(RIG, k))
    assert set(sources(videos)) == set(RIG.names)
    assert draft_scene(videos).calibration == videos / "Calibration_Data/cam01.cal"


def test_sizes_are_those_of_videos_whose_names_have_a_cameras_among_words(videos: Path, project: Path) -> None:
    (project / "Calibration_Data").mkdir()
    for k, name in enumerate(RIG.names):
        (project / f"Calibration_Data/{name}.cal").write_text(humaneva(RIG, k))
    lay_out(videos, project, "Image_Data/Walking_1_({}).mkv")
    write_video(project / "other.mkv", [np.zeros((40, 40, 3), np.uint8)])
    assert set(sources(project)) == set(RIG.names)


def test_an_opencap_session(videos: Path, project: Path) -> None:
    """Its pickles are refused by name, and once they are converted its trials are found."""
    own = dict(zip(RIG.names, ("Cam1", "Cam2", "Cam3"), strict=True))
    (project / "sessionMetadata.yaml").touch()
    lay_out(videos, project, "Videos/{}/InputMedia/walk1/walk1.mkv", **own)
    for name in own.values():
        (project / "Videos" / name / "cameraIntrinsicsExtrinsics.pickle").write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(InputError, match=r"IntrinsicsExtrinsics\.pickle: is a Python pickle.*convert_from = 'opencap'"):
        draft_scene(project)
    write_toml_rig(project / "Calib.toml", RIG)
    assert list(sources(project).values())[2] == "Videos/Cam3/InputMedia/walk1/walk1.mkv"
    assert draft_scene(project).project == "OpenCap"
    lay_out(videos, project, "Videos/{}/InputMedia/jump/jump.mkv", **own)
    with pytest.raises(InputError, match=r"several recordings: .*jump.*walk1"):
        draft_scene(project)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("calibration/session.xcp", "is a calibration of Vicon, which cannot be read yet; convert it with Pose2Sim"),
        ("calibration/cameras.json", "is a calibration of JSON, which cannot be read yet; write it as a Pose2Sim"),
        ("calib.pkl", "is a Python pickle"),
        ("camera_parameters.pickle", "is a Python pickle"),
        ("CALIB.PKL", "is a Python pickle"),
        ("camera_parameters.Pickle", "is a Python pickle"),
        ("intri.yml", "has no extri.yml beside it"),
        ("Calib/deep/rig.npz", "is a calibration of NumPy"),
    ],
)
def test_calibrations_that_cannot_be_read_are_refused_by_name(videos: Path, name: str, words: str) -> None:
    (videos / name).parent.mkdir(parents=True, exist_ok=True)
    (videos / name).touch()
    with pytest.raises(InputError) as caught:
        draft_scene(videos)
    assert str(caught.value).startswith(f"{videos / name}: {words}")


def test_other_files_are_no_calibration(videos: Path) -> None:
    """By their own names, whatever the folders above are called."""
    folder = videos.rename(videos.with_name("camera calibrations"))
    for name in ("notes.json", "camera_notes.json", "weights.npz", "settings.toml", "poses.pkl"):
        (folder / name).touch()
    (folder.parent / "calib.json").touch()  # nobody's project
    assert draft_scene(folder).calibration is None


def test_one_video_alone_is_no_recording(videos: Path) -> None:
    for name in RIG.names[1:]:
        (videos / f"{name}.mkv").unlink()
    with pytest.raises(InputError, match="no camera is known"):
        draft_scene(videos)


def test_without_a_calibration(videos: Path) -> None:
    draft = draft_scene(videos)
    assert draft.cameras == RIG.names
    assert draft.missing[0].startswith("a calibration: put a Pose2Sim .toml")
    (videos / "scene.toml").write_text(draft.text)
    assert "'mmocap calib solve'" in draft.missing[0]
    with pytest.raises(InputError, match=r"'calibration' is missing.*calib solve"):
        load_scene(videos, masks=False)


def test_masks_without_videos_and_calibration(project: Path) -> None:
    """All that 'mmocap calib solve' needs, but for the rate."""
    for name in RIG.names:
        (project / "masks" / name).mkdir(parents=True)
        for frame in range(2):
            cv2.imwrite(str(project / "masks" / name / f"{frame:06d}.png"), np.eye(HEIGHT, WIDTH, dtype=np.uint8))
    draft = draft_scene(project)
    assert draft.cameras == RIG.names
    (project / "scene.toml").write_text(draft.text.replace("# fps", "fps"))
    assert [camera.name for camera in load_scene(project, calibrated=False).cameras] == list(RIG.names)


def test_millimetres_are_told_from_metres(videos: Path) -> None:
    from dataclasses import replace

    write_toml_rig(videos / "calibration.toml", replace(RIG, t=1000 * RIG.t))
    assert 'units = "mm"' in draft_scene(videos).text
    assert len(sources(videos)) == 3


def test_a_background_is_named(videos: Path) -> None:
    assert draft_scene(videos).text.endswith('source = "recording"\n')  # a program's masks need a calibration
    write_toml_rig(videos / "calibration.toml", RIG)
    assert draft_scene(videos).text.endswith('source = "program"\n')
    assert any(
        "by MediaPipe, because not every camera has a picture of the background alone" in line
        for line in draft_scene(videos).found
    )
    lay_out(videos, videos, "empty/{}.mkv")
    assert 'source = "background_video"' in draft_scene(videos).text
    (videos / "plates").mkdir()
    for name in RIG.names:
        cv2.imwrite(str(videos / "plates" / f"{name}.png"), np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    draft = draft_scene(videos)
    assert 'source = "clean_plate"' in draft.text
    assert 'clean_plate = "plates/cam02.png"\n' in draft.text
    assert draft.missing == []
    (videos / "scene.toml").write_text(draft.text)
    assert load_scene(videos).foreground.source == "clean_plate"
    (videos / "plates" / "cam02.png").rename(videos / "plates" / "cm02.png")
    (videos / "scene.toml").unlink()
    draft = draft_scene(videos)
    assert "clean plates of cam02, which other cameras have: no file has their name" in draft.missing
    assert 'source = "program"' in draft.text


def test_cameras_of_other_lengths_and_rates(videos: Path) -> None:
    write_toml_rig(videos / "calibration.toml", RIG)
    black = [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * 4
    write_video(videos / "cam02.mkv", black)
    assert "frames = 4   # of the shortest: cam01 5, cam02 4, cam03 5" in draft_scene(videos).text
    writer = cv2.VideoWriter(str(videos / "cam02.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), 60, (WIDTH, HEIGHT))
    for _ in range(9):
        writer.write(black[0])
    writer.release()
    draft = draft_scene(videos)
    assert any("cam02: its video has 60 frames a second, others 30" in line for line in draft.missing)
    (videos / "scene.toml").write_text(draft.text)
    with pytest.raises(InputError, match="has 60 frames a second"):
        load_scene(videos, masks=False)
    (videos / "scene.toml").write_text(draft.text.replace("# fps = 60", "fps = 60"))
    assert load_scene(videos, masks=False).frame_count == FRAMES


@pytest.mark.parametrize(
    ("size", "bars", "words"),
    [
        ((80, 60), 0, "video_from_calibrated = { scale = 0.5, offset = [-0.25, -0.25] }"),
        ((160, 140), 10, "video_from_calibrated = { scale = 1, offset = [0, 10] }"),
        ((180, 120), 10, "video_from_calibrated = { scale = 1, offset = [10, 0] }"),
        ((160, 140), 0, "# MISSING: 160x140, the calibration 160x120"),
    ],
)
def test_a_video_of_another_size(videos: Path, size: tuple[int, int], bars: int, words: str) -> None:
    """Scaled, or scaled between black bars, or unknown."""
    write_toml_rig(videos / "calibration.toml", RIG)
    frame = np.full((size[1], size[0], 3), 120, np.uint8)
    if bars and size[1] > HEIGHT:
        frame[:bars] = frame[-bars:] = 5
    elif bars:
        frame[:, :bars] = frame[:, -bars:] = 5
    write_video(videos / "cam02.mkv", [frame] * FRAMES)
    draft = draft_scene(videos)
    assert f"\n{words}" in draft.text
    assert bool(draft.missing) == words.startswith("#")
    if not draft.missing:
        assert len(sources(videos)) == 3


def test_a_rotation_that_the_file_states_is_told(videos: Path) -> None:
    """The decoder turns the images; a calibration of images that are not turned is not of these."""
    write_toml_rig(videos / "calibration.toml", RIG)
    (videos / "cam02.mkv").unlink()
    writer = cv2.VideoWriter(str(videos / "cam02.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30, (WIDTH, HEIGHT))
    for _ in range(FRAMES):
        writer.write(np.full((HEIGHT, WIDTH, 3), 100, np.uint8))
    writer.release()
    data = bytearray((videos / "cam02.mp4").read_bytes())
    matrix = data.index(b"tkhd") + 44  # of the track: a quarter turn, and a shift back into the image
    turn = np.array([0, 1, 0, -1, 0, 0, HEIGHT, 0, 2**14]) << 16
    data[matrix : matrix + 36] = turn.astype(">i4").tobytes()
    (videos / "cam02.mp4").write_bytes(data)
    draft = draft_scene(videos)
    assert any("its images are turned by 90 degrees" in line for line in draft.found)
    assert any("without its rotation" in line and "ffmpeg -display_rotation 0" in line for line in draft.missing)


def test_cameras_of_unlike_exposure_are_told(videos: Path) -> None:
    write_toml_rig(videos / "calibration.toml", RIG)
    assert not any("than the others" in line for line in draft_scene(videos).found)
    write_video(videos / "cam02.mkv", [np.full((HEIGHT, WIDTH, 3), 20, np.uint8)] * FRAMES)
    assert any("cam02 is darker than others (mean gray 20, theirs" in line for line in draft_scene(videos).found)


def test_a_camera_without_a_video_is_told(videos: Path) -> None:
    write_toml_rig(videos / "calibration.toml", RIG)
    (videos / "cam03.mkv").unlink()
    draft = draft_scene(videos)
    assert draft.cameras == ("cam01", "cam02")
    assert draft.missing == ["videos of cam03, which the calibration has: the scene leaves them out"]


@pytest.mark.parametrize(
    ("prepare", "message"),
    [
        (lambda folder: [file.unlink() for file in folder.iterdir()], "holds no video and no folder of images"),
        (
            lambda folder: [
                file.rename(folder / f"{i}x.mkv") for i, file in enumerate(sorted(folder.glob("*.mkv")), 7)
            ],
            "is named after a camera \\(cam01, cam02, cam03\\)",
        ),
    ],
)
def test_folders_of_which_no_scene_can_be_made(videos: Path, prepare, message: str) -> None:
    prepare(videos)
    write_toml_rig(videos / "calibration.toml", RIG)
    with pytest.raises(InputError, match=message):
        draft_scene(videos)


def test_init_says_what_to_run_next_to_the_end_of_the_masks(videos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each command's last line is the next command, as a shell takes it."""
    folder = videos.rename(videos.with_name("a recording"))
    write_toml_rig(folder / "calibration.toml", RIG)
    for name in RIG.names:
        cv2.imwrite(str(folder / f"plate_{name}.png"), np.full((HEIGHT, WIDTH, 3), 100, np.uint8))
    step = shlex.join(["mmocap", "init", str(folder)])
    ran = []
    for _ in range(2):
        ran.append(shlex.split(step)[1])
        assert cli.main(shlex.split(step)[1:]) == console.OK
        step = capsys.readouterr().out.splitlines()[-1].removeprefix("next: ")
    assert ran == ["init", "cameras"]
    assert shlex.split(step) == ["mmocap", "mask", str(folder / "scene.toml"), "-o", str(folder / "masks")]
    assert len(list((folder / "axes").glob("*.png"))) == 3


def test_init_overwrites_only_when_told(videos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_toml_rig(videos / "calibration.toml", RIG)
    (videos / "scene.toml").write_text("mine")
    assert cli.main(["init", str(videos)]) == console.BAD_INPUT
    assert "scene.toml: exists already; give --force" in capsys.readouterr().err
    assert (videos / "scene.toml").read_text() == "mine"
    assert cli.main(["init", str(videos), "--force", "--json"]) == console.OK
    told = json.loads(capsys.readouterr().out)
    assert told["cameras"] == list(RIG.names)
    assert told["missing"] == []
    assert told["next"].startswith("mmocap cameras ")
    assert load_scene(videos, masks=False).frame_count == FRAMES
    assert cli.main(["init", str(videos / "none")]) == console.BAD_INPUT


def test_cameras_needs_no_masks(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nor videos; what needs masks says the three ways to get them."""
    text = (folder / "scene.toml").read_text()
    shutil.rmtree(folder / "masks")
    no_masks = "\n".join(line for line in text.splitlines() if not line.startswith("masks"))
    (folder / "scene.toml").write_text(no_masks)
    assert cli.main(["cameras", str(folder), "-o", str(tmp_path / "axes")]) == console.OK
    assert capsys.readouterr().out.splitlines()[-1].startswith("next: mmocap mask ")
    assert cli.main(["track", str(folder), "-o", str(tmp_path / "r.usdc")]) == console.BAD_INPUT
    told = capsys.readouterr().err
    assert all(word in told for word in ("'masks' is missing", "three ways", "mmocap mask", "SAM 2", "that you have"))
    bare = "\n".join(line for line in no_masks.splitlines() if not line.startswith(("video", "clean_plate")))
    (folder / "scene.toml").write_text(bare)
    assert cli.main(["cameras", str(folder), "-o", str(tmp_path / "gray")]) == console.OK
    assert len(list((tmp_path / "gray").iterdir())) == 3
