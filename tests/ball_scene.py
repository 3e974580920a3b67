"""A small scene without fault: a ball before three cameras, its masks, videos and a clean plate."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from synthetic import ring_rig

from mmocap_warp.cameras.rig import project
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig

FRAMES = 5
WIDTH, HEIGHT = 160, 120
BALL = 0.25  # radius [m]
RIG = ring_rig(3, (WIDTH, HEIGHT))
SCENE = """
[scene]
name = "ball"
fps = 30
up = "+y"

[cameras]
calibration = "calibration.toml"

[cameras.cam01]
masks = "masks/cam01"
video = "cam01.mkv"
clean_plate = "plate.png"
[cameras.cam02]
masks = "masks/cam02"
video = "cam02.mkv"
clean_plate = "plate.png"
[cameras.cam03]
masks = "masks/cam03"
video = "cam03.mkv"
clean_plate = "plate.png"

[foreground]
source = "masks"

[track]
evaluations = 500
"""


def ball_mask(k: int, frame: float) -> np.ndarray:
    """A ball that moves 5 cm a frame, as camera ``k`` sees it."""
    centre = np.array([0.05 * frame, 1.0, 0.0])
    u, v = project(RIG, centre[None])[k, 0]
    depth = (RIG.R[k] @ centre + RIG.t[k])[2]
    row, column = np.indices((HEIGHT, WIDTH))
    return np.hypot(column - u, row - v) < RIG.K[k, 0, 0] * BALL / depth


def write_video(path: Path, frames: list[np.ndarray]) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30, frames[0].shape[1::-1])
    for frame in frames:
        writer.write(frame)
    writer.release()


@pytest.fixture(name="folder")
def ball_scene(tmp_path: Path) -> Path:
    """Its folder."""
    write_toml_rig(tmp_path / "calibration.toml", RIG)
    plate = np.random.default_rng(0).integers(90, 110, (HEIGHT, WIDTH, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "plate.png"), plate)
    for k, name in enumerate(RIG.names):
        (tmp_path / "masks" / name).mkdir(parents=True)
        frames = []
        for frame in range(FRAMES):
            mask = ball_mask(k, frame)
            cv2.imwrite(str(tmp_path / "masks" / name / f"{frame:04d}.png"), mask.astype(np.uint8) * 255)
            frames.append(np.where(mask[..., None], np.uint8([30, 60, 220]), plate))
        write_video(tmp_path / f"{name}.mkv", frames)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def edit(folder: Path, old: str, new: str, name: str = "scene.toml") -> Path:
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))
    return folder
