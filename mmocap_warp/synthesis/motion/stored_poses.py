"""Motions that are data: pose vectors that ship with the package."""

from math import comb

import numpy as np

from mmocap_warp.scenes import ROOT

MOTIONS = ROOT / "sequences" / "motions.npz"
"""Pose vectors of the shipped sequences by name, in body axes about the origin of the floor, and of the passer-by,
:data:`PASSER_BY_RATE` a second, as ``instruments/sequence_motions.py`` packs them."""
MOTIONS_SHA256 = "4f04dd98dea924a75af2bd97ed6683c55829f5fa0e575fd10ce8bea0fa1fb940"
"""Of that file: it makes the content of the motions part of the code's hash, by which results are told apart."""

PASSER_BY_RATE = 120.0
"""Poses a second of the passer-by, who is in the middle of the way in the middle one."""


def stored_poses(name: str) -> np.ndarray:
    """(frame, 51) the pose vectors of one of ``MOTIONS``."""
    with np.load(MOTIONS) as motions:
        return unpack_poses(motions[name])


_PREDICTED_FROM = 8  # frames before a frame: of 5 to 11, those whose file is smallest within two percent


def unpack_poses(packed: np.ndarray) -> np.ndarray:
    """(frame, coordinate) the pose vectors that were packed."""
    unsigned = np.ascontiguousarray(packed.T).view(np.uint64)[..., 0]
    bits = (unsigned >> 1).view(np.int64) ^ -(unsigned & 1).view(np.int64)
    poses = np.zeros(bits.shape)
    for frame, pose in enumerate(poses):
        pose[:] = (bits[frame] + predicted_bits(poses[:frame])).view(np.float64)
    return poses


def predicted_bits(poses: np.ndarray) -> np.ndarray:
    """(coordinate,) the bits of the pose after some, on the polynomial through the last of them."""
    count, pose = min(_PREDICTED_FROM, len(poses)), np.zeros(poses.shape[1])
    for back in range(1, count + 1):
        pose -= (-1) ** back * comb(count, back) * poses[-back]
    return pose.view(np.int64)
