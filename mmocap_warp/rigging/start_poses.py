"""What known poses of a body tell: poses in which a recording may start, and limits and spreads of its joints.

A recording may start in a frame of a motion that came with the body, or in a pose of a TOML file of angles.
"""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from mmocap_warp.body.model import motion_named
from mmocap_warp.body.skeleton import TRANSLATION, Skeleton
from mmocap_warp.errors import InputError
from mmocap_warp.formats.toml_table import load_toml
from mmocap_warp.formats.usd.usd_body import read_body, read_motions

_FRAMES = 8  # number of a motion's frames that are taken


def start_poses(body_file: Path, named: Iterable[str]) -> np.ndarray:
    """Poses (pose, coordinate) of a body, by names of its motions or of ``.toml`` files; an InputError for others."""
    skeleton, motions = read_body(body_file).skeleton, read_motions(body_file)
    poses = [
        read_pose(name, skeleton)[None]
        if name.endswith(".toml")
        else motion_named(name, motions, body_file).some_poses(_FRAMES)
        for name in named
    ]
    return np.concatenate(poses)


def read_pose(path: str | Path, skeleton: Skeleton) -> np.ndarray:
    """(coordinate,) a pose of a TOML file: ``LKnee.Rx = 40`` and so on [degrees; metres of what slides], else zero.

    Raises:
        InputError: no such file, a joint or an axis that there is not, or a value that is no number.
    """
    table = load_toml(path)
    pose = np.zeros(skeleton.coordinates)
    for name, entry in table.take_tables().items():
        if name not in skeleton.joints:
            known = ", ".join(skeleton.joints[:8]) + (" ..." if len(skeleton.joints) > 8 else "")
            raise InputError(path, f"there is no joint '{name}'", f"name one of {known}")
        first = skeleton.angles(name).start
        for index in range(first, first + 3):
            value = entry.take(skeleton.coordinate_names[index].rpartition(".")[2], float, 0.0)
            pose[index] = value if skeleton.is_length[index] else np.radians(value)
        entry.finish()
    table.finish()
    return pose


_OUTLIERS = 0.005  # share of the frames, at either end, that may be wrong
_LEAST_SPREAD = 0.05  # spread of a joint that turns, at least [rad]
_LEAST_SHIFT = 0.001  # spread of a joint that slides, at least [m]
_SHIFT_MARGIN = 0.1  # share of the travel seen by which limits of a slide are wider, at either end


def learnt(skeleton: Skeleton, poses: np.ndarray, margin: float) -> Skeleton:
    """The skeleton with limits and spreads of the angles that it searches, but the root's, as they were in poses.

    Limits leave out the most extreme of the poses (frame, coordinate), half a percent at either end, and are wider than
    what was seen by ``margin`` [rad]. A joint's spread is the root mean square of the angle that strays most from the
    zero pose. Limits of a joint that slides are a tenth of the travel seen wider, but not wider than they were: those
    are where the hardware stops. What is attached stays as it is.
    """
    limits, spread = skeleton.limits.copy(), skeleton.spread.copy()
    seen = np.where(skeleton.slides, _LEAST_SHIFT, _LEAST_SPREAD)
    for coordinate in (*skeleton.searched_angles(), *skeleton.searched_shifts()):
        joint, axis = divmod(int(coordinate) - TRANSLATION, 3)
        values, slides = poses[:, coordinate], skeleton.slides[joint]
        low, high = np.quantile(values, [_OUTLIERS, 1 - _OUTLIERS])
        wider = _SHIFT_MARGIN * (high - low) if slides else margin
        bounds = [low - wider, high + wider]
        limits[joint, axis] = np.clip(bounds, *skeleton.limits[joint, axis]) if slides else bounds
        seen[joint] = max(seen[joint], float(np.sqrt(np.mean(values**2))))
        spread[joint] = seen[joint]
    return replace(skeleton, limits=limits, spread=spread)
