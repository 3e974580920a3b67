"""Skinned characters in glTF 2.0: ``.glb``, and ``.gltf`` with its buffers inside or beside it."""

import base64
import json
import re
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from mmocap_warp.body.mesh_pieces import connected
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.rigged import compressed, rigged_mesh
from mmocap_warp.whole_file import read_bytes

_MAGIC, _JSON_CHUNK, _BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
_KINDS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_TRIANGLES = 4
# Extensions without a bearing on geometry, joints and skin, and one whose values are read as any others.
_READABLE = re.compile(r"(KHR|EXT|MSFT|VRMC?)_(materials|texture|lights|springBone|xmp|mesh_quantization)|VRM")
_REMEDY = "export it again as glTF 2.0 with its skin, without compression"


def read_gltf(path: str | Path, character: str | None = None) -> rigged_mesh.RiggedMesh:
    """Read a skinned character with its animations; of several the one of that name."""
    path = Path(path)
    try:
        return _read_character(_Document(path), path, character)
    except InputError:
        raise
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError, struct.error) as error:
        raise InputError(path, f"is damaged, or no glTF ({type(error).__name__}: {error})", _REMEDY) from None
    except (RecursionError, MemoryError):
        raise InputError(path, "is damaged, or no glTF (it is nested too deep, or too long)", _REMEDY) from None


class _Document:
    """A file's JSON, and its accessors as arrays."""

    def __init__(self, path: Path) -> None:
        data = read_bytes(path, "check the path")
        binary = b""
        # The JSON, and the binary chunk after it.
        if path.suffix.lower() != ".gltf":
            magic, version, _ = struct.unpack_from("<III", data)
            if magic != _MAGIC or version != 2:
                raise InputError(path, "is not binary glTF 2.0", _REMEDY)
            size, kind = struct.unpack_from("<II", data, 12)
            if kind != _JSON_CHUNK:
                raise InputError(path, "does not begin with its JSON", _REMEDY)
            text = data[20 : 20 + size]
            if len(data) >= 28 + size:
                length, kind = struct.unpack_from("<II", data, 20 + size)
                binary = data[28 + size : 28 + size + length] if kind == _BINARY_CHUNK else b""
        else:
            text = data
        self.json = json.loads(text)
        # A file that needs what is not read here is refused.
        for name in self.json.get("extensionsRequired", []):
            if not _READABLE.match(name) and not compressed.has_decoder(name):
                problem = f"needs the glTF extension {name}, which is not read"
                decoder = compressed.DECODERS.get(name)
                raise InputError(path, problem, f"pip install {decoder}" if decoder else _REMEDY)
        # The buffers: the binary chunk, text within the JSON, or files beside it.
        self._buffers = []
        for about in self.json.get("buffers", []):
            uri = about.get("uri")
            if uri is None:
                self._buffers.append(binary)
            elif uri.startswith("data:"):
                self._buffers.append(base64.b64decode(uri.partition(",")[2], validate=True))
            else:
                self._buffers.append(read_bytes(_file_inside(path.parent, uri, path), "check the path"))
        self._decoded = self._of_draco() if compressed.has_decoder(compressed.DRACO) else {}

    def _of_draco(self) -> dict[int, np.ndarray]:
        """The values of the accessors of compressed meshes, by their numbers."""
        decoded: dict[int, np.ndarray] = {}
        for primitive in (each for mesh in self.list("meshes") for each in mesh["primitives"]):
            if about := primitive.get("extensions", {}).get(compressed.DRACO):
                data = self._bytes(self.list("bufferViews")[_index(about["bufferView"])])
                corners, values = compressed.draco_mesh(data, about["attributes"])
                decoded[primitive["indices"]] = corners
                decoded |= {primitive["attributes"][name]: each for name, each in values.items()}
        return decoded

    def _bytes(self, part: dict[str, Any]) -> bytes:
        """A part of a buffer."""
        first = _index(part.get("byteOffset", 0))
        return self._buffers[_index(part["buffer"])][first : first + _index(part["byteLength"])]

    def list(self, name: str) -> list[dict[str, Any]]:
        """A list of the file, empty where it has none."""
        values = self.json.get(name, [])
        if not isinstance(values, list) or not all(isinstance(each, dict) for each in values):
            raise ValueError(f"{name} is no list of objects")
        return values

    def array(self, accessor: int) -> np.ndarray:
        """An accessor's values (count, width): whole numbers, or float64 where they are floats or normalized."""
        about = self.list("accessors")[_index(accessor)]
        kind, width, count = np.dtype(_KINDS[about["componentType"]]), _WIDTHS[about["type"]], about["count"]
        if accessor in self._decoded:
            values = self._decoded[accessor]
            if values.shape != (count, width):
                raise ValueError(f"{values.shape} values were decoded, not {(count, width)}")
        elif "bufferView" in about:
            values = self._view(about["bufferView"], about.get("byteOffset", 0), kind, count, width)
        else:
            if not 0 < count <= max(map(len, self._buffers), default=0):
                raise ValueError("an accessor without values is longer than the file")
            values = np.zeros((count, width), kind)
        if "sparse" in about:
            sparse, values = about["sparse"], values.copy()
            where, new = sparse["indices"], sparse["values"]
            index_kind = np.dtype(_KINDS[where["componentType"]])
            index = self._view(where["bufferView"], where.get("byteOffset", 0), index_kind, sparse["count"], 1)
            values[index[:, 0]] = self._view(new["bufferView"], new.get("byteOffset", 0), kind, sparse["count"], width)
        if about.get("normalized", False):
            return np.maximum(values / float(2 ** (8 * kind.itemsize - (kind.kind == "i")) - 1), -1.0)
        return values.astype(np.float64) if kind.kind == "f" else values

    def _view(self, number: int, offset: int, kind: np.dtype, count: int, width: int) -> np.ndarray:
        view = self.list("bufferViews")[_index(number)]
        packed = view.get("extensions", {}).get(compressed.MESHOPT)
        if packed and compressed.has_decoder(compressed.MESHOPT):
            data, view = compressed.meshopt_view(packed, self._bytes(packed)), view | {"byteOffset": 0}
        else:
            data = self._buffers[_index(view["buffer"])]
        first, stride = view.get("byteOffset", 0) + offset, view.get("byteStride", kind.itemsize * width)
        end = first + stride * (count - 1) + kind.itemsize * width
        if count < 1 or first < 0 or stride < kind.itemsize * width or end > len(data):
            raise ValueError("an accessor reaches beyond its buffer")
        return np.ndarray((count, width), kind.newbyteorder("<"), data, first, (stride, kind.itemsize)).copy()


