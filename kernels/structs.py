"""Filling the structs that launchers take: once, where their arrays are allocated, never for a launch."""

import math
import mmap
import sys
from typing import Any, TypeVar

import numpy as np
import warp as wp

Struct = TypeVar("Struct")


def filled(kind: type[Struct], **fields: Any) -> Struct:
    """A Warp struct with all of its fields; Warp itself leaves out what is not set, and takes names that it lacks.

    Raises:
        ValueError: fields are missing, or there are no such fields.
    """
    known: dict[str, Any] = kind.vars
    if fields.keys() != known.keys():
        raise ValueError(f"{kind.key} has the fields {sorted(known)}, got {sorted(fields)}")
    struct = kind()
    for name, value in fields.items():
        setattr(struct, name, value)
    return struct


def allocated(kind: type, device: wp.DeviceLike, **fields: Any) -> Any:
    """As :func:`filled`, with arrays made on a device: of a shape they are zeros, of a list or NumPy array a copy.

    Other values are taken as they are. To mypy the fields of a struct are what kernels see of them, hence Any.
    """
    known: dict[str, Any] = kind.vars
    for name, value in fields.items():
        field: Any = getattr(known.get(name), "type", None)
        if wp.types.is_array(field) and not wp.types.is_array(value):
            make = _zeros if isinstance(value, int | tuple) else wp.array
            fields[name] = make(value, dtype=field.dtype, device=device)
    return filled(kind, **fields)


def _zeros(shape: int | tuple[int, ...], dtype: Any, device: wp.DeviceLike) -> wp.array[Any]:
    """Zeros. On the CPU they take memory where something is written: few outlines are as long as their arrays."""
    if not wp.get_device(device).is_cpu:
        return wp.zeros(shape, dtype=dtype, device=device)
    size = math.prod(np.atleast_1d(shape)) * wp.types.type_size_in_bytes(dtype)
    private = {} if sys.platform == "win32" else {"flags": mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS}
    memory = np.frombuffer(mmap.mmap(-1, max(1, size), **private), np.uint8)
    array = wp.array(ptr=memory.ctypes.data, dtype=dtype, shape=shape, device=device)
    array.memory = memory  # lives as long
    return array
