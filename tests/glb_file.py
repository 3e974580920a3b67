"""A reader of ``.glb`` for tests, after the glTF 2.0 specification: what is wrong with a file, and its motion."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

COMPONENT = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Glb:
    """One file: its JSON, and its accessors as arrays (count, width)."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        assert size % 4 == 0
        self.json = json.loads(data[20 : 20 + size])
        self.binary_size, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0"
        self.binary = data[28 + size :]
        assert len(self.binary) == self.binary_size
        assert self.binary_size % 4 == 0

    def array(self, accessor: int) -> np.ndarray:
        about = self.json["accessors"][accessor]
        view = self.json["bufferViews"][about["bufferView"]]
        kind, width = COMPONENT[about["componentType"]], WIDTH[about["type"]]
        flat = np.frombuffer(self.binary, kind, about["count"] * width, view["byteOffset"])
        return flat.reshape(-1, width)

    def faults(self) -> list[str]:
        """Faults of structure: alignment, bounds, ranges, counts, units of quaternions, normals and weights."""
        found, document = [], self.json
        if not self.binary_size - 4 < document["buffers"][0]["byteLength"] <= self.binary_size:
            found.append("the buffer's length")
        for number, about in enumerate(document["accessors"]):
            view = document["bufferViews"][about["bufferView"]]
            size = np.dtype(COMPONENT[about["componentType"]]).itemsize
            values = self.array(number)
            if view["byteOffset"] % 4 or values.nbytes != view["byteLength"] or (values[0].nbytes % 4 and size < 4):
                found.append(f"accessor {number}: its place or alignment")
            if view["byteOffset"] + view["byteLength"] > document["buffers"][0]["byteLength"]:
                found.append(f"accessor {number}: beyond the buffer")
            if values.min(axis=0).tolist() != about["min"] or values.max(axis=0).tolist() != about["max"]:
                found.append(f"accessor {number}: its bounds")
            if not np.isfinite(values).all():
                found.append(f"accessor {number}: not finite")
        (primitive,) = document["meshes"][0]["primitives"]
        attributes = {name: self.array(index) for name, index in primitive["attributes"].items()}
        joints, weights = attributes["JOINTS_0"], attributes["WEIGHTS_0"]
        if len({len(values) for values in attributes.values()}) != 1:
            found.append("attributes of several lengths")
        if self.array(primitive["indices"]).max() >= len(joints):
            found.append("an index beyond the vertices")
        if joints.max() >= len(document["skins"][0]["joints"]) or (joints[weights == 0] != 0).any():
            found.append("a joint of a vertex")
        if (weights < 0).any() or np.abs(weights.sum(axis=1) - 1).max() > 1e-6:
            found.append("weights")
        if np.abs(np.linalg.norm(attributes["NORMAL"], axis=1) - 1).max() > 1e-4:
            found.append("normals")
        inverse_bind = self.array(document["skins"][0]["inverseBindMatrices"])
        if len(inverse_bind) != len(document["skins"][0]["joints"]) or (inverse_bind[:, 3::4] != [0, 0, 0, 1]).any():
            found.append("inverse bind matrices")
        for sampler in document["animations"][0]["samplers"]:
            time, values = self.array(sampler["input"]), self.array(sampler["output"])
            if len(time) != len(values) or (np.diff(time[:, 0]) <= 0).any() or time[0, 0] < 0:
                found.append("times")
            if values.shape[1] == 4 and np.abs(np.linalg.norm(values, axis=1) - 1).max() > 1e-5:
                found.append("a quaternion")
        return found

    def time(self) -> np.ndarray:
        """(frame,) [s]."""
        return self.array(self.json["animations"][0]["samplers"][0]["input"])[:, 0]

    def joint_worlds(self, played: bool = True) -> np.ndarray:
        """(frame, joint, 4, 4): nodes one below the other, with the animation's channels in place of their own.

        Of one that is not ``played``, as the nodes stand.
        """
        nodes, animation = self.json["nodes"], self.json["animations"][0]
        frames = len(self.time())
        moved = {
            (c["target"]["node"], c["target"]["path"]): self.array(animation["samplers"][c["sampler"]]["output"])
            for c in (animation["channels"] if played else ())
        }
        world = np.zeros((frames, len(nodes), 4, 4))

        def place(node: int, above: np.ndarray) -> None:
            about = nodes[node]
            local = np.tile(np.eye(4), (frames, 1, 1))
            local[:, :3, :3] = rotations(moved.get((node, "rotation"), [about.get("rotation", [0, 0, 0, 1])]))
            local[:, :3, 3] = moved.get((node, "translation"), about.get("translation", [0, 0, 0]))
            world[:, node] = above @ local
            for child in about.get("children", []):
                place(child, world[:, node])

        for root in self.json["scenes"][0]["nodes"]:
            place(root, np.eye(4))
        return world[:, self.json["skins"][0]["joints"]]

    def skin(self) -> np.ndarray:
        """(frame, vertex, 3) [m]."""
        attributes = self.json["meshes"][0]["primitives"][0]["attributes"]
        rest, joint, weight = (self.array(attributes[name]) for name in ("POSITION", "JOINTS_0", "WEIGHTS_0"))
        inverse_bind = self.array(self.json["skins"][0]["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2)
        matrix = self.joint_worlds() @ inverse_bind
        homogeneous = np.concatenate([rest, np.ones((len(rest), 1))], axis=1)
        return np.stack([np.einsum("vk,vkij,vj->vi", weight, m[joint], homogeneous)[:, :3] for m in matrix])


def rotations(quaternion: np.ndarray) -> np.ndarray:
    """(n, 3, 3) of x, y, z, w (n, 4)."""
    x, y, z, w = np.asarray(quaternion, float).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
