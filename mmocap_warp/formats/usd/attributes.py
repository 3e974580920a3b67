"""The project's own ``mmocap:`` attributes on USD prims, typed by the values they hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, Vt


def author_value(prim: Usd.Prim, name: str, value: Any, time: float | None = None) -> None:
    """Set an attribute whose type follows from the value: text, truth, number, list of texts, or array (flattened)."""
    kind, usd_value = _typed(value)
    variability = Sdf.VariabilityUniform if time is None else Sdf.VariabilityVarying
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    prim.CreateAttribute(name, kind, True, variability).Set(usd_value, code)


def gf_matrix(transform: np.ndarray) -> Gf.Matrix4d:
    """USD's matrix, which acts on row vectors, of a (4, 4) transform of column vectors."""
    return Gf.Matrix4d(np.asarray(transform, np.float64).T)


def _typed(value: Any) -> tuple[Sdf.ValueTypeName, Any]:
    types = Sdf.ValueTypeNames
    if isinstance(value, str):
        return types.String, value
    if isinstance(value, bool):
        return types.Bool, value
    if isinstance(value, int):
        return types.Int64, value
    if isinstance(value, float):
        return types.Double, value
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return types.DoubleArray, Vt.DoubleArray.FromNumpy(np.ascontiguousarray(value, np.float64).ravel())
    if isinstance(value, np.ndarray) and value.dtype.kind in "iu":
        return types.Int64Array, Vt.Int64Array.FromNumpy(np.ascontiguousarray(value, np.int64).ravel())
    if isinstance(value, list | tuple) and all(isinstance(item, str) for item in value):
        return types.StringArray, Vt.StringArray(list(value))
    raise ValueError(f"no USD attribute type for {value!r}")
