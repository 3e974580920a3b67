"""Arrays as text that a page unpacks: little-endian values in base64."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

Packed = dict[str, Any]
"""What JSON can say."""

_ROTATION_STEPS = 32767  # to a unit, of a quaternion's components


def packed(array: np.ndarray) -> Packed:
    """An array of a plain kind: ``kind`` (such as ``f4``) and ``data``; its shape is for the reader to know."""
    little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    return {"kind": f"{array.dtype.kind}{array.dtype.itemsize}", "data": base64.b64encode(little.tobytes()).decode()}


def packed_numbers(numbers: np.ndarray) -> Packed:
    """Natural numbers, in 2 bytes each where that is enough, else in 4."""
    return packed(numbers.astype(np.uint16 if numbers.max(initial=0) < 1 << 16 else np.uint32))


def packed_values(values: np.ndarray) -> Packed:
    """Measured values, NaN among them, in 4 bytes each."""
    return packed(values.astype(np.float32))


def packed_places(places: np.ndarray) -> Packed:
    """Points (..., 3) [m] in 6 bytes each: ``low + step * values``, off by half a ``step`` at most along an axis."""
    flat = places.reshape(-1, 3)
    low = flat.min(axis=0)
    step = max(float((flat.max(axis=0) - low).max()), 1e-3) / 65535
    values = np.rint((places - low) / step).clip(0, 65535).astype(np.uint16)
    return {"low": low.tolist(), "step": step, "values": packed(values)}


def packed_rotations(rotations: np.ndarray) -> Packed:
    """Rotations (..., 3, 3) as quaternions x, y, z, w in 8 bytes each, in steps of 1/32767."""
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat()
    return packed(np.rint(quaternion * _ROTATION_STEPS).astype(np.int16))
