"""Outputs that show what a kernel forgot to write."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.kernels.body.kinematics import Affine, Joints
from mmocap_warp.kernels.structs import filled

SENTINEL = 0x5A5A5A5A


def poisoned(shape: int | tuple[int, ...], dtype: Any, device: str) -> wp.array:
    """An array full of NaN, or of ``SENTINEL`` where its numbers are integers."""
    array = wp.empty(shape, dtype=dtype, device=device)
    values = array.numpy()
    values[...] = np.nan if values.dtype.kind == "f" else SENTINEL
    array.assign(values)
    return array


def poisoned_joints(candidates: int, joints: int, device: str) -> Joints:
    """Where joints are written to, full of NaN."""
    shape = (candidates, joints)
    return filled(Joints, transform=poisoned(shape, Affine, device), skin_matrix=poisoned(shape, Affine, device))
