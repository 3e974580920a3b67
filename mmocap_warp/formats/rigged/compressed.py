"""Compressed glTF: meshes by Draco and buffer views by meshopt, where their decoders are installed."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

DRACO, MESHOPT = "KHR_draco_mesh_compression", "EXT_meshopt_compression"
DECODERS = {DRACO: "DracoPy", MESHOPT: "meshoptimizer"}
"""The packages that decode extensions."""
_MOST_BYTES = 1 << 28  # that a buffer view may become
_ANY = range(4, 257, 4)
# How each is decoded, and the strides [bytes] that it may have.
_MODES = {
    "ATTRIBUTES": ("vertex_buffer", _ANY),
    "TRIANGLES": ("index_buffer", (2, 4)),
    "INDICES": ("index_sequence", (2, 4)),
}
_FILTERS = {"OCTAHEDRAL": ("oct", (4, 8)), "QUATERNION": ("quat", (8,)), "EXPONENTIAL": ("exp", _ANY)}


def has_decoder(extension: str) -> bool:
    """Whether an extension compresses what can be decoded here."""
    return extension in DECODERS and find_spec(DECODERS[extension]) is not None


def draco_mesh(data: bytes, attributes: dict[str, int]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Corners (3 triangles, 1), and by the names of ``attributes`` the values (vertex, width) with their numbers."""
    draco: Any = import_module(DECODERS[DRACO])
    try:
        mesh = draco.decode(data)
    except (draco.FileTypeException, draco.EncodingFailedException) as error:
        raise ValueError(f"Draco: {error}") from None
    values = {name: mesh.get_attribute_by_unique_id(number)["data"] for name, number in attributes.items()}
    return np.reshape(mesh.faces, (-1, 1)), values


def meshopt_view(about: dict[str, Any], data: bytes) -> bytes:
    """The bytes of a buffer view that the extension is ``about``; a ValueError if it is damaged."""
    meshopt: Any = import_module(DECODERS[MESHOPT])
    count, stride, mode, filtered = about["count"], about["byteStride"], about["mode"], about.get("filter", "NONE")
    decoder, strides = _MODES[mode]
    name, filter_strides = _FILTERS[filtered] if filtered != "NONE" else ("", strides)
    # The decoders do not look where they write.
    fits = stride in strides and stride in filter_strides and 0 < count <= _MOST_BYTES // stride
    if not fits or (mode == "TRIANGLES" and count % 3):
        raise ValueError(f"a buffer view of {count} times {stride} bytes")
    try:
        values = getattr(meshopt, f"decode_{decoder}")(count, stride, data)
    except RuntimeError as error:
        raise ValueError(f"meshopt: {error}") from None
    if name:
        values = getattr(meshopt, f"decode_filter_{name}")(values, count, stride)
    return bytes(values.tobytes()[: count * stride])
