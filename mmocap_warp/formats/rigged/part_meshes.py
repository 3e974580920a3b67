"""A robot's parts as triangles: ``.stl``, ``.obj``, ``.ply``, ``.dae``, solids; files that they name stay closed."""

import io
import struct
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree.ElementTree import Element, ParseError, register_namespace, tostring

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import read_bytes

_MATERIALS = ("library_effects", "library_materials", "library_images", "bind_material")
_REMEDY = "export it again, as triangles in a .stl file"
_ERRORS = (  # of trimesh's readers, which have no error of their own
    *(ArithmeticError, AssertionError, AttributeError, LookupError, MemoryError, RuntimeError),
    *(SyntaxError, TypeError, ValueError, struct.error),
)
_KINDS = ("stl", "obj", "ply", "dae", "glb")


def part_mesh(path: Path, source: object) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (vertex, 3) and triangles (face, 3) of a mesh file; ``source`` is the file that names it.

    Raises:
        InputError: another kind of file, damaged, or one for which a package is missing.
    """
    kind = path.suffix.lower().lstrip(".")
    if kind not in _KINDS:
        raise InputError(source, f"names the mesh {path.name}, of a kind that is not read", f"use {', '.join(_KINDS)}")
    data = read_bytes(path, _REMEDY)
    try:
        vertex, face = _read_wavefront(data) if kind == "obj" else _read_with_trimesh(data, kind, path)
        sound = len(face) > 0 and vertex.ndim == 2 and bool(np.isfinite(vertex).all())
        sound = sound and 0 <= face.min() <= face.max() < len(vertex)
    except InputError:
        raise
    except ImportError as error:
        raise InputError(path, f"needs a package ({error})", "pip install 'mmocap-warp[robots]'") from None
    except _ERRORS as error:
        raise InputError(path, f"cannot be read ({type(error).__name__}: {error})", _REMEDY) from None
    if not sound:
        raise InputError(path, "holds no triangles, or some whose corners do not exist", _REMEDY)
    return vertex, face


def _read_with_trimesh(data: bytes, kind: str, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """From memory, so that no file that it names is looked for."""
    import trimesh

    damage: tuple[type[Exception], ...] = ()
    if kind == "dae":
        from collada.common import DaeError

        damage, data = (DaeError,), _plain_collada(data, path)
    try:
        mesh: Any = trimesh.load(io.BytesIO(data), file_type=kind, force="mesh", process=False, skip_materials=True)
    except damage as error:  # which is not one of Python's
        raise ValueError(str(error)) from error
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def _read_wavefront(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Places and faces of an ``.obj`` file; trimesh needs a package for pictures as soon as there are colours."""
    vertex, face = [], []
    for line in data.splitlines():
        words = line.split()
        if words[:1] == [b"v"]:
            vertex.append([float(word) for word in words[1:4]])
        elif words[:1] == [b"f"]:
            numbers = [int(word.partition(b"/")[0]) for word in words[1:]]
            corner = [number - 1 if number > 0 else len(vertex) + number for number in numbers]
            face += [[corner[0], *pair] for pair in pairwise(corner[1:])]
    return np.array(vertex, float).reshape(-1, 3), np.array(face, np.int64).reshape(-1, 3)


def _plain_collada(data: bytes, path: Path) -> bytes:
    """A COLLADA file without its materials, which are not needed and often broken; it has no entities to expand."""
    root = plain_xml(data, path, _REMEDY)
    register_namespace("", root.tag.partition("}")[0].lstrip("{"))
    for element in list(root.iter()):
        for child in list(element):
            if str(child.tag).rpartition("}")[2] in _MATERIALS:
                element.remove(child)
    return bytes(tostring(root))


def solid(kind: str, *size: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a box (three edges), a sphere (radius), or a cylinder or capsule along z.

    The latter two have a radius and a length, a capsule's without its ends. All have their middle at zero.
    """
    from trimesh import creation

    if min(size) <= 0:
        raise ValueError(f"a {kind} has a size of {min(size):g}")
    if kind == "box":
        made = creation.box(size)
    elif kind == "sphere":
        made = creation.icosphere(subdivisions=2, radius=size[0])
    elif kind == "cylinder":
        made = creation.cylinder(size[0], size[1], sections=24)
    else:
        made = creation.capsule(size[1], size[0], count=(12, 12))
    return np.asarray(made.vertices, float), np.asarray(made.faces, np.int64)


def named_file(name: str, source: Path, folder: Path) -> Path:
    """The file in ``folder`` that ends as ``name`` does, which ``source`` has, by as many last parts as can be."""
    root = folder.resolve()
    parts = [part for part in PurePosixPath(name.partition("://")[2] or name).parts if part not in ("/", ".", "..")]
    for first in range(len(parts)):
        file = root.joinpath(*parts[first:])
        if file.is_file():
            if not file.resolve().is_relative_to(root):
                break
            return file
    raise InputError(source, f"names the file '{name}', which is not in {folder}", "name its folder with --meshes")


def plain_xml(data: bytes, source: Path, remedy: str) -> Element:
    """The root of an XML file that needs nothing but itself; an InputError for entities, or no XML, with ``remedy``."""
    try:
        return fromstring(data)
    except DefusedXmlException:
        problem, remedy = "defines XML entities or includes other files", "write their content into this file"
        raise InputError(source, problem, remedy) from None
    except (ParseError, ValueError, LookupError) as error:
        raise InputError(source, f"is not XML ({error})", remedy) from None
