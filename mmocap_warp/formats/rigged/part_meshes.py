"""Meshes of a robot's parts as triangles: ``.stl``, ``.obj``, ``.ply``, ``.dae``; files that they name stay closed."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.errors import InputError

_KINDS = ("stl", "obj", "ply", "dae", "glb")


def part_mesh(path: Path, source: object) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (vertex, 3) and triangles (face, 3) of a mesh file; ``source`` is the file that names it.

    Raises:
        InputError: another kind of file, damaged, or one for which a package is missing.
    """
    kind = path.suffix.lower().lstrip(".")
    if kind not in _KINDS:
        raise InputError(source, f"names the mesh {path.name}, of a kind that is not read", f"use {', '.join(_KINDS)}")
    data = path.read_bytes()
    if kind == "dae":
        _check_collada(data, path)
    try:
        import trimesh

        # from memory, so that materials and textures that it names are not looked for
        mesh: Any = trimesh.load(io.BytesIO(data), file_type=kind, force="mesh", process=False, skip_materials=True)
        vertex, face = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
        sound = len(face) > 0 and vertex.ndim == 2 and bool(np.isfinite(vertex).all()) and face.max() < len(vertex)
    except ImportError as error:
        raise InputError(path, f"needs a package ({error})", "pip install 'mmocap-warp[robots]'") from None
    except Exception as error:  # readers of four formats, each with its own
        raise InputError(path, f"cannot be read ({type(error).__name__}: {error})", "write it again as .stl") from None
    if not sound:
        raise InputError(path, "holds no sound triangles", "write it again as .stl")
    return vertex, face


def _check_collada(data: bytes, path: Path) -> None:
    """See that the reader's parser, which expands entities, gets none.

    Raises:
        InputError: there are some, or it is not XML.
    """
    from xml.etree.ElementTree import ParseError

    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    try:
        fromstring(data)
    except (DefusedXmlException, ParseError, ValueError, LookupError) as error:
        raise InputError(path, f"is not plain XML ({type(error).__name__})", "write it again as .stl") from None
