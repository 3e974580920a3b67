# /// script
# requires-python = ">=3.9,<3.13"
# dependencies = ["mediapipe==0.10.14", "numpy<2", "opencv-python-headless<4.12"]
# [tool.uv]
# override-dependencies = ["jax; python_version < '3'", "opencv-contrib-python; python_version < '3'"]
# ///
"""Masks of one person by MediaPipe Pose, whose wheel holds the weights: ``mediapipe_pose.py FRAMES MASKS``.

Without arguments it does nothing, so that its environment can be made. Of MediaPipe's dependencies, jax is not needed,
and the other OpenCV needs libraries of a desktop.
"""

import os
import sys
from pathlib import Path


def main(frames: Path, masks: Path) -> None:
    """Write 0 to 255 for each frame that has no mask yet: how sure it is that a pixel is the person."""
    import cv2
    import mediapipe
    import numpy as np

    options = {"model_complexity": 1, "enable_segmentation": True, "smooth_segmentation": False}
    with mediapipe.solutions.pose.Pose(**options) as pose:
        for file in sorted(frames.iterdir()):
            mask = masks / f"{file.stem}.png"
            if mask.exists():
                continue
            image = np.asarray(cv2.imread(str(file)))[..., ::-1]  # from BGR to RGB
            sure = pose.process(np.ascontiguousarray(image)).segmentation_mask  # None where it finds nobody
            levels = np.zeros(image.shape[:2]) if sure is None else 255 * np.clip(sure, 0, 1)
            unfinished = mask.with_suffix(".part.png")
            cv2.imwrite(str(unfinished), np.rint(levels).astype(np.uint8))
            os.replace(unfinished, mask)


if len(sys.argv) == 3:
    main(Path(sys.argv[1]), Path(sys.argv[2]))