def _index(number: int) -> int:
    if type(number) is not int or number < 0:
        raise ValueError(f"{number!r} is not an index")
    return number


def _read_character(document: _Document, path: Path, character: str | None) -> rigged_mesh.RiggedMesh:
    nodes, skins = document.list("nodes"), document.list("skins")
    skinned = [(i, node) for i, node in enumerate(nodes) if "skin" in node and "mesh" in node]
    channels = [each for one in document.list("animations") for each in one["channels"]]
    moving = {number: number for each in channels if (number := each["target"].get("node")) is not None}
    if not skinned and not (moving and any("mesh" in node for node in nodes)):
        raise InputError(path, "holds no skinned mesh", "export the character with its armature and skin")
    # The tree of the nodes, and the joints among them, parents first.
    above = [-1] * len(nodes)
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            above[_index(child)] = number
    rigged_mesh.parents_first(above)  # raises where nodes hang on each other in a circle
    skinned = _of_one_character(document, skinned, above, character, path) if skinned else []
    of_skins = (_index(joint) for _, node in skinned for joint in skins[_index(node["skin"])]["joints"])
    # Where nothing has a skin, nodes that move are the joints, and those with a mesh that hang on none.
    held = {number for number, node in enumerate(nodes) if "mesh" in node and _nearest_above(number, above, moving) < 0}
    whole = [number for number in range(len(nodes)) if number in moving or number in held]
    joints = list(dict.fromkeys(of_skins)) or whole
    joint_of = {node: joint for joint, node in enumerate(joints)}
    parent = [_nearest_above(node, above, joint_of) for node in joints]
    order = rigged_mesh.parents_first(parent)
    rest = _world_transforms(np.stack([_local_transforms(node, {}) for node in nodes], axis=1), above)[0]
    # The skin, each part brought from the space in which it is bound to the scene's.
    parts: list[rigged_mesh.Skin] = []
    bind: dict[int, np.ndarray] = {}
    for skin in dict.fromkeys(node["skin"] for _, node in skinned):
        own = _bind_transforms(document, skins[skin])
        of_skin = [(number, node["mesh"]) for number, node in skinned if node["skin"] == skin]
        own_joints = [joint_of[joint] for joint in own]
        read = [part for _, mesh in of_skin for part in _read_mesh(document, mesh, own_joints, np.eye(4))]
        followed = {joint for part in read for joint in np.unique(part.influence[part.weight > 0]).tolist()}
        # Where no skin follows a joint, some exporters write no bind transform: the identity, which is not used.
        known = {j: own[j] for j in own if joint_of[j] in followed or np.abs(own[j] - np.eye(4)).max() > 1e-6} or own
        in_order = [joints[joint] for joint in order if joints[joint] in known]
        scene = _scene_from_bind(np.stack([known[joint] for joint in in_order]), rest[in_order], rest[of_skin[0][0]])
        for joint, matrix in known.items():
            bind.setdefault(joint, scene @ matrix)
        parts += [part._replace(vertex=part.vertex @ scene[:3, :3].T + scene[:3, 3]) for part in read]
    bones = [(joints[joint], joints[parent[joint]]) for joint in order if parent[joint] >= 0]
    bind = {joint: rest[joint] for joint in joints} | _bound_by_neighbours(bind, rest, bones)
    # Meshes without a skin that hang on a joint follow it.
    motions, notes = _node_motions(document, nodes, above, joints)
    for number, node in enumerate(nodes):
        joint = _nearest_above(number, above, joint_of, include_itself=True) if "mesh" in node else -1
        if "skin" in node or joint < 0:
            continue
        carrier = joints[joint]
        scene = bind[carrier] @ np.linalg.inv(rest[carrier]) @ rest[number]
        parts += _read_mesh(document, node["mesh"], joint, scene)
        if number != carrier:
            notes.append(f"mesh {node.get('name') or number} has no skin: it follows {nodes[carrier].get('name')}")
    mesh = rigged_mesh.RiggedMesh(
        name=str((skinned[0][1] if skinned else {}).get("name") or path.stem),
        joints=tuple(str(nodes[node].get("name") or f"joint{node}") for node in joints),
        parent=tuple(parent),
        bind=np.stack([bind[node] for node in joints]),
        **rigged_mesh.joined_parts(parts)._asdict(),
        motions=motions,
        attribution=str(document.json.get("asset", {}).get("copyright", "")),
        notes=tuple(dict.fromkeys(notes)),
    )
    return rigged_mesh.reorder(mesh, order)


