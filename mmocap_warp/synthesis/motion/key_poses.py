"""A motion from pose to pose: a few poses of named angles, and between them the path of least jerk."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mmocap_warp.body.body_motion import BodyMotion
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.synthesis.motion.motion_tracks import minimum_jerk

KeyPose = tuple[float, dict[str, float]]
"""When it is reached [s], and the coordinates that change until then, by name [m, degrees]; others stay."""


def through_poses(skeleton: Skeleton, keys: Sequence[KeyPose], fps: float) -> BodyMotion:
    """A motion that rests in each of its key poses; it begins with the first and ends with the last.

    Args:
        skeleton: whose coordinates the keys name; what no key names stays zero.
        keys: in order; the first is at zero seconds.
        fps: frames per second.

    Raises:
        ValueError: times that do not ascend from zero, or a coordinate that there is not.
    """
    seconds = [at for at, _ in keys]
    if seconds[0] != 0 or (np.diff(seconds) <= 0).any():
        raise ValueError(f"keys must be at ascending times from 0, got {seconds}")
    reached = [np.zeros(skeleton.coordinates)]
    for _, changed in keys:
        unknown = sorted(set(changed) - set(skeleton.coordinate_names))
        if unknown:
            raise ValueError(f"keys name coordinates {unknown} that this skeleton does not have")
        pose = reached[-1].copy()
        for name, value in changed.items():
            number = skeleton.coordinate_names.index(name)
            pose[number] = value if skeleton.is_length[number] else np.radians(value)
        reached.append(pose)
    reached = reached[1:]
    time = np.arange(round(seconds[-1] * fps) + 1) / fps
    poses = np.tile(reached[0], (len(time), 1))
    for i in range(1, len(keys)):
        share = minimum_jerk((time - seconds[i - 1]) / (seconds[i] - seconds[i - 1]))
        poses += share[:, None] * (reached[i] - reached[i - 1])
    return BodyMotion(fps, poses)
