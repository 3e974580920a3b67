"""Poses in which a recording may start: frames of a motion that came with a body, or a TOML file of angles."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from mmocap_warp.body.model import BodyMotion, motion_named
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.errors import InputError
from mmocap_warp.formats.toml_table import load_toml
from mmocap_warp.formats.usd.usd_body import read_body, read_motions

_FRAMES = 8  # of a motion, evenly spread


def start_poses(body_file: Path, named: Iterable[str]) -> np.ndarray:
    """Poses (pose, coordinate) of a body by the names of its motions, and by files that end in ``.toml``.

    Raises:
        InputError: a file that cannot be read, or no motion of that name.
    """
    skeleton, motions = read_body(body_file).skeleton, read_motions(body_file)
    found = []
    for name in named:
        if name.endswith(".toml"):
            found.append(read_pose(name, skeleton)[None])
        else:
            found.append(frames_of(motion_named(name, motions, body_file)))
    return np.concatenate(found)


def frames_of(motion: BodyMotion) -> np.ndarray:
    """(pose, coordinate) some of a motion's frames, evenly spread."""
    last = len(motion.pose) - 1
    frames: np.ndarray = motion.pose[np.unique(np.linspace(0, last, _FRAMES).round().astype(int))]
    return frames


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