def _of_one_character(
    document: _Document, skinned: list[tuple[int, dict[str, Any]]], above: list[int], named: str | None, path: Path
) -> list[tuple[int, dict[str, Any]]]:
    """The skinned nodes of the character that is meant: a character's joints hang on each other or share a skin."""
    skins = [document.list("skins")[_index(node["skin"])]["joints"] for _, node in skinned]
    joints = {_index(joint): joint for each in skins for joint in each}
    links = [(each[0], joint) for each in skins for joint in each]
    links += [(joint, higher) for joint in joints if (higher := _nearest_above(joint, above, joints)) >= 0]
    start, end = np.array(links).T
    number = connected(start, end, len(above))
    of_character: dict[int, list[tuple[int, dict[str, Any]]]] = {}
    for each, own in zip(skinned, skins, strict=True):
        of_character.setdefault(int(number[own[0]]), []).append(each)
    names = [tuple(str(node.get("name") or place) for place, node in some) for some in of_character.values()]
    return list(of_character.values())[rigged_mesh.chosen_character(names, named, path)]


def _bind_transforms(document: _Document, skin: dict[str, Any]) -> dict[int, np.ndarray]:
    """The bind transform (4, 4) of each of a skin's joints, by its node."""
    joints = skin["joints"]
    inverse = np.tile(np.eye(4), (len(joints), 1, 1))
    if "inverseBindMatrices" in skin:
        inverse = document.array(skin["inverseBindMatrices"])[: len(joints)].reshape(-1, 4, 4).swapaxes(1, 2)
    bind = np.linalg.inv(inverse)
    if not np.isfinite(bind).all() or len(set(joints)) < len(joints):
        raise ValueError("a bind transform is not finite, or a joint is there twice")
    return dict(zip(joints, bind, strict=True))


def _nearest_above(node: int, above: list[int], joint_of: dict[int, int], *, include_itself: bool = False) -> int:
    """The nearest joint above a node, -1 where there is none."""
    node = node if include_itself else above[node]
    while node >= 0 and node not in joint_of:
        node = above[node]
    return joint_of.get(node, -1)


def _read_mesh(document: _Document, number: int, joints: list[int] | int, scene: np.ndarray) -> list[rigged_mesh.Skin]:
    """A mesh's parts, brought into the scene, which follow the joints of a skin, or all one joint."""
    primitives = document.list("meshes")[_index(number)]["primitives"]
    parts = [_read_primitive(document, primitive, joints) for primitive in primitives]
    return [part._replace(vertex=part.vertex @ scene[:3, :3].T + scene[:3, 3]) for part in parts]


