"""A made-up result and its recording, to be shown."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
from synthetic import synthetic_result

from mmocap_warp.masks.mask_settings import ForegroundSettings


def made_result(frames=6, cameras=3):
    """Two runs, with a raw track and standard deviations."""
    result = synthetic_result(frames, cameras=cameras)
    joints = len(result.subject.body.skeleton.joints)
    sigma = np.full((2, frames, joints, 3), 0.01)
    return replace(result, raw_pose=result.pose + 0.02, joint_sigma=sigma)


class Recording:
    """What a page asks of a scene: green images of one camera, and masks that are white on their left half."""

    path, foreground = "scene.toml", ForegroundSettings()

    def __init__(self, result):
        self.calibrated = result.cameras
        self.recorded_frames = int(result.frame_numbers[-1]) + 1

    def of_frames(self, frames):
        some = copy(self)
        some.frames = frames
        return some

    def images(self, scale):
        for _ in self.frames:
            yield [np.full((240, 320, 3), (10, 200, 40), np.uint8), *[None] * (len(self.calibrated) - 1)]

    def masks(self, scale, body):
        mask = np.zeros((240, 320), bool)
        mask[:, :160] = True
        for _ in self.frames:
            yield [mask] * len(self.calibrated)
