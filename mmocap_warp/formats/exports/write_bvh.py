"""Biovision's ``.bvh``: a skeleton in centimetres, Y up, and its joints' angles; no skin.

The format knows neither units nor axes. Centimetres and Y up are what MotionBuilder, Maya, iClone and Unreal's
importers assume; Blender needs ``scale 0.01``. A joint's axes are the world's in the rest pose, which is
the body's bind pose: joints keep their places, and their own frames are not in the file.
"""

from pathlib import Path

import numpy as np

from mmocap_warp.body.rotations import applied, transposed
from mmocap_warp.formats.exports.tables import Tracks, best_run_tracks, steady_angles
from mmocap_warp.result.result import Result
from mmocap_warp.whole_file import write_whole

_CENTIMETRES = 100.0
_ROTATIONS = "Zrotation Yrotation Xrotation"
_POSITIONS = "Xposition Yposition Zposition"


def write_bvh(result: Result, path: Path) -> None:
    """Write a result, which is Y up; angles to 1e-6 degrees, lengths to 1e-6 cm."""
    tracks = best_run_tracks(result)
    slides = tracks.subject.body.skeleton.slides
    has_place = slides | (np.arange(len(slides)) == 0)  # a channel for its place: the root, and joints that slide
    hierarchy, joints = _hierarchy(tracks, has_place, 0, "")
    place, degrees = _joint_motion(tracks)
    columns = [each[:, joint] for joint in joints for each in ((place, degrees) if has_place[joint] else (degrees,))]
    motion = np.concatenate(columns, axis=1)
    head = ["MOTION", f"Frames: {len(motion)}", f"Frame Time: {1 / tracks.rate:.9f}"]
    rows = (" ".join(f"{value:.6f}" for value in row) for row in motion)
    write_whole(path, "\n".join(["HIERARCHY", *hierarchy, *head, *rows, ""]).encode())


def _hierarchy(tracks: Tracks, has_place: np.ndarray, joint: int, indent: str) -> tuple[list[str], list[int]]:
    """The lines of a joint and of all that hangs on it, and the numbers of these joints in their order."""
    skeleton, skin = tracks.subject.body.skeleton, tracks.subject.body.skin
    parent, start = skeleton.parent[joint], tracks.bind[joint, :3, 3]
    # The root's channels hold its whole place: some programs add the offset to it, others put it in the offset's place.
    offset = start - (start if parent < 0 else tracks.bind[parent, :3, 3])
    channels = f"6 {_POSITIONS} {_ROTATIONS}" if has_place[joint] else f"3 {_ROTATIONS}"
    name = "_".join(skeleton.joints[joint].split())  # a blank ends a name
    lines = [f"{'JOINT' if parent >= 0 else 'ROOT'} {name}", "{", _offset(offset)]
    lines.append(f"  CHANNELS {channels}")
    joints = [joint]
    for child in (child for child, above in enumerate(skeleton.parent) if above == joint):
        below_lines, below_joints = _hierarchy(tracks, has_place, child, "  ")
        lines, joints = lines + below_lines, joints + below_joints
    if len(joints) == 1:  # the bone ends in the middle of the skin that follows it most, or where it starts without any
        own = skin.rest[skin.heaviest_joint == joint]
        lines += ["  End Site", "  {", "  " + _offset((own.mean(axis=0) if len(own) else start) - start), "  }"]
    lines.append("}")
    return [indent + line for line in lines], joints


def _offset(offset: np.ndarray) -> str:
    return "  OFFSET " + " ".join(f"{value:.6f}" for value in offset * _CENTIMETRES)


def _joint_motion(tracks: Tracks) -> tuple[np.ndarray, np.ndarray]:
    """(frame, joint, 3) twice: places in the parent's axes [cm], the root's in the world; turns about Z, Y and X.

    Turns are from the rest pose, in which all axes are the world's.
    """
    place, turned = tracks.world[..., :3, 3].copy(), tracks.world[..., :3, :3] @ transposed(tracks.bind[:, :3, :3])
    parent = np.array(tracks.subject.body.skeleton.parent)
    child = parent >= 0
    above, own = transposed(turned[:, parent[child]]), turned.copy()
    own[:, child] = above @ turned[:, child]
    place[:, child] = applied(above, place[:, child] - place[:, parent[child]])
    return place * _CENTIMETRES, np.degrees(steady_angles(own)[..., ::-1])
