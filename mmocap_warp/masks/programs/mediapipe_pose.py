# /// script
# requires-python = ">=3.9,<3.13"
# dependencies = ["mediapipe==0.10.14", "numpy<2", "opencv-python-headless<4.12", "pillow"]
# [tool.uv]
# override-dependencies = ["jax; python_version < '3'", "opencv-contrib-python; python_version < '3'"]
# ///
"""Labels of people by MediaPipe Pose, whose wheel holds the weights: ``mediapipe_pose.py FRAMES MASKS``.

Without arguments it does nothing, so that its environment can be made. Of MediaPipe's dependencies, jax is not needed,
and the other OpenCV needs libraries of a desktop.
"""

import os
import sys
from pathlib import Path

MOST_PEOPLE = 4
MIN_NEW = 0.7  # share of a person's pixels that nobody else has. A ghost where somebody was painted over has up to 0.6
MOST_PAUSE = 16  # frames from one look for somebody else in vain to the next, at most


def main(frames: Path, masks: Path) -> None:
    """Write who is seen in each frame that has no labels yet: 0 is nobody, 1 is whom MediaPipe finds first.

    It finds one person. Who was found is painted over before the next look, which has a model of its own.
    """
    import cv2
    import mediapipe
    import numpy as np
    from PIL import Image

    options = {"model_complexity": 1, "enable_segmentation": True, "smooth_segmentation": False}
    models, pause, next_look = [], [0] * MOST_PEOPLE, [0] * MOST_PEOPLE
    for number, file in enumerate(sorted(frames.iterdir())):
        mask = masks / f"{file.stem}.png"
        if mask.exists():
            continue
        image = np.ascontiguousarray(np.asarray(cv2.imread(str(file)))[..., ::-1])  # from BGR to RGB
        labels = np.zeros(image.shape[:2], np.uint8)
        for person in range(MOST_PEOPLE):
            if number < next_look[person]:
                break
            if person == len(models):
                models.append(mediapipe.solutions.pose.Pose(**options))
            hidden = cv2.dilate(labels, np.ones((9, 9), np.uint8)) > 0
            if person:
                image[hidden] = image[~hidden].mean(axis=0)
            sure = models[person].process(image).segmentation_mask  # None where it finds nobody
            seen = np.zeros(hidden.shape, bool) if sure is None else sure >= 0.5
            if (seen & ~hidden).sum() <= MIN_NEW * seen.sum():
                if seen.any():  # it would follow that ghost
                    models[person].reset()
                pause[person] = min(2 * pause[person] + 1, MOST_PAUSE) if person else 0
                next_look[person] = number + pause[person]
                break
            pause[person] = 0
            labels[seen & (labels == 0)] = person + 1
        indexed = Image.fromarray(labels, "P")
        indexed.putpalette([0, 0, 0, 255, 200, 0, 0, 120, 255, 0, 200, 80, 230, 60, 200])  # black is nobody
        unfinished = mask.with_suffix(".part.png")
        indexed.save(unfinished)
        os.replace(unfinished, mask)


if len(sys.argv) == 3:
    main(Path(sys.argv[1]), Path(sys.argv[2]))
