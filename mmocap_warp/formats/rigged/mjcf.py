"""Robots in MJCF: MuJoCo compiles a model that names no file, with its meshes from memory."""

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np

from mmocap_warp.errors import InputError, input_errors, needs_package
from mmocap_warp.formats.rigged.part_meshes import named_file, plain_xml, solid
from mmocap_warp.formats.rigged.rigged_mesh import JointAxis, RiggedMesh, Skin, chosen_character, rigid_skin, robot
from mmocap_warp.whole_file import read_bytes

_REMEDY = "give an MJCF file that MuJoCo opens"
_READ = (  # elements
    *("asset", "body", "compiler", "default", "equality", "frame", "freejoint", "geom", "inertial", "joint", "mesh"),
    "worldbody",
)
_MAKING = ("attach", "composite", "flexcomp", "replicate")  # elements that become bodies when a model is compiled
_LEFT_OUT = (  # attributes: they name a file or what is made of one, or parts that MuJoCo is to leave out
    *("assetdir", "content_type", "material", "meshdir", "plugin", "strippath", "texturedir"),
    *("discardvisual", "fusestatic"),
)
_MESHES = ("obj", "stl", "msh")
_SHOWN = 2  # the highest group of geometry that MuJoCo's viewer shows at first; shapes for collisions have higher ones


def read_mjcf(path: str | Path, meshes: str | Path | None = None, character: str | None = None) -> RiggedMesh:
    """Read a robot as its file draws it: a joint for each that turns or slides, followed by all that is fixed to it.

    Several joints of a body are a chain, without skin between. The joints of a first body, free or not, are the root's,
    which moves in any way. A robot with such joints is a character; all that stands on the world is one; what has no
    other joints is scenery. A body's meshes that do not collide stand for its shapes that do. Files are looked up by
    their last parts in the folder ``meshes``, which is the file's own where omitted.
    """
    path = Path(path)
    folder = Path(meshes) if meshes is not None else path.parent
    with input_errors(path, "is damaged, or no MJCF ({error})", _REMEDY, ValueError, RecursionError):
        root = plain_xml(read_bytes(path, "check the path"), path, _REMEDY)
        if root.tag != "mujoco":
            raise InputError(path, f"begins with <{root.tag}>, not <mujoco>", _REMEDY)
        _keep_what_is_read(root, path, folder, {path.resolve()})
        model = _compiled(root, _take_meshes(root, path, folder), path)
        return _read_robot(model, root.get("model") or path.stem, path, character)


def _keep_what_is_read(element: Element, path: Path, folder: Path, included: set[Path]) -> None:
    """Put the files that are included in their place, and leave out what no robot's shape or joints need."""
    kept: list[Element] = []
    for child in element:
        part = child
        if child.tag == "include":
            file = named_file(child.get("file", ""), path, folder).resolve()
            if file in included:
                raise ValueError(f"{file.name} is included twice")
            included.add(file)
            part = plain_xml(read_bytes(file, _REMEDY), file, _REMEDY)
        elif child.tag in _MAKING:
            remedy = "give the model as mujoco.mj_saveLastXML writes it"
            raise InputError(path, f"makes bodies by <{child.tag}>, which is not read", remedy)
        elif child.tag not in _READ or "hfield" in child.attrib:
            continue
        _keep_what_is_read(part, path, folder, included)
        kept += [child] if part is child else part
    element[:] = kept


def _take_meshes(root: Element, path: Path, folder: Path) -> dict[str, bytes]:
    """The files of meshes, by the names that the model has for them from now on. It names no other file any more."""
    place, data = "", {}
    for compiler in root.iterfind("compiler"):
        place = compiler.get("meshdir") or compiler.get("assetdir") or place
    for element in root.iter():
        named = element.attrib.pop("file", "")
        element.attrib = {name: value for name, value in element.attrib.items() if name not in _LEFT_OUT}
        if element.tag == "mesh" and named:
            file = named_file(f"{place}/{named}", path, folder)
            kind = file.suffix.lower().lstrip(".")
            if kind not in _MESHES:
                problem = f"names the mesh {file.name}, of a kind that is not read"
                raise InputError(path, problem, f"use {', '.join(_MESHES)}")
            element.attrib = {"name": file.stem, **element.attrib, "file": f"{len(data)}.{kind}"}
            data[element.attrib["file"]] = read_bytes(file, _REMEDY)
    return data


