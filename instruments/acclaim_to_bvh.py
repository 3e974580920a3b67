"""Turns Acclaim's ``.asf`` (a skeleton) and ``.amc`` (its motion), as the CMU database has them, into a ``.bvh``.

python instruments/acclaim_to_bvh.py 02_01.amc 02_01.bvh
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bvh_text import Bone, bvh_text

from mmocap_warp.body.rotations import turn
from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import read_text, write_whole

FPS = 120.0
"""Of CMU's clips; the files do not say."""

_REMEDY = "give a complete Acclaim file"
_NAME_REMEDY = "check its name, or name the .asf file"
_ROOT_ORDER = ("tx", "ty", "tz", "rx", "ry", "rz")


@dataclass
class _Bone:
    """A bone of the skeleton; the root has no length."""

    name: str
    vector: np.ndarray  # (3,), from its start to its end in the rest pose
    axes: np.ndarray  # (3, 3), in which its rotations are given
    channels: tuple[str, ...]  # such as ``rx``, in the file's order
    parent: int = -1  # index, -1 for the root


def bvh_of_amc(path: Path, skeleton: Path | None = None) -> str:
    """An ``.amc`` file and its skeleton, the ``.asf`` file, as the text of a ``.bvh``.

    Without ``skeleton`` it is the one beside the motion that is named as the motion is up to an underscore (``02.asf``
    for ``02_01.amc``).

    Raises:
        InputError: a file that is missing or wrong.
    """
    from scipy.spatial.transform import Rotation

    skeleton = path.with_name(f"{path.stem.split('_')[0]}.asf") if skeleton is None else skeleton
    bones = _read_skeleton(skeleton)
    frames = _read_motion(path, {bone.name: bone.channels for bone in bones})
    place = frames["root"][:, [bones[0].channels.index(channel) for channel in _ROOT_ORDER[:3]]]
    angles = []
    for bone in bones:
        rotation = np.tile(np.eye(3), (len(place), 1, 1))
        for channel, values in zip(bone.channels, frames[bone.name].T, strict=True):
            if channel[0] == "r":
                rotation = turn(channel[1], np.radians(values)) @ rotation  # the first acts first
        angles.append(Rotation.from_matrix(bone.axes @ rotation @ bone.axes.T).as_euler("ZYX", degrees=True))
    # A bone begins where the one that it hangs on ends.
    starts = [bones[bone.parent].vector if bone.parent >= 0 else np.zeros(3) for bone in bones]
    written = [Bone(bone.name, bone.parent, start, bone.vector) for bone, start in zip(bones, starts, strict=True)]
    return bvh_text(written, place, np.array(angles), 1 / FPS)


def _read_skeleton(path: Path) -> list[_Bone]:
    """The bones, parents before children."""
    sections = _sections(path)
    order = next((line[1:] for line in sections.get("root", []) if line[0] == "order"), None)
    if order is None:
        raise InputError(path, "has no root", _REMEDY)
    channels = tuple(word.lower() for word in order)
    if sorted(channels) != sorted(_ROOT_ORDER):
        raise InputError(path, f"its root's order is {' '.join(order)}", f"use {' '.join(_ROOT_ORDER)}")
    bones = {"root": _Bone("root", np.zeros(3), np.eye(3), channels)}
    # The bones' own data, each between begin and end.
    entry: dict[str, list[str]] = {}
    for line in sections.get("bonedata", []):
        if line[0] == "begin":
            entry = {}
        elif line[0] == "end":
            bone = _read_bone(path, entry)
            bones[bone.name] = bone
        else:
            entry.setdefault(line[0], line[1:])
    # The hierarchy: a line names a bone and those that hang on it.
    names = ["root"]
    for line in sections.get("hierarchy", []):
        if line[0] in ("begin", "end"):
            continue
        if unknown := [name for name in line if name not in bones]:
            raise InputError(path, f"its hierarchy names {unknown}, which are no bones", _REMEDY)
        if line[0] not in names:
            raise InputError(path, f"its hierarchy names '{line[0]}' before its parent", _REMEDY)
        for child in line[1:]:
            bones[child].parent = names.index(line[0])
            names.append(child)
    return [bones[name] for name in names]


def _read_bone(path: Path, entry: dict[str, list[str]]) -> _Bone:
    try:
        direction, axis = (_three_numbers(entry, key) for key in ("direction", "axis"))
        x, y, z = np.radians(axis)
        channels = tuple(word.lower() for word in entry.get("dof", []))
        if any(channel not in ("rx", "ry", "rz") for channel in channels):
            raise ValueError(f"dof {' '.join(channels)}")
        vector = direction / np.linalg.norm(direction) * float(entry["length"][0])
        return _Bone(entry["name"][0], vector, turn("z", z) @ turn("y", y) @ turn("x", x), channels)
    except (KeyError, ValueError, IndexError) as error:
        name = " ".join(entry.get("name", ["without a name"]))
        raise InputError(path, f"bone {name} is not complete ({error})", _REMEDY) from None


def _three_numbers(entry: dict[str, list[str]], key: str) -> np.ndarray:
    values = np.array(entry[key][:3], float)
    if len(values) != 3 or not np.isfinite(values).all():
        raise ValueError(f"{key} {' '.join(entry[key])} is not three numbers")
    return values


def _lines(path: Path) -> list[list[str]]:
    """A file's lines as words."""
    return [line.split() for line in read_text(path, _NAME_REMEDY, missing=_NAME_REMEDY, errors="replace").splitlines()]


def _sections(path: Path) -> dict[str, list[list[str]]]:
    """The lines of each ``:section``, as words."""
    sections: dict[str, list[list[str]]] = {}
    section = ""
    for words in _lines(path):
        if words and words[0].startswith(":"):
            section = words[0][1:].lower()
            words = words[1:]
        if words and not words[0].startswith("#"):
            sections.setdefault(section, []).append(words)
    return sections


def _read_motion(path: Path, channels: dict[str, tuple[str, ...]]) -> dict[str, np.ndarray]:
    """(frame, channel) of each bone; zeros for one that the file leaves out."""
    frames: list[dict[str, list[float]]] = []
    for number, words in enumerate(_lines(path), 1):
        if not words or words[0].startswith(("#", ":")):
            continue
        if len(words) == 1 and words[0].isdigit():
            frames.append({})
            continue
        name = words[0]
        try:
            values = [float(word) for word in words[1:]]
        except ValueError as error:
            raise InputError(f"{path}: line {number}", str(error), _REMEDY) from None
        if not frames or len(values) != len(channels.get(name, ())) or not np.isfinite(values).all():
            raise InputError(f"{path}: line {number}", f"does not fit the skeleton's bone '{name}'", _REMEDY)
        frames[-1][name] = values
    if not frames or any("root" not in frame for frame in frames):
        raise InputError(path, "has no frame, or one without a root", _REMEDY)
    widths = {name: len(order) for name, order in channels.items()}
    rows = {name: [frame.get(name, [0.0] * width) for frame in frames] for name, width in widths.items()}
    return {name: np.array(rows[name]).reshape(len(frames), width) for name, width in widths.items()}


if __name__ == "__main__":
    motion, output, *given = map(Path, sys.argv[1:])
    write_whole(output, bvh_of_amc(motion, *given).encode())
