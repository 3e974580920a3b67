"""Robots in URDF: links as rigid parts, joints that turn or slide. Meshes are read by trimesh, boxes and such made."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.rigged.part_meshes import named_file, part_mesh, plain_xml, solid
from mmocap_warp.formats.rigged.rigged_mesh import JointAxis, RiggedMesh, Skin, rigid_skin, robot
from mmocap_warp.whole_file import read_bytes

_REMEDY = "give a URDF file, as `xacro` writes it"
_TURNS, _SLIDES = ("revolute", "continuous"), "prismatic"
_MOVES = (*_TURNS, _SLIDES)
_STAYS = ("fixed", "floating", "planar")


def read_urdf(path: str | Path, meshes: str | Path | None = None) -> RiggedMesh:
    """Read a robot with all joints at zero: a joint for each link that turns or slides, followed by all fixed to it.

    Planar joints stay where they are. Visual geometry is taken, and collision geometry of links that have none. Meshes,
    ``package://`` and paths, are looked up by their last parts in the folder ``meshes``, which is the file's own where
    omitted, and no file elsewhere is opened.
    """
    path = Path(path)
    folder = Path(meshes) if meshes is not None else path.parent
    kinds = ValueError, TypeError, KeyError, IndexError, RecursionError
    with input_errors(path, "is damaged, or no URDF ({error})", _REMEDY, *kinds):
        root = plain_xml(read_bytes(path, "check the path"), path, _REMEDY)
        if root.tag != "robot":
            raise InputError(path, f"begins with <{root.tag}>, not <robot>", _REMEDY)
        if any("xacro" in element.tag for element in root.iter() if isinstance(element.tag, str)):
            raise InputError(path, "is a xacro template", "write it out with `xacro` first")
        return _read_robot(root, path, folder)


class _Joint(NamedTuple):
    name: str
    kind: str
    parent: str
    child: str
    origin: np.ndarray
    axis: np.ndarray
    lower: float
    upper: float


def _read_robot(root: Element, path: Path, folder: Path) -> RiggedMesh:
    joints = {joint.child: joint for joint in map(_read_joint, root.findall("joint"))}
    links = {_name_of(link): link for link in root.findall("link")}
    for joint in joints.values():
        for link in (joint.parent, joint.child):
            if link not in links:
                raise ValueError(f"joint {joint.name} names a link {link!r} that does not exist")
    # The links from the root outwards; there is one root.
    bases = [link for link in links if link not in joints]
    if len(bases) != 1:
        raise ValueError(f"it has {len(bases)} root links, not one")
    order = [bases[0]]
    for link in order:  # grows while it is walked
        order += [joint.child for joint in joints.values() if joint.parent == link]
    if len(order) != len(links):
        raise ValueError("its links form a loop")

    # A joint for each link that moves; what is fixed to it belongs to it.
    names, parent, axes = [bases[0]], [-1], {}
    of_link, world = {bases[0]: 0}, {bases[0]: np.eye(4)}
    bind = [np.eye(4)]
    for link in order[1:]:
        joint = joints[link]
        world[link] = world[joint.parent] @ joint.origin
        if joint.kind not in _MOVES:
            of_link[link] = of_link[joint.parent]
            continue
        of_link[link] = len(names)
        axes[len(names)] = JointAxis(world[link][:3, :3] @ joint.axis, joint.lower, joint.upper, joint.kind == _SLIDES)
        names.append(joint.name)
        parent.append(of_link[joint.parent])
        bind.append(world[link])
    if len(names) == 1:
        remedy = "there is nothing to track in a rigid thing; name a robot"
        raise InputError(path, "has no joint that turns or slides", remedy)
    skin = _read_geometry(links, world, of_link, path, folder)
    # What is not read as the file has it.
    planar = [joint.name for joint in joints.values() if joint.kind == "planar"]
    mimics = [_name_of(each) for each in root.findall("joint") if each.find("mimic") is not None]
    notes = [f"{', '.join(planar)} slide in a plane: held at zero"] if planar else []
    notes += [f"{', '.join(mimics)} follow other joints there: free here"] if mimics else []
    return robot(root.get("name") or path.stem, names, parent, np.stack(bind), skin, axes=axes, notes=tuple(notes))


def _read_joint(element: Element) -> _Joint:
    name, kind = _name_of(element), element.get("type", "")
    if kind not in _MOVES + _STAYS:
        raise ValueError(f"joint {name} is of type {kind!r}, which is not known")
    ends = [element.find(end) for end in ("parent", "child")]
    parent, child = (end.get("link", "") if end is not None else "" for end in ends)
    axis_element, limit = element.find("axis"), element.find("limit")
    axis = _numbers(axis_element.get("xyz", "1 0 0") if axis_element is not None else "1 0 0", 3)
    length = float(np.linalg.norm(axis))
    if kind in _MOVES and length == 0:
        raise ValueError(f"joint {name} {'slides along' if kind == _SLIDES else 'turns about'} no axis")
    lower, upper = -np.inf, np.inf
    if kind in ("revolute", _SLIDES) and limit is not None:
        lower, upper = (float(_numbers(limit.get(end, "0"), 1)[0]) for end in ("lower", "upper"))
    if lower > upper:
        raise ValueError(f"joint {name} has a lower limit above the upper one")
    return _Joint(name, kind, parent, child, _origin(element), axis / (length or 1.0), lower, upper)


def _read_geometry(
    links: dict[str, Element], world: dict[str, np.ndarray], of_link: dict[str, int], path: Path, folder: Path
) -> Skin:
    """The robot at zero angles; each vertex follows one joint."""
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]] = []
    for link, element in links.items():
        for shape in element.findall("visual") or element.findall("collision"):
            place = world[link] @ _origin(shape)
            for vertex, face in _read_shapes(shape, path, folder):
                parts.append((vertex, face, place[:3, :3], place[:3, 3], of_link[link]))
    return rigid_skin(parts, path)


def _read_shapes(shape: Element, path: Path, folder: Path) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Vertices (n, 3) and triangles (m, 3) of a visual, in its own axes."""
    geometry = shape.find("geometry")
    for element in geometry if geometry is not None else ():
        if element.tag == "box":
            yield solid("box", *_numbers(element.get("size", ""), 3))
        elif element.tag in ("sphere", "cylinder", "capsule"):
            named = ("radius", "length")[: 1 if element.tag == "sphere" else 2]
            yield solid(element.tag, *(_numbers(element.get(name, ""), 1)[0] for name in named))
        elif element.tag == "mesh":
            scale = _numbers(element.get("scale", "1 1 1"), 3)
            vertex, face = part_mesh(named_file(element.get("filename", ""), path, folder), path)
            yield vertex * scale, face[:, ::-1] if np.prod(scale) < 0 else face
        else:
            raise ValueError(f"a shape is a <{element.tag}>, which is not known")


def _origin(element: Element) -> np.ndarray:
    """(4, 4) of an element's <origin>: fixed axes, roll about x first."""
    from scipy.spatial.transform import Rotation

    matrix, origin = np.eye(4), element.find("origin")
    if origin is not None:
        matrix[:3, :3] = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0"), 3)).as_matrix()
        matrix[:3, 3] = _numbers(origin.get("xyz", "0 0 0"), 3)
    return matrix


def _numbers(text: str, count: int) -> np.ndarray:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([])
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"'{text}' is not {count} numbers")
    return values


def _name_of(element: Element) -> str:
    name = element.get("name")
    if not name:
        raise ValueError(f"a <{element.tag}> has no name")
    return name
