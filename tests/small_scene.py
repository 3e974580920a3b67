"""A scene of three cameras and three frames that tests break or rename."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from synthetic import ring_rig

from mmocap_warp.formats.calibration.toml_rig import write_toml_rig

FRAMES = 3
SIZE = (64, 48)
CAMERAS = """
[cameras]
calibration = "calibration.toml"
[cameras.cam01]
masks = "masks/cam01"
[cameras.cam02]
masks = "masks/cam02"
[cameras.cam03]
masks = "masks/cam03"
"""
SCENE = f"""
[scene]
fps = 60
up = "+y"
{CAMERAS}
[track]
evaluations = 30
"""


def make_scene(folder: Path) -> Path:
    """Three cameras, three frames of masks, nothing wrong."""
    write_toml_rig(folder / "calibration.toml", ring_rig(3, SIZE))
    mask = np.zeros(SIZE[::-1], np.uint8)
    mask[10:40, 24:40] = 255
    for camera in ("cam01", "cam02", "cam03"):
        (folder / "masks" / camera).mkdir(parents=True)
        for frame in range(FRAMES):
            cv2.imwrite(str(folder / "masks" / camera / f"{frame:04d}.png"), mask)
    (folder / "scene.toml").write_text(SCENE)
    return folder
