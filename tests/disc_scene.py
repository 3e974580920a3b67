"""A scene whose subject is a disc: three cameras with strong lenses, their masks, videos and clean plates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from synthetic import ring_rig

from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig

FRAMES = 4
SIZE = (160, 120)


def bent_rig() -> CameraRig:
    """Three cameras with strong lenses: what is undistorted twice is plainly elsewhere."""
    rig = ring_rig(3, SIZE)
    return replace(rig, distortion=np.tile([-0.3, 0.1, 0.001, -0.002, 0.0], (3, 1)))


def disc(rig: CameraRig, k: int, frame: int) -> np.ndarray:
    """A disc off the image's middle, in the recorded pixels."""
    row, column = np.indices(SIZE[::-1])
    u, v = project(rig, np.array([[0.9 + 0.05 * frame, 1.6, 0.3]]))[k, 0]
    return np.hypot(column - u, row - v) < 12


def write_scene(folder: Path, source: str = "masks", late: int = 0, rig: CameraRig | None = None) -> Path:
    """A scene with masks and videos, the last camera late by some frames."""
    rig = rig or bent_rig()
    write_toml_rig(folder / "calibration.toml", rig)
    plate = np.random.default_rng(0).integers(90, 110, (*SIZE[::-1], 3), np.uint8)
    cv2.imwrite(str(folder / "plate.png"), plate)
    lines = ["[scene]", "fps = 30", 'up = "+y"', "[truth]", 'file = "truth.trc"', 'axes = "zxy"', "first_frame = 2"]
    lines += ["[cameras]", 'calibration = "calibration.toml"']
    (folder / "truth.trc").touch()
    for k, name in enumerate(rig.names):
        for kind in ("masks", "video"):
            (folder / kind / name).mkdir(parents=True)
        for frame in range(FRAMES):
            mask = disc(rig, k, frame)
            cv2.imwrite(str(folder / "masks" / name / f"{frame:03d}.png"), mask.astype(np.uint8) * 255)
            image = np.where(mask[..., None], np.uint8([30, 60, 220]), plate)
            cv2.imwrite(str(folder / "video" / name / f"{frame:03d}.png"), image)
        lines += [
            f"[cameras.{name}]",
            f'masks = "masks/{name}"',
            f'video = "video/{name}"',
            'clean_plate = "plate.png"',
        ]
        lines += [f"frame_offset = {late}"] if late and k == 2 else []
    lines += [
        "[foreground]",
        f'source = "{source}"',
        "[track]",
        'algorithm = "h-de"',
        "evaluations = 60",
        "limits = true",
    ]
    (folder / "scene.toml").write_text("\n".join(lines))
    return folder


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
