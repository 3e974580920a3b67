"""A skeleton and its motion as the text of a ``.bvh``; ``acclaim_to_bvh.py`` and ``deepmimic_to_bvh.py`` import it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Bone(NamedTuple):
    """A joint, and what hangs on it."""

    name: str
    parent: int  # index, -1 for the root
    offset: Sequence[float]  # (3,), where it is from its parent in the rest pose
    end: Sequence[float]  # (3,), where it ends from there, of one on which nothing hangs


def bvh_text(bones: list[Bone], place: np.ndarray, angles: np.ndarray, interval: float) -> str:
    """The text of the root's places (frame, 3), angles about z, y and x (bone, frame, 3) [degrees], and interval [s].

    Parents come before children.
    """
    order = _depth_first(bones, 0)
    rows = np.concatenate([place, *(angles[number] for number in order)], axis=1)
    lines = ["HIERARCHY", *_hierarchy(bones, 0), "MOTION", f"Frames: {len(rows)}", f"Frame Time: {interval:.9f}"]
    return "\n".join([*lines, *map(_text, rows)]) + "\n"


def _below(bones: list[Bone], at: int) -> list[int]:
    return [number for number, bone in enumerate(bones) if bone.parent == at]


def _depth_first(bones: list[Bone], at: int) -> list[int]:
    """The bones as a hierarchy names them."""
    return [at, *(each for number in _below(bones, at) for each in _depth_first(bones, number))]


def _hierarchy(bones: list[Bone], at: int) -> list[str]:
    """The lines of a bone and of those that hang on it."""
    bone, below = bones[at], _below(bones, at)
    place = "6 Xposition Yposition Zposition" if bone.parent < 0 else "3"
    lines = [f"{'ROOT' if bone.parent < 0 else 'JOINT'} {bone.name}", "{", f"OFFSET {_text(bone.offset)}"]
    lines.append(f"CHANNELS {place} Zrotation Yrotation Xrotation")
    for number in below:
        lines += _hierarchy(bones, number)
    if not below:
        lines += ["End Site", "{", f"OFFSET {_text(bone.end)}", "}"]
    return [*lines, "}"]


def _text(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)
