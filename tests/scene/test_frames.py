"""Which frames of a recording are tracked, and cameras of other rates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from ball_scene import FRAMES, HEIGHT, RIG, WIDTH, ball_mask, ball_scene, edit

from mmocap_warp.errors import InputError
from mmocap_warp.scene.frame_choice import FrameChoice, covering
from mmocap_warp.scene.scene_toml import load_scene

__all__ = ["ball_scene"]


@pytest.mark.parametrize(
    ("text", "chosen"),
    [
        ("4", range(10, 14)),
        ("20:30", range(20, 30)),
        ("20:30:3", range(20, 30, 3)),
        ("5:", range(5, 100)),
        (":7", range(7)),
        ("::10", range(0, 100, 10)),
        (":", range(100)),
    ],
)
def test_a_choice_of_frames(text: str, chosen: range) -> None:
    """A count is of the frames that there are; a range is of the recording's."""
    assert FrameChoice.parse(text).of(range(10, 60), 100) == chosen


@pytest.mark.parametrize(
    "text", ["", "a", "-1", "1.5", "3:2", "3:3", "1:2:0", "1:2:3:4", "-1:", "1e3", "\u0663", "9" * 10]
)
def test_what_is_no_choice(text: str) -> None:
    with pytest.raises(ValueError, match="frames = "):
        FrameChoice.parse(text)


@pytest.mark.parametrize("text", ["0", "51", "100:", "0:101", "100:101"])
def test_frames_that_there_are_not(text: str) -> None:
    with pytest.raises(ValueError, match=rf"frames = {text} is not in"):
        FrameChoice.parse(text).of(range(10, 60), 100)


@pytest.mark.parametrize("numbers", [[3], [3, 5, 7], [3, 5, 8], [0, 1, 2, 50, 51, 52, 60], [0, 4, 10, 12]])
def test_frame_numbers_lie_in_an_even_range(numbers: list[int]) -> None:
    frames = covering(numbers)
    assert set(numbers) <= set(frames)
    assert (frames[0], frames[-1]) == (numbers[0], numbers[-1])
    assert covering([3, 5, 7]) == range(3, 8, 2)
    assert covering([0, 4, 10, 12]) == range(0, 13, 2)


@pytest.mark.parametrize(
    ("written", "asked", "numbers"),
    [
        ("", None, [0, 1, 2, 3, 4]),
        ("frames = 3", None, [0, 1, 2]),
        ('frames = "1:4"', None, [1, 2, 3]),
        ('frames = "::2"', None, [0, 2, 4]),
        ('frames = "1:"', "2", [1, 2]),  # a count is of the frames that the scene names
        ('frames = "1:3"', "0:5:4", [0, 4]),  # a range takes their place
    ],
)
@pytest.mark.parametrize("source", ["masks", "clean_plate"])
def test_a_part_of_a_recording(folder: Path, written: str, asked: str | None, numbers: list[int], source: str) -> None:
    edit(folder, "fps = 30", f"fps = 30\n{written}")
    edit(folder, 'source = "masks"', f'source = "{source}"\nmin_area = 0\nmedian = 0\nclose = 0')
    scene = load_scene(folder, asked)
    assert (list(scene.frames), scene.frame_count, scene.recorded_frames) == (numbers, len(numbers), FRAMES)
    assert scene.rate == 30 / (numbers[1] - numbers[0])
    whole = replace(scene, first_frame=0, stride=1, frame_count=FRAMES)
    expected = [list(frames)[n] for frames in (list(whole.masks()), list(whole.images())) for n in numbers]
    for seen, same in zip([*scene.masks(), *scene.images()], expected, strict=True):
        for one, other in zip(seen, same, strict=True):
            np.testing.assert_array_equal(one, other)
    if source == "masks":
        np.testing.assert_array_equal(next(scene.masks())[1], ball_mask(1, numbers[0]))


def test_a_background_that_remembers_has_seen_the_frames_before(folder: Path) -> None:
    edit(folder, 'source = "masks"', 'source = "recording"\nmodel = "knn"\nkeep = "nearest"\nmin_area = 0')
    whole = list(load_scene(folder).masks())
    part = list(load_scene(folder, "0:5:2").masks())
    for masks, same in zip(part, whole[::2], strict=True):
        np.testing.assert_array_equal(masks[0], same[0])


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ('frames = "2:9"', r"\[scene\]: frames = 2:9 is not in 0:5 \(cam01 5, .*\); name frames that are there"),
        ('frames = "later"', r"frames = later is neither a count nor first:end"),
        ("frames = 1.5", r"frames = 1.5 is not a whole number"),
        ("frames = true", r"frames = True is not a whole number"),
    ],
)
def test_wrong_frames_in_a_scene(folder: Path, written: str, message: str) -> None:
    edit(folder, "fps = 30", f"fps = 30\n{written}")
    with pytest.raises(InputError, match=message):
        load_scene(folder)


