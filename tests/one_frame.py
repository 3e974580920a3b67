"""A body fitted to one frame's masks, as the first stages of a fit do it."""

from __future__ import annotations

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.fitting.subject_fit import FitConfig, _first_frame, _Task, _verdict
from mmocap_warp.masks.observation import Observation

QUICK = FitConfig(scale=0.25, evaluations=600, finalists=2)
"""Settings of a fit that takes seconds."""


def fit_observation(
    body: BodyModel, rig: CameraRig, observation: Observation, config: FitConfig, start_poses: np.ndarray | None = None
) -> Subject:
    """The best way to see a frame; see :func:`mmocap_warp.fitting.subject_fit.fit_clip`."""
    task = _Task(body, rig, config, lambda stage, done, cost: None, start_poses)
    best, others = _first_frame(task, observation)
    return task.subject(best, _verdict(best, others))