def _read_primitive(document: _Document, primitive: dict[str, Any], joints: list[int] | int) -> rigged_mesh.Skin:
    """A part of a mesh, which follows the joints of a skin with these numbers, or all one joint."""
    if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
        raise ValueError("a mesh is not of triangles")
    attributes = primitive["attributes"]
    vertex = document.array(attributes["POSITION"]).astype(np.float64)
    index = document.array(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(vertex))
    face = index[: len(index) // 3 * 3].astype(np.int64).reshape(-1, 3)
    if isinstance(joints, int):
        joint, weight, joints = np.zeros((len(vertex), 1), np.int64), np.ones((len(vertex), 1)), [joints]
    else:
        if not (sets := [i for i in range(len(attributes)) if f"JOINTS_{i}" in attributes]):
            raise ValueError("a mesh with a skin needs JOINTS_0 and WEIGHTS_0")
        joint = np.concatenate([document.array(attributes[f"JOINTS_{i}"]) for i in sets], axis=1).astype(np.int64)
        weight = np.concatenate([document.array(attributes[f"WEIGHTS_{i}"]) for i in sets], axis=1).astype(np.float64)
        weight[np.isnan(weight)] = 0.0  # exporters divide the weights of loose vertices by their sum of zero
        if joint.max(initial=0) >= len(joints):
            raise ValueError(f"a vertex follows joint {joint.max()} of a skin that has {len(joints)}")
    sound = vertex.shape[1] == 3 and joint.shape == weight.shape and len(joint) == len(vertex)
    if not sound or not np.isfinite(vertex).all() or not np.isfinite(weight).all() or (weight < 0).any():
        raise ValueError("a mesh's vertices and weights do not fit together, or are not finite")
    if len(face) and face.max() >= len(vertex):
        raise ValueError("a triangle names a vertex that does not exist")
    return rigged_mesh.Skin(vertex, face, np.array(joints)[np.where(weight > 0, joint, 0)], weight)


def _scene_from_bind(bind: np.ndarray, rest: np.ndarray, mesh: np.ndarray) -> np.ndarray:
    """(4, 4): what takes the space in which the skin is bound to the scene's.

    The format does not say. Exporters bind in the scene's space, in the mesh node's or in one of their own; of these
    the one that brings the joints nearest to where the nodes have them is taken.
    """

    def apart(scene: np.ndarray) -> float:
        return float(np.linalg.norm((scene @ bind - rest)[:, :3, 3], axis=1).mean())

    candidates = [np.eye(4), mesh, rest[0] @ np.linalg.inv(bind[0])]
    nearest = min(map(apart, candidates))
    slack = 1e-3 * float(np.ptp(rest[:, :3, 3], axis=0).max())
    return next(scene for scene in candidates if apart(scene) <= nearest + slack)


def _bound_by_neighbours(
    bind: dict[int, np.ndarray], rest: np.ndarray, bones: list[tuple[int, int]]
) -> dict[int, np.ndarray]:
    """Bind transforms (4, 4) by node, and those of joints without one: each is to a neighbour as the nodes have them.

    A bone is a joint and the one that it hangs on; bones come from the roots outwards.
    """
    from scipy.spatial.transform import Rotation

    bind = dict(bind)
    for _ in bones:  # a bone farther each time: the nearest neighbour counts
        for new, known in (*bones, *(bone[::-1] for bone in bones)):
            if known in bind and new not in bind:
                turn = np.eye(4)
                turn[:3, :3] = Rotation.from_matrix((bind[known] @ np.linalg.inv(rest[known]))[:3, :3]).as_matrix()
                turn[:3, 3] = bind[known][:3, 3] - turn[:3, :3] @ rest[known, :3, 3]
                bind[new] = turn @ rest[new]
    return bind


def _file_inside(folder: Path, name: str, source: object) -> Path:
    """The file ``name`` in ``folder`` or below it; ``source`` is the file that names it."""
    root = folder.resolve()
    problem = f"names a file {name!r}, which is not a valid name"  # such as one with a zero byte
    with input_errors(source, problem, "correct that name", OSError, ValueError):
        file = (root / unquote(name)).resolve()
        exists = file.is_file()
    if not file.is_relative_to(root):
        raise InputError(source, f"names '{name}', which is outside {folder}", "copy it there, and correct its name")
    if not exists:
        raise InputError(source, f"names '{name}', which is not in {folder}", "copy that file there")
    return file


_FPS = 60.0
_MAX_TRANSFORMS = 400_000  # of nodes in all frames of an animation: a minute of a hundred nodes
_PARTS = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}


