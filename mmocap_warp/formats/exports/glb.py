"""``.glb``: glTF 2.0 in one file, with the skin and its animation, for browsers, Blender, Unreal, Unity and Godot.

Written directly, because a skin is a list of numbers and a table of where they stand: the writer is shorter than the
use of a library would be. trimesh writes neither skins nor animations, and pygltflib, which knows the names of glTF's
objects, leaves buffers, accessors and their bounds to its caller.

glTF is in metres and Y up. Time starts at 0; ``asset.extras.first_frame`` is the recording's. Cameras are left out, as
glTF's cannot have the principal point aside from the middle of the image. A body with VRM's joints makes the file a VRM
animation (``.vrma``), by the extension that names them.
"""

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mmocap_warp.body.model import BodyModel, BodyMotion, SkinMesh, Subject, bind_transforms, joint_transforms
from mmocap_warp.body.rest_space import vertex_normals
from mmocap_warp.body.rotations import quaternions
from mmocap_warp.body.skeleton import TRANSLATION, Skeleton
from mmocap_warp.formats.exports.rigs import RIGS
from mmocap_warp.formats.exports.tables import best_run_tracks
from mmocap_warp.result.marker_errors import triangulated
from mmocap_warp.result.result import Result
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import write_whole

_MAGIC, _VERSION, _JSON_CHUNK, _BINARY_CHUNK = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
_COMPONENTS = {"float32": 5126, "uint16": 5123, "uint32": 5125}
_VERTICES, _INDICES = 34962, 34963
_VRM_ANIMATION = "VRMC_vrm_animation"
_SKIN_LOOK = {"baseColorFactor": [0.8, 0.7, 0.62, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}


def write_glb(result: Result | Mapping[str, Result], path: Path) -> None:
    """Write a result, which is Y up, or several by people's names; single precision, about 1e-6 m."""
    results = result if isinstance(result, Mapping) else {"": result}
    people, moves = {}, {name: best_run_tracks(each) for name, each in results.items()}
    first = min(moves.values(), key=lambda tracks: tracks.time[0])
    about = {"first_frame": int(first.number[0]), "frames_per_second": first.rate}
    for name, tracks in moves.items():
        clip = _Clip("Motion", tracks.time - first.time[0], tracks.local)
        people[name] = tracks.subject.body, tracks.local[0], [clip]
    _write(people, about, path)


def write_body_glb(body: BodyModel, motions: Mapping[str, BodyMotion], path: Path) -> None:
    """Write a body in its bind pose, with its own motions by name."""
    stand = np.zeros(body.skeleton.coordinates)
    stand[:TRANSLATION] = body.joint_rest[0]
    subject = Subject(body, np.eye(3), stand, {})
    clips = [
        _Clip(name, np.arange(len(motion.pose)) / motion.fps, joint_transforms(subject, motion.pose)[0])
        for name, motion in motions.items()
    ]
    _write({"": (body, joint_transforms(subject, stand[None])[0][0], clips)}, {}, path)


class _Clip(NamedTuple):
    """An animation: times (frame,) [s], and the parent from each joint (frame, joint, 4, 4)."""

    name: str
    time: np.ndarray
    local: np.ndarray


_Moving = tuple[BodyModel, np.ndarray, list[_Clip]]
"""A body whose joints stand (joint, 4, 4) below their parents while none of its animations is played; and these."""


def _write(people: Mapping[str, _Moving], about: dict[str, Any], path: Path) -> None:
    """Write bodies by their names; one without a name stands alone."""
    buffer, human = _Buffer(), dict[str, Any]()
    nodes, roots, meshes, skins, motions = [], list[int](), [], [], dict[str, dict[str, Any]]()
    for number, (person, (body, stand, clips)) in enumerate(people.items()):
        # All but where its numbers stand. Nodes are the joints in their order, then the skin.
        skeleton, bind, first = body.skeleton, bind_transforms(body), len(nodes)
        joints, skin = len(skeleton.joints), _skin(body.skin, buffer)
        rigs = [name for name, rig in RIGS.items() if {*rig.names.values()} <= {*skeleton.joints}]
        stand = body.rest_transforms if rigs else stand  # who retargets asks the nodes for the rest pose
        if "vrm" in rigs and not person:
            human = {name: {"node": skeleton.index(name)} for name in RIGS["vrm"].names.values()}
        inverse_bind = np.linalg.inv(bind)
        inverse_bind[:, 3] = 0, 0, 0, 1  # exactly, as glTF asks
        inverse = buffer.add(inverse_bind.transpose(0, 2, 1), "MAT4")  # by columns
        skin_name = f"{person} skin" if person else body.name
        nodes += [*_joint_nodes(skeleton, stand, first), {"name": skin_name, "mesh": number, "skin": number}]
        if person:
            nodes.append({"name": person, "children": [first]})
        roots += [len(nodes) - 1 if person else first, first + joints]
        meshes.append({"name": body.name, "primitives": [skin]})
        skins.append({"joints": [*range(first, first + joints)], "skeleton": first, "inverseBindMatrices": inverse})
        for clip in clips:  # what has one name is played together
            motion = motions.setdefault(clip.name, {"name": clip.name, "samplers": [], "channels": []})
            _animate(motion, clip, skeleton.slides, buffer, first)
    owners = "; ".join(dict.fromkeys(body.attribution for body, *_ in people.values()))
    asset = {"version": "2.0", "generator": f"mmocap-warp {__version__}", "copyright": owners}
    document: dict[str, Any] = {"asset": asset | {"extras": about}, "scene": 0, "scenes": [{"nodes": roots}]}
    materials = [{"name": "Skin", "pbrMetallicRoughness": _SKIN_LOOK}]
    document |= {"nodes": nodes, "meshes": meshes, "materials": materials, "skins": skins}
    if human:
        about_bones = {"specVersion": "1.0", "humanoid": {"humanBones": human}}
        document |= {"extensionsUsed": [_VRM_ANIMATION], "extensions": {_VRM_ANIMATION: about_bones}}
    if motions:
        document["animations"] = list(motions.values())
    # Where the numbers stand, and the two chunks of the file.
    document |= {"bufferViews": buffer.views, "accessors": buffer.accessors}
    document |= {"buffers": [{"byteLength": len(buffer.data)}]}
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    chunks = b""
    for kind, data, padding in ((_JSON_CHUNK, text, b" "), (_BINARY_CHUNK, bytes(buffer.data), b"\0")):
        data += padding * (-len(data) % 4)
        chunks += struct.pack("<II", len(data), kind) + data
    write_whole(path, struct.pack("<III", _MAGIC, _VERSION, 12 + len(chunks)) + chunks)


class _Buffer:
    """The binary chunk, and what glTF says of its parts: a view and an accessor for each array."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: np.ndarray, kind: str, target: int | None = None) -> int:
        """Append an array (n,) or (n, ...) of ``kind`` such as ``VEC3``, with its bounds; the accessor's number.

        Floats are written in single precision. All components have four bytes, or make up a multiple of them, so that
        every array is aligned.
        """
        values = np.ascontiguousarray(values, np.float32) if values.dtype.kind == "f" else values
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": values.nbytes}
        self.views.append(view if target is None else view | {"target": target})
        self.data += values.tobytes()
        flat, component = values.reshape(len(values), -1), _COMPONENTS[values.dtype.name]
        about = {"bufferView": len(self.views) - 1, "componentType": component, "count": len(values), "type": kind}
        self.accessors.append(about | {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()})
        return len(self.accessors) - 1


def _joint_nodes(skeleton: Skeleton, stand: np.ndarray, first: int) -> list[dict[str, Any]]:
    """The joints as they stand, for programs that play nothing; ``first`` is the number of their first node."""
    (rotation,) = _steady_quaternions(stand[None, :, :3, :3])
    nodes = []
    for joint, name in enumerate(skeleton.joints):
        children = [first + child for child, parent in enumerate(skeleton.parent) if parent == joint]
        node = {"name": name, "translation": stand[joint, :3, 3].tolist(), "rotation": rotation[joint].tolist()}
        nodes.append(node | ({"children": children} if children else {}))
    return nodes


def _skin(skin: SkinMesh, buffer: _Buffer) -> dict[str, Any]:
    face, rest = triangulated(skin.face), skin.rest.astype(float)
    normal = vertex_normals(rest, face)
    normal[~normal.any(axis=1)] = 0.0, 1.0, 0.0  # where there is no face
    weight = skin.weight / skin.weight.sum(axis=1, keepdims=True, dtype=float)
    return {
        "attributes": {
            "POSITION": buffer.add(skin.rest, "VEC3", _VERTICES),
            "NORMAL": buffer.add(normal, "VEC3", _VERTICES),
            "JOINTS_0": buffer.add(np.where(weight > 0, skin.joint, 0).astype(np.uint16), "VEC4", _VERTICES),
            "WEIGHTS_0": buffer.add(weight, "VEC4", _VERTICES),
        },
        "indices": buffer.add(face.astype(np.uint32).ravel(), "SCALAR", _INDICES),
        "material": 0,
    }


def _animate(motion: dict[str, Any], clip: _Clip, slides: np.ndarray, buffer: _Buffer, first: int) -> None:
    """Add to a motion the place of the root and of joints that slide, and every joint's turn."""
    rotation = _steady_quaternions(clip.local[..., :3, :3])
    time = buffer.add(clip.time, "SCALAR")
    moving = (0, *np.flatnonzero(slides).tolist())
    outputs = [(joint, "translation", buffer.add(clip.local[:, joint, :3, 3], "VEC3")) for joint in moving]
    outputs += [(joint, "rotation", buffer.add(rotation[:, joint], "VEC4")) for joint in range(rotation.shape[1])]
    targets = enumerate(({"node": first + joint, "path": path} for joint, path, _ in outputs), len(motion["samplers"]))
    motion["channels"] += [{"sampler": sampler, "target": target} for sampler, target in targets]
    motion["samplers"] += [{"input": time, "output": output} for *_, output in outputs]


def _steady_quaternions(rotation: np.ndarray) -> np.ndarray:
    """(frame, joint, 4) x, y, z, w of rotations (frame, joint, 3, 3), each on the side of the one before it."""
    quaternion = quaternions(rotation)
    flips = np.where((quaternion[1:] * quaternion[:-1]).sum(axis=-1) < 0, -1.0, 1.0)
    quaternion[1:] *= np.cumprod(flips, axis=0)[..., None]
    return quaternion