def test_wrong_frames_that_are_asked_for(folder: Path) -> None:
    with pytest.raises(ValueError, match="frames = 6 is not in 1 to 5") as caught:
        load_scene(folder, "6")
    assert not isinstance(caught.value, InputError)


def test_cameras_of_other_lengths_need_an_end(folder: Path) -> None:
    (folder / "masks/cam02/0004.png").unlink()
    edit(folder, "fps = 30", 'fps = 30\nframes = "1:"')
    with pytest.raises(InputError, match=r"cameras differ in their number of frames: .*cam02 4.*; set frames = 4"):
        load_scene(folder)
    assert list(load_scene(folder, "1:4").frames) == [1, 2, 3]


def video_of(path: Path, fps: float, times: list[float], k: int = 1) -> None:
    """A white ball on black, as camera ``k`` sees it at these times [frames of 1/30 s]."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), fps, (WIDTH, HEIGHT))
    for time in times:
        writer.write(np.repeat(ball_mask(k, time)[..., None], 3, axis=2).astype(np.uint8) * 255)
    writer.release()


def test_a_video_of_another_rate_is_refused(folder: Path) -> None:
    video_of(folder / "cam02.mkv", 60, [0.5 * f for f in range(9)])
    with pytest.raises(InputError, match=r"cam02\.mkv has 60 frames a second, \[scene\] says 30; .* fps = 60 here"):
        load_scene(folder)


def test_masks_of_another_rate_are_refused(folder: Path) -> None:
    video_of(folder / "masks.mkv", 25, list(range(5)))
    edit(folder, "masks/cam02", "masks.mkv")
    with pytest.raises(InputError, match=r"masks\.mkv has 25 frames a second"):
        load_scene(folder)


@pytest.mark.parametrize(("fps", "count"), [(60, 9), (15, 3), (90, 13)])
def test_frames_of_another_rate_are_taken_by_time_when_asked(folder: Path, fps: int, count: int) -> None:
    """The camera's frame nearest in time is taken, and its offset counts its own frames."""
    times = [f * 30 / fps for f in range(count)]
    video_of(folder / "other.mkv", fps, times)
    edit(folder, "masks/cam02", f'other.mkv"\nfps = {fps}\n#"')
    edit(folder, 'video = "cam02.mkv"', 'video = "other.mkv"')
    scene = load_scene(folder)
    assert scene.frame_count == FRAMES
    for frame, masks in enumerate(scene.masks()):
        nearest = times[round(frame * fps / 30)]
        assert abs(nearest - frame) <= 15 / fps
        np.testing.assert_array_equal(masks[1], ball_mask(1, nearest))
        np.testing.assert_array_equal(masks[0], ball_mask(0, frame))
    later = replace(scene.cameras[1], frame_offset=1)
    (first,) = replace(scene, cameras=(scene.cameras[0], later, scene.cameras[2])).masks(count=1)
    np.testing.assert_array_equal(first[1], ball_mask(1, times[1]))


def test_a_camera_of_a_lower_rate_covers_the_time_to_half_a_frame_after_its_last(folder: Path) -> None:
    video_of(folder / "other.mkv", 15, [0.0, 2.0])
    edit(folder, "masks/cam02", 'other.mkv"\nfps = 15\n#"')
    with pytest.raises(InputError, match="cam01 5, cam02 3, cam03 5"):
        load_scene(folder)


def test_a_file_that_is_wrong_about_its_rate(folder: Path) -> None:
    video_of(folder / "other.mkv", 25, list(range(5)))
    edit(folder, "masks/cam02", 'other.mkv"\nfps = 30\n#"')
    for frame, masks in enumerate(load_scene(folder).masks()):
        np.testing.assert_array_equal(masks[1], ball_mask(1, frame))


def test_videos_that_drift_apart_are_refused(folder: Path) -> None:
    """Rates that are nearly one are one frame apart after enough frames."""
    for fps, file in ((30, "cam01"), (30.1, "cam02")):
        video_of(folder / f"{file}.mkv", fps, [0.0] * 320)
    edit(folder, "fps = 30", "fps = 30\nframes = 5")
    assert load_scene(folder).frame_count == FRAMES  # cam03's five frames are too few to drift
    video_of(folder / "cam03.mkv", 30, [0.0] * 320)
    with pytest.raises(InputError, match=r"cam01 has 30 frames a second and cam02 30\.1: they end 1.1 frames apart"):
        load_scene(folder)


def test_a_rate_that_is_none(folder: Path) -> None:
    edit(folder, 'video = "cam02.mkv"', 'video = "cam02.mkv"\nfps = 0')
    with pytest.raises(InputError, match=r"\[cameras.cam02\]: fps = 0 is not a frame rate"):
        load_scene(folder)


def test_what_the_rig_is(folder: Path) -> None:
    assert load_scene(folder, "2").rig().names == RIG.names
