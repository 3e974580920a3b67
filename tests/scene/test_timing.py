"""When a camera's images were taken: offsets in seconds, rates of cameras, and what is left of a frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ball_scene import FRAMES, ball_scene, edit

from mmocap_warp.errors import InputError
from mmocap_warp.scene.mask_writing import write_masks
from mmocap_warp.scene.scene_toml import load_scene

__all__ = ["ball_scene"]

MASKS = 'masks = "masks/cam03"'


def test_an_offset_in_seconds_is_a_frame_offset_and_a_rest(folder: Path) -> None:
    edit(folder, MASKS, f"{MASKS}\noffset = {1.4 / 30}")
    camera = load_scene(folder).cameras[2]
    assert camera.frame_offset == 1
    assert camera.fraction == pytest.approx(0.4)
    assert [camera.number(frame) for frame in range(4)] == [1, 2, 3, 4]
    late = np.array([seen.late for seen in load_scene(folder).observations(0.25)])
    np.testing.assert_allclose(late, np.tile([0, 0, -0.4 / 30], (FRAMES, 1)), atol=1e-12)


def test_whole_offsets_leave_nothing(folder: Path) -> None:
    """A frame's worth of seconds with five digits is a whole frame, and scenes without offsets tell no times at all."""
    assert all(seen.late is None for seen in load_scene(folder).observations(0.25))
    whole = list(load_scene(folder).observations(0.25, first=1))
    edit(folder, MASKS, f"{MASKS}\noffset = 0.03333")
    scene = load_scene(folder)
    assert (scene.cameras[2].frame_offset, scene.cameras[2].fraction) == (1, 0.0)
    assert all(seen.late is None for seen in scene.observations(0.25))
    np.testing.assert_array_equal(next(scene.observations(0.25)).words[2], whole[0].words[2])


def test_the_nearest_frame_of_another_rate_is_at_most_half_a_frame_off(folder: Path) -> None:
    edit(folder, "fps = 30", "fps = 30\nframes = 3")
    edit(folder, MASKS, f"{MASKS}\nfps = 25\noffset = 0.01")
    camera = load_scene(folder).cameras[2]
    frames = range(0, 9)
    late = camera.late(frames) / 30
    taken = np.array([camera.number(frame) for frame in frames]) / 25 - 0.01
    np.testing.assert_allclose(np.array(frames) / 30 + late, taken, atol=1e-12)
    assert np.abs(late).max() <= 0.5 / 25


def test_without_a_rate_the_fastest_camera_is_the_clock(folder: Path) -> None:
    edit(folder, "fps = 30\n", "frames = 4\n")
    edit(folder, MASKS, f"{MASKS}\nfps = 15")
    scene = load_scene(folder)
    assert scene.fps == 30
    assert scene.cameras[2].rate == 0.5


def test_what_a_file_says_of_times_does_not_count_where_the_scene_does(folder: Path) -> None:
    stated = load_scene(folder).cameras[2].video
    edit(folder, MASKS, f"{MASKS}\nfps = 30")
    assert (stated.fps, load_scene(folder).cameras[2].video.fps) == (30, 0)


def test_a_rate_that_nobody_tells_is_asked_for(folder: Path) -> None:
    file = folder / "scene.toml"
    lines = file.read_text().splitlines()
    file.write_text("\n".join(line for line in lines if not line.startswith(("fps", "video"))))
    with pytest.raises(InputError, match=r"\[scene\]: 'fps' is missing; add fps = \.\.\. \(a number\)"):
        load_scene(folder)


def test_made_masks_keep_step_with_an_offset_in_seconds(folder: Path, tmp_path: Path) -> None:
    edit(folder, MASKS, f"{MASKS}\noffset = {1.4 / 30}")
    scene = load_scene(folder)
    made = load_scene(write_masks(scene, tmp_path / "made", 1.0))
    assert made.cameras[2].fraction == pytest.approx(0.4)
    for seen, read in zip(scene.observations(), made.observations(), strict=True):
        np.testing.assert_array_equal(seen.words, read.words)
        np.testing.assert_allclose(np.asarray(seen.late), np.asarray(read.late), atol=1e-12)


def test_made_masks_of_a_video_that_is_wrong_about_its_rate_are_read_again(folder: Path, tmp_path: Path) -> None:
    edit(folder, "fps = 30", "fps = 60")
    for name in ("cam01", "cam02", "cam03"):
        edit(folder, f'masks = "masks/{name}"', f'masks = "masks/{name}"\nfps = 60')
    made = load_scene(write_masks(load_scene(folder), tmp_path / "made", 1.0))
    assert [(camera.rate, camera.video.fps) for camera in made.cameras] == [(1.0, 0.0)] * 3


def test_a_fast_cameras_offset_is_counted_in_the_recordings_frames(folder: Path) -> None:
    """Cameras have two frames to one of the recording, which has three."""
    edit(folder, "fps = 30", "fps = 30\nframes = 1")
    for name in ("cam01", "cam02", "cam03"):
        edit(folder, f'masks = "masks/{name}"', f'masks = "masks/{name}"\nfps = 60')
    edit(folder, MASKS, f"{MASKS}\nframe_offset = 3")
    assert (load_scene(folder).cameras[2].shift, load_scene(folder).frame_count) == (2, 1)


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ("offset = nan", "offset is not finite"),
        ("offset = inf", "offset is not finite"),
        ('offset = "late"', "is not a number"),
        ("offset = 1e300", "frames"),
        ("offset = 0.1\nframe_offset = 3", "both offset and frame_offset"),
        ("fps = 0", "is not a frame rate"),
        ("fps = -30", "is not a frame rate"),
        ("offset = 0.2", "in 5 frames"),
    ],
)
def test_wrong_times_are_one_clear_line(folder: Path, lines: str, says: str) -> None:
    edit(folder, MASKS, f"{MASKS}\n{lines}")
    with pytest.raises(InputError, match=says):
        load_scene(folder)


def test_views_that_share_no_time_are_refused(folder: Path) -> None:
    edit(folder, MASKS, f"{MASKS}\noffset = 0.1")
    edit(folder, 'masks = "masks/cam02"', 'masks = "masks/cam02"\noffset = -0.1')
    with pytest.raises(InputError, match="at no common time"):
        load_scene(folder)
