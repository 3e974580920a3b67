"""Turns a motion of DeepMimic's humanoid, as the package ``pybullet`` has them, into a ``.bvh``.

python instruments/deepmimic_to_bvh.py humanoid3d_cartwheel.txt cartwheel.bvh

The motions (Peng et al., *DeepMimic*, SIGGRAPH 2018) were captured of people who roll, flip, crawl and get up; no
threshold of this project was chosen by them. They lie in ``pybullet_data/data/motions`` of the package's wheel.
"""

import sys
from pathlib import Path

import numpy as np
from bvh_text import Bone, bvh_text

from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import read_json, write_whole

_REMEDY = "give a humanoid3d_NAME.txt of DeepMimic"
_COLUMNS = 44  # of a frame: its duration, the root's place, and the joints' rotations

_END = (0.0, -0.1, 0.0)  # of hands, feet and head, whose lengths do not count [m]

# The humanoid's joints in the order of a file's columns: names as BVH files have them, the parent, where the joint is
# from its parent (x ahead, y up, z right) [m], and the values of its rotation: a quaternion with w first, or an angle
# about z. Hands have none.
_JOINTS = (
    ("Hips", -1, (0.0, 0.0, 0.0), 4),
    ("Chest", 0, (0.0, 0.236151, 0.0), 4),
    ("Head", 1, (0.0, 0.223894, 0.0), 4),
    ("RightUpLeg", 0, (0.0, 0.0, 0.084887), 4),
    ("RightLeg", 3, (0.0, -0.421546, 0.0), 1),
    ("RightFoot", 4, (0.0, -0.40987, 0.0), 4),
    ("RightArm", 1, (-0.02405, 0.2435, 0.18311), 4),
    ("RightForeArm", 6, (0.0, -0.274788, 0.0), 1),
    ("LeftUpLeg", 0, (0.0, 0.0, -0.084887), 4),
    ("LeftLeg", 8, (0.0, -0.421546, 0.0), 1),
    ("LeftFoot", 9, (0.0, -0.40987, 0.0), 4),
    ("LeftArm", 1, (-0.02405, 0.2435, -0.18311), 4),
    ("LeftForeArm", 11, (0.0, -0.274788, 0.0), 1),
    ("RightHand", 7, (0.0, -0.258947, 0.0), 0),
    ("LeftHand", 12, (0.0, -0.258947, 0.0), 0),
)


def bvh_of_deepmimic(path: Path) -> str:
    """A motion's file as the text of a ``.bvh``; an InputError for another file."""
    from scipy.spatial.transform import Rotation

    frames = read_json(path, _REMEDY).get("Frames")
    try:
        values = np.array(frames, float)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.ndim != 2 or values.shape[1] != _COLUMNS or not np.isfinite(values).all() or values[0, 0] <= 0:
        raise InputError(path, f"its Frames are not rows of {_COLUMNS} numbers", _REMEDY)
    angles, column = [], 4
    for _, _, _, width in _JOINTS:
        own = values[:, column : column + width]
        column += width
        if width == 4:
            angles.append(Rotation.from_quat(own[:, [1, 2, 3, 0]]).as_euler("ZYX", degrees=True))
        else:
            about_z = own[:, 0] if width else np.zeros(len(values))
            angles.append(np.stack([np.degrees(about_z), *np.zeros((2, len(values)))], axis=1))
    bones = [Bone(name, parent, offset, _END) for name, parent, offset, _ in _JOINTS]
    return bvh_text(bones, values[:, 1:4], np.array(angles), values[0, 0])


if __name__ == "__main__":
    motion, output = map(Path, sys.argv[1:])
    write_whole(output, bvh_of_deepmimic(motion).encode())
