"""Motions from key poses, for the instruments that make them.

Flash and Hogan, *The coordination of arm movements* (J. Neuroscience 5, 1985): a reach follows the path of least jerk,
``s(t) = 10 t^3 - 15 t^4 + 6 t^5``.
"""

from collections.abc import Sequence

import numpy as np

from mmocap_warp.body.model import BodyMotion
from mmocap_warp.body.skeleton import Skeleton


def minimum_jerk(s: np.ndarray) -> np.ndarray:
    """From 0 at ``s`` = 0 to 1 at ``s`` = 1 with the least jerk; level outside."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


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
    pose, reached = np.zeros(skeleton.coordinates), []
    for _, changed in keys:
        unknown = sorted(set(changed) - set(skeleton.coordinate_names))
        if unknown:
            raise ValueError(f"keys name coordinates {unknown} that this skeleton does not have")
        pose = pose.copy()
        for name, value in changed.items():
            number = skeleton.coordinate_names.index(name)
            pose[number] = value if skeleton.is_length[number] else np.radians(value)
        reached.append(pose)
    time = np.arange(round(seconds[-1] * fps) + 1) / fps
    poses = np.tile(reached[0], (len(time), 1))
    for i in range(1, len(keys)):
        share = minimum_jerk((time - seconds[i - 1]) / (seconds[i] - seconds[i - 1]))
        poses += share[:, None] * (reached[i] - reached[i - 1])
    return BodyMotion(fps, poses)
