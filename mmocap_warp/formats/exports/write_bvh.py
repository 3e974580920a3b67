"""Biovision's ``.bvh``: a skeleton in centimetres, Y up, and its joints' angles; no skin.

The format knows neither units nor axes. Centimetres and Y up are what MotionBuilder, Maya, iClone and Unreal's
importers assume; Blender needs ``scale 0.01``. A joint's axes are the world's in the rest pose, which is
the body's bind pose: joints keep their places, and their own frames are not in the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mmocap_warp.body.rotations import applied, near_zyx_angles, transposed
from mmocap_warp.formats.exports.tables import Tracks, best_run_tracks
from mmocap_warp.result.result import Result
from mmocap_warp.whole_file import write_whole

_CENTIMETRES = 100.0
_ROTATIONS = "Zrotation Yrotation Xrotation"
_POSITIONS = "Xposition Yposition Zposition"


def write_bvh(result: Result, path: Path) -> None:
    """Write a result, which is Y up; angles to 1e-6 degrees, lengths to 1e-6 cm."""
    tracks = best_run_tracks(result)
    hierarchy, joints = _hierarchy(tracks, 0, "")
    degrees, has_place = _degrees(tracks), _has_place(tracks)
    columns = []
    for joint in joints:
        columns += [_place(tracks, joint), degrees[:, joint]] if has_place[joint] else [degrees[:, joint]]
    motion = np.concatenate(columns, axis=1)
    lines = [
        "HIERARCHY",
        *hierarchy,
        "MOTION",
        f"Frames: {len(motion)}",
        f"Frame Time: {1 / tracks.rate:.9f}",
        *(" ".join(f"{value:.6f}" for value in row) for row in motion),
    ]
    write_whole(path, "\n".join([*lines, ""]).encode())


def _hierarchy(tracks: Tracks, joint: int, indent: str) -> tuple[list[str], list[int]]:
    """The lines of a joint and of all that hangs on it, and the numbers of these joints in their order."""
    skeleton = tracks.subject.body.skeleton
    parent = skeleton.parent[joint]
    start = tracks.bind[joint, :3, 3]
    offset = start - (0 if parent < 0 else tracks.bind[parent, :3, 3])
    below = [child for child, above in enumerate(skeleton.parent) if above == joint]
    channels = f"6 {_POSITIONS} {_ROTATIONS}" if _has_place(tracks)[joint] else f"3 {_ROTATIONS}"
    lines = [f"{'JOINT' if parent >= 0 else 'ROOT'} {skeleton.joints[joint]}", "{", _offset(offset)]
    lines.append(f"  CHANNELS {channels}")
    joints = [joint]
    for child in below:
        below_lines, below_joints = _hierarchy(tracks, child, "  ")
        lines, joints = lines + below_lines, joints + below_joints
    if not below:  # the bone ends in the middle of the skin that follows it most, or where it starts without any
        skin = tracks.subject.body.skin
        own = skin.rest[skin.heaviest_joint == joint]
        lines += ["  End Site", "  {", "  " + _offset((own.mean(axis=0) if len(own) else start) - start), "  }"]
    lines.append("}")
    return [indent + line for line in lines], joints


def _offset(offset: np.ndarray) -> str:
    return "  OFFSET " + " ".join(f"{value:.6f}" for value in offset * _CENTIMETRES)


def _has_place(tracks: Tracks) -> np.ndarray:
    """(joint,) bool, which joints have channels for their place: the root, and joints that slide."""
    slides = tracks.subject.body.skeleton.slides
    return slides | (np.arange(len(slides)) == 0)


def _place(tracks: Tracks, joint: int) -> np.ndarray:
    """(frame, 3) from the joint's parent, in its axes [cm]; the root's in the world."""
    place, parent = tracks.world[:, joint, :3, 3], tracks.subject.body.skeleton.parent[joint]
    if parent >= 0:
        axes = tracks.world[:, parent, :3, :3] @ tracks.bind[parent, :3, :3].T
        place = applied(transposed(axes), place - tracks.world[:, parent, :3, 3])
    return place * _CENTIMETRES


def _degrees(tracks: Tracks) -> np.ndarray:
    """(frame, joint, 3) turns about Z, Y and X of every joint from the rest pose, in its parent's axes."""
    turned = tracks.world[..., :3, :3] @ transposed(tracks.bind[:, :3, :3])
    parent = np.array(tracks.subject.body.skeleton.parent)
    own = turned.copy()
    own[:, parent >= 0] = transposed(turned[:, parent[parent >= 0]]) @ turned[:, parent >= 0]
    angles, last = np.empty((*own.shape[:2], 3)), np.zeros((own.shape[1], 3))
    for frame, rotation in enumerate(own):  # near to the frame before, so that no program interpolates a whole turn
        last = angles[frame] = near_zyx_angles(rotation, last)
    return np.degrees(angles[..., ::-1])
