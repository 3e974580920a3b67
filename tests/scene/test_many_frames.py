"""The time that a frame takes does not grow with the number of frames: 10,000 small images by night."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from small_scene import make_scene
from synthetic import ring_rig, synthetic_subject

from mmocap_warp.calibration.sync.synchronise import synchronise
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.image_files import encode_png
from mmocap_warp.scene.mask_writing import write_masks
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.tracking.frame_loop import track
from mmocap_warp.tracking.track_config import TrackConfig

MOST = 2.0  # times of the last frames over those of the first
SIZE = (32, 32)


def long_scene(folder: Path, frames: int) -> Scene:
    """Somebody who sways before three cameras."""
    make_scene(folder)
    write_toml_rig(folder / "calibration.toml", ring_rig(3, SIZE))
    mask = np.zeros(SIZE, bool)
    mask[6:28, 12:20] = True
    swaying = [encode_png(np.roll(mask, shift, axis=1)) for shift in range(-5, 6)]
    for frame in range(frames):
        image = swaying[round(5 * np.sin(frame / 9)) + 5]
        for camera in ("cam01", "cam02", "cam03"):
            (folder / "masks" / camera / f"{frame:04d}.png").write_bytes(image)
    return load_scene(folder)


def growth(at: list[float]) -> float:
    """How much longer the last quarter of the frames took than the second one, of the times at which they were done."""
    quarter = len(at) // 4  # the first has the start in it
    return (at[-1] - at[-quarter]) / (at[2 * quarter] - at[quarter])


@pytest.mark.parametrize("frames", [400, pytest.param(10_000, marks=pytest.mark.nightly)])
def test_masks_take_as_long_at_the_end(tmp_path: Path, frames: int) -> None:
    scene = long_scene(tmp_path, frames)
    # Once in a hundred times the last quarter, of some 20 ms, takes twice as long by chance.
    assert min(growth([time.process_time() for _ in scene.masks()]) for _ in range(2)) < MOST
    done: list[float] = []
    write_masks(scene, tmp_path / "out", progress=lambda _: done.append(time.process_time()))
    assert len(done) == frames
    assert growth(done) < MOST


@pytest.mark.nightly
def test_ten_thousand_frames_are_synchronised_and_tracked_in_time_that_grows_as_they_do(tmp_path: Path) -> None:
    seconds = {}
    for frames in (2_500, 10_000):
        (tmp_path / str(frames)).mkdir()
        scene, began = long_scene(tmp_path / str(frames), frames), time.process_time()
        synchronise(scene)
        config = TrackConfig(algorithm="h-pso", evaluations=20, smooth=150.0, device="cpu", threads=1)
        result = track(scene, synthetic_subject(), config)
        assert len(result.frame_numbers) == frames
        seconds[frames] = time.process_time() - began
    assert seconds[10_000] < 4 * 1.5 * seconds[2_500]
