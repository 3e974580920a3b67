"""A glTF file's nodes: where they are, at rest and in its animations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mmocap_warp.formats.rigged.rigged_mesh import RiggedMotion, parents_first

_FPS = 60.0
_MAX_TRANSFORMS = 400_000  # of nodes in all frames of an animation: a minute of a hundred nodes
_PARTS = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}


def node_worlds(nodes: Sequence[dict[str, Any]], above: list[int]) -> np.ndarray:
    """(node, 4, 4): the scene from each node as the file has it."""
    local = np.stack([_local_transform(node) for node in nodes])
    return _world_transforms(local[None], above)[0]


def node_motions(
    animations: Sequence[dict[str, Any]],
    array: Callable[[int], np.ndarray],
    nodes: Sequence[dict[str, Any]],
    above: list[int],
    joints: Sequence[int],
) -> tuple[dict[str, RiggedMotion], list[str]]:
    """Each animation's joints, by the animation's name, and notes on what is too long; without keys it is left out.

    Args:
        animations: the file's.
        array: an accessor's values (count, width) by its number.
        nodes: the file's.
        above: (node,) number of the node that each hangs on, or -1.
        joints: the nodes that are wanted.
    """
    motions: dict[str, RiggedMotion] = {}
    notes = []
    for number, animation in enumerate(animations):
        channels = []
        for channel in animation["channels"]:
            target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
            if "node" in target and target["path"] in _PARTS:
                keys = array(sampler["input"])[:, 0], array(sampler["output"])
                channels.append((target["node"], target["path"], sampler.get("interpolation", "LINEAR"), *keys))
        if channels:
            name = str(animation.get("name") or f"animation{number}")
            last = max(float(time[-1]) for *_, time, _ in channels)
            if not 0 <= last * _FPS * len(nodes) < _MAX_TRANSFORMS:
                notes.append(f"motion {name} lasts {last:g} s: left out")
                continue
            frames = round(last * _FPS) + 1
            motions[name] = RiggedMotion(_FPS, _sample_channels(channels, frames, nodes, above)[:, list(joints)])
    return motions, notes


def _sample_channels(
    channels: list[tuple[int, str, str, np.ndarray, np.ndarray]],
    frames: int,
    nodes: Sequence[dict[str, Any]],
    above: list[int],
) -> np.ndarray:
    """(frame, node, 4, 4): the scene from each node."""
    when = np.arange(frames) / _FPS
    moved = {(node, path): _interpolate(when, time, value, how, path) for node, path, how, time, value in channels}
    local = np.zeros((frames, len(nodes), 4, 4))
    for number, node in enumerate(nodes):
        own = {path: moved[number, path] for path in _PARTS if (number, path) in moved}
        local[:, number] = _composed(node, own) if own else _local_transform(node)
    return _world_transforms(local, above)


def _interpolate(when: np.ndarray, time: np.ndarray, value: np.ndarray, how: str, path: str) -> np.ndarray:
    """Values of a channel at times (frame,), held before its first key and after its last."""
    if how == "CUBICSPLINE":  # tangents around each value; straight lines between the values come close
        value = value[1::3]
    if len(time) != len(value) or (np.diff(time) <= 0).any() or not np.isfinite(value).all():
        raise ValueError("an animation's keys are not in order, or not finite")
    when = np.clip(when, time[0], time[-1])
    before = np.clip(np.searchsorted(time, when, side="right") - 1, 0, max(len(time) - 2, 0))
    after = np.minimum(before + 1, len(time) - 1)
    gap = np.where(after > before, time[after] - time[before], 1.0)
    share = np.clip((when - time[before]) / gap, 0.0, 1.0)[:, None]
    if how == "STEP":
        share = np.floor(share)
    first, second = value[before], value[after]
    if path != "rotation":
        return (1 - share) * first + share * second
    cosine = (first * second).sum(axis=1, keepdims=True)
    second, cosine = np.where(cosine < 0, -second, second), np.minimum(np.abs(cosine), 1.0)
    angle = np.arccos(cosine)
    sine = np.where(angle > 1e-6, np.sin(angle), 1.0)
    near = np.where(angle > 1e-6, np.sin((1 - share) * angle) / sine, 1 - share)
    far = np.where(angle > 1e-6, np.sin(share * angle) / sine, share)
    return near * first + far * second


def _local_transform(node: dict[str, Any]) -> np.ndarray:
    """(4, 4): the parent from a node."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    return _composed(node, {})[0]


def _composed(node: dict[str, Any], moved: dict[str, np.ndarray]) -> np.ndarray:
    """(n, 4, 4) of a node's translations (n, 3), quaternions x y z w (n, 4) and scales (n, 3).

    ``moved`` holds those that an animation changes; of the others the node has one for all.
    """
    from scipy.spatial.transform import Rotation

    translation, rotation, scale = (
        moved.get(path, np.array([node.get(path, default)], float)) for path, default in _PARTS.items()
    )
    count = max(len(translation), len(rotation), len(scale))
    matrix = np.zeros((count, 4, 4))
    matrix[:, :3, :3] = Rotation.from_quat(rotation).as_matrix() * scale[:, None, :]
    matrix[:, :3, 3] = translation
    matrix[:, 3, 3] = 1.0
    if not np.isfinite(matrix).all():
        raise ValueError("a node's transform is not finite")
    return matrix


def _world_transforms(local: np.ndarray, above: list[int]) -> np.ndarray:
    """(frame, node, 4, 4): transforms relative to the node above, multiplied in place from the roots outwards."""
    for node in parents_first(above):
        if above[node] >= 0:
            local[:, node] = local[:, above[node]] @ local[:, node]
    return local