def _node_motions(
    document: _Document, nodes: list[dict[str, Any]], above: list[int], joints: list[int]
) -> tuple[dict[str, rigged_mesh.RiggedMotion], list[str]]:
    """Each animation that moves joints, by its name, and notes on those that are too long to be read whole.

    An animation without keys is left out, and so are those of other characters.
    """
    motions: dict[str, rigged_mesh.RiggedMotion] = {}
    notes, moving = [], set(joints)
    for joint in joints:
        while (joint := above[joint]) >= 0:
            moving.add(joint)
    for number, animation in enumerate(document.list("animations")):
        channels = []
        for channel in animation["channels"]:
            target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
            if target.get("node") in moving and target["path"] in _PARTS:
                keys = document.array(sampler["input"])[:, 0], document.array(sampler["output"])
                channels.append((target["node"], target["path"], sampler.get("interpolation", "LINEAR"), *keys))
        if not channels:
            continue
        name = str(animation.get("name") or f"animation{number}")
        last, longest = max(float(time[-1]) for *_, time, _ in channels), _MAX_TRANSFORMS / _FPS / len(nodes)
        if not 0 <= last < np.inf:
            notes.append(f"motion {name} lasts {last:g} s: left out")
            continue
        if last > longest:
            notes.append(f"motion {name} lasts {last:g} s: its first {longest:.3g} s are taken")
            last = longest
        # What its channels move at even times; the rest of each node is as the file has it.
        when = np.arange(round(last * _FPS) + 1) / _FPS
        moved: dict[int, dict[str, np.ndarray]] = {}
        for each, path, how, time, value in channels:
            moved.setdefault(each, {})[path] = _interpolate(when, time, value, how, path)
        local = np.zeros((len(when), len(nodes), 4, 4))
        for each, node in enumerate(nodes):
            local[:, each] = _local_transforms(node, moved.get(each, {}))
        motions[name] = rigged_mesh.RiggedMotion(_FPS, _world_transforms(local, above)[:, joints])
    return motions, notes


def _interpolate(when: np.ndarray, time: np.ndarray, value: np.ndarray, how: str, path: str) -> np.ndarray:
    """Values of a channel at times (frame,), held before its first key and after its last."""
    from scipy.spatial.transform import Rotation, Slerp

    if how == "CUBICSPLINE":  # tangents around each value; straight lines between the values come close
        value = value[1::3]
    if len(time) != len(value) or (np.diff(time) < 0).any() or not np.isfinite(value).all():
        raise ValueError("an animation's keys are not in order, or not finite")
    last = np.append(np.diff(time) > 0, True)  # of keys at the same time the last counts
    time, value = time[last], value[last]
    if how == "STEP":
        return value[np.maximum(np.searchsorted(time, when, side="right") - 1, 0)]
    if path == "rotation" and len(time) > 1:
        return Slerp(time, Rotation.from_quat(value))(np.clip(when, time[0], time[-1])).as_quat()
    return np.stack([np.interp(when, time, column) for column in value.T], axis=1)


def _local_transforms(node: dict[str, Any], moved: dict[str, np.ndarray]) -> np.ndarray:
    """(frame, 4, 4): the parent from a node, whose parts are (frame, 3 or 4) where an animation has ``moved`` them."""
    from scipy.spatial.transform import Rotation

    if "matrix" in node and not moved:
        return np.array(node["matrix"], float).reshape(1, 4, 4).swapaxes(1, 2)
    held = {path: np.array([node.get(path, default)], float) for path, default in _PARTS.items() if path not in moved}
    translation, rotation, scale = ((moved | held)[path] for path in _PARTS)
    matrix = np.zeros((max(map(len, (translation, rotation, scale))), 4, 4))
    matrix[:, :3, :3] = Rotation.from_quat(rotation).as_matrix() * scale[:, None, :]
    matrix[:, :3, 3], matrix[:, 3, 3] = translation, 1.0
    if not np.isfinite(matrix).all():
        raise ValueError("a node's transform is not finite")
    return matrix


def _world_transforms(local: np.ndarray, above: list[int]) -> np.ndarray:
    """(frame, node, 4, 4): transforms relative to the node above, multiplied in place from the roots outwards."""
    for node in rigged_mesh.parents_first(above):
        if above[node] >= 0:
            local[:, node] = local[:, above[node]] @ local[:, node]
    return local