def _compiled(root: Element, files: dict[str, bytes], path: Path) -> Any:
    """MuJoCo's model. What MuJoCo warns of does not go to its log file, which would be in the current folder."""
    with needs_package(path, "mujoco-core", "read", "robots", "give a .urdf file"):
        import mujoco
        from mujoco import MjLogConfig  # since version 4
    told, silent = MjLogConfig.get(), MjLogConfig.get()
    silent.logto_file = silent.logto_console = False
    MjLogConfig.set(silent)
    try:
        return mujoco.MjSpec.from_string(tostring(root, encoding="unicode"), assets=files).compile()
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        raise ValueError(" ".join(str(error).split())) from error
    finally:
        MjLogConfig.set(told)


def _read_robot(model: Any, name: str, path: Path, character: str | None) -> RiggedMesh:
    import mujoco
    from mujoco import mjtJoint

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    # The trees of bodies in which something moves, by their first bodies, and which of them are meant.
    tree, above, of_joint = model.body_rootid, model.body_parentid, model.jnt_bodyid
    roams = {int(body) for body in of_joint if not above[body]}
    moving = [joint for joint, body in enumerate(of_joint) if above[body]]
    robots: dict[int, set[int]] = {}
    for first in tree[of_joint[moving]]:
        robots.setdefault(first if first in roams else 0, set()).add(int(first))
    if not robots:
        remedy = "there is nothing to track in a rigid thing; name a robot"
        raise InputError(path, "has no joint that turns or slides", remedy)
    named = [(model.body(min(trees)).name or name,) for trees in robots.values()]
    trees = list(robots.values())[chosen_character(named, character, path)]
    base = min(trees)

    # A joint for each that moves; a body without any belongs to the one above.
    names, parent, axes = [model.body(base).name or name], [-1], {}
    turn, place = [data.xmat[base]], [data.xpos[base]]
    number = {0: 0}  # of the joint that a body follows
    for body in (body for body in range(1, model.nbody) if tree[body] in trees):
        number[body] = number[above[body]]
        for joint in (joint for joint in moving if of_joint[joint] == body):
            kind = model.jnt_type[joint]
            ball = kind == mjtJoint.mjJNT_BALL
            limits = model.jnt_range[joint] - (0 if ball else model.qpos0[model.jnt_qposadr[joint]])
            lower, upper = limits if model.jnt_limited[joint] else (-np.inf, np.inf)
            axes[len(names)] = JointAxis(data.xaxis[joint].copy(), lower, upper, kind == mjtJoint.mjJNT_SLIDE, ball)
            parent.append(number[body])
            number[body] = len(names)
            names.append(model.joint(joint).name or model.body(body).name or "joint")
            turn.append(data.xmat[body])
            place.append(data.xanchor[joint])
    bind = np.tile(np.eye(4), (len(names), 1, 1))
    bind[:, :3, :3], bind[:, :3, 3] = np.reshape(turn, (-1, 3, 3)), place
    follow = [model.joint(joint).name for joint in model.eq_obj1id]
    notes = (f"{', '.join(follow)} follow other joints there: free here",) if follow else ()
    skin = _read_geometry(model, data, number, path)
    return robot(name, names, parent, bind, skin, axes=axes, roams=base in roams, notes=notes)


def _read_geometry(model: Any, data: Any, number: dict[int, int], path: Path) -> Skin:
    """The robot as it is drawn; each vertex follows one joint."""
    from mujoco import mjtGeom

    of_geom, kind = model.geom_bodyid, model.geom_type
    ours = (of_geom > 0) & np.isin(of_geom, list(number)) & (kind != mjtGeom.mjGEOM_PLANE)
    shown = ours & (model.geom_group <= _SHOWN) & (model.geom_rgba[:, 3] > 0)
    shown = shown if shown.any() else ours
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    drawn = set(of_geom[shown & ~collides & (kind == mjtGeom.mjGEOM_MESH)])
    parts = []
    for geom in np.flatnonzero(shown).tolist():
        if not collides[geom] or of_geom[geom] not in drawn:
            turn, place = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
            parts.append((*_shape(model, geom), turn, place, number[of_geom[geom]]))
    return rigid_skin(parts, path)


def _shape(model: Any, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a geometry, in its own axes."""
    from mujoco import mjtGeom

    kind, size, mesh = model.geom_type[geom], model.geom_size[geom], model.geom_dataid[geom]
    if kind == mjtGeom.mjGEOM_MESH:
        vertex = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        face = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
        return vertex.astype(float), face.astype(np.int64)
    if kind == mjtGeom.mjGEOM_BOX:
        return solid("box", *2 * size)
    if kind == mjtGeom.mjGEOM_SPHERE:
        return solid("sphere", size[0])
    if kind == mjtGeom.mjGEOM_ELLIPSOID:
        vertex, face = solid("sphere", 1.0)
        return vertex * size, face
    return solid("capsule" if kind == mjtGeom.mjGEOM_CAPSULE else "cylinder", size[0], 2 * size[1])
