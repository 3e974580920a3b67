"""The walker of the built-in scene with something in the right hand: a racket, or a case that is let go.

The things are made here and written beside the masks as ``.obj`` files, as people have them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mmocap_warp.bodies.attaching import carrying
from mmocap_warp.body.bind_transforms import bind_transforms
from mmocap_warp.body.rotations import applied, transposed, turn, zyx_angles
from mmocap_warp.errors import InputError
from mmocap_warp.formats.attachments import ALL, FIXED, Attachment, attachment_lines
from mmocap_warp.synthesis.footage.recording import Recording
from mmocap_warp.synthesis.posing import ExactPoser
from mmocap_warp.synthesis.walk import FOREGROUND, segmentation, walking
from mmocap_warp.synthesis.writing import write_made_scene
from mmocap_warp.whole_file import write_whole

_SIDES = 24  # of what is round
_PALM = (-0.03, -0.07, 0.075)  # from the right wrist's centre, in the bind pose [m]

_CASE = (0.10, 0.32, 0.44)  # across, high and long [m]
_HANDLE = 0.04  # over the case [m]
_LET_GO = 0.45  # of the recording
_TUMBLE = np.array([0.9, 0.5, -1.6])  # turning about the world's axes while it falls [rad/s]
_GRAVITY = 9.81  # [m/s^2]
_ALL = FOREGROUND.replace('keep = "largest"', 'keep = "all"')  # in a mask, a racket's head may lie apart from the hand


@dataclass(frozen=True)
class Mesh:
    """A closed mesh: vertices (vertex, 3) [m] and triangles (face, 3), counter-clockwise seen from outside."""

    vertex: np.ndarray
    face: np.ndarray

    def written(self, path: Path) -> Path:
        """Write it as ``.obj``."""
        lines = ["v {:.6f} {:.6f} {:.6f}".format(*place) for place in self.vertex]
        lines += ["f {} {} {}".format(*corner) for corner in self.face + 1]
        write_whole(path, "\n".join([*lines, ""]).encode())
        return path


def racket() -> Mesh:
    """A tennis racket, its strings a closed disc; origin in the grip, y points to its head, z away from the strings."""
    disc = _prism(np.array([0.13, 0.17]), 0.022)
    head = Mesh(disc.vertex + np.array([0.0, 0.39, 0.0]), disc.face)
    parts = [head, _rod(0.016, -0.09, 0.09), _rod(0.011, 0.09, 0.24)]
    first = np.cumsum([0, *(len(part.vertex) for part in parts)])
    faces = [part.face + start for part, start in zip(parts, first, strict=False)]
    return Mesh(np.concatenate([part.vertex for part in parts]), np.concatenate(faces))


def case() -> Mesh:
    """A flat case that stands upright; its origin is in its handle, a little above it, and z is along it."""
    import trimesh

    box = trimesh.creation.box(_CASE)
    return Mesh(np.asarray(box.vertices) - (0.0, _HANDLE + _CASE[1] / 2, 0.0), np.asarray(box.faces))


def write_with_racket(folder: Path, frames: int) -> Path:
    """Write a scene in which the walker carries a racket, fixed to the right wrist; the path of ``scene.toml``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    mesh = racket().written(_made(folder) / "racket.obj")
    thing = Attachment("Racket", mesh, "RWrist", _PALM, (75.0, 0.0, 90.0), free=FIXED)
    recording, plain = _holding(thing, frames)
    return _write(folder, recording, _extended(recording, plain.poses), thing, "A person walking with a racket.")


def write_with_case(folder: Path, frames: int) -> Path:
    """Write a scene in which the walker carries a case, lets it go, and it falls to the floor and stays there.

    Raises:
        InputError: a folder that cannot be written to.
    """
    mesh = case().written(_made(folder) / "case.obj")
    plain = walking(frames)
    first = _relative(plain, *_case_course(plain))[0]
    thing = Attachment("Case", mesh, position=tuple(np.round(first[0], 2).tolist()), free=ALL)
    recording, plain = _holding(thing, frames)
    place, axes = _case_course(plain)
    shift, turned = _relative(plain, place, axes)
    poses = _extended(recording, plain.poses)
    poses[:, -6:-3], poses[:, -3:] = shift - thing.position, zyx_angles(turned)
    return _write(folder, recording, poses, thing, "A person walking who lets a case fall.")


CARRIED = {"racket": write_with_racket, "case": write_with_case}
"""What writes a scene in which the walker carries something."""


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, f"cannot be written to ({error})", "choose another folder") from error
    return folder


def _holding(thing: Attachment, frames: int) -> tuple[Recording, Recording]:
    """The walk with and without a thing; the poses of the first are still those of the second."""
    plain = walking(frames)
    body = carrying(plain.body, [thing]).body
    return replace(plain, body=body, segmentation=segmentation(body)), plain


def _extended(recording: Recording, poses: np.ndarray) -> np.ndarray:
    """Poses of the plain body as poses of the one that carries something, where that is attached."""
    extended = np.zeros((len(poses), recording.body.skeleton.coordinates))
    extended[:, : poses.shape[1]] = poses
    return extended


def _write(folder: Path, recording: Recording, poses: np.ndarray, thing: Attachment, about: str) -> Path:
    recording = replace(recording, poses=poses)
    attached = "\n".join([*attachment_lines((thing,), folder), ""])
    name = folder.resolve().name
    return write_made_scene(folder, recording, recording.truth(), name=name, about=about, foreground=_ALL + attached)


def _case_course(plain: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Where the case's origin is in the world (frame, 3), and its axes (frame, 3, 3) in the columns.

    It hangs upright from the hand, along the way that the body faces. Let go, it falls and tumbles until its middle is
    half as high as it is flat, and lies still.
    """
    poser, body = ExactPoser(plain.body, plain.root_base), plain.body
    world = poser.joint_transforms(plain.poses)
    wrist = body.skeleton.index("RWrist")
    axes = world[:, wrist, :3, :3] @ bind_transforms(body)[wrist, :3, :3].T
    place = world[:, wrist, :3, 3] + applied(axes, np.tile(_PALM, (len(world), 1)))
    ahead = np.arctan2(*(plain.root_base @ (0.0, 0.0, 1.0))[1::-1])
    upright = turn("z", ahead) @ np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turned = np.tile(upright, (len(world), 1, 1))
    gone = int(_LET_GO * len(world))
    velocity = (place[gone] - place[gone - 1]) * plain.fps
    lowest = _HANDLE + _CASE[1] / 2 + _CASE[0] / 2
    for frame in range(gone + 1, len(world)):
        seconds = (frame - gone) / plain.fps
        fallen = place[gone] + seconds * velocity - (0.0, 0.0, _GRAVITY * seconds**2 / 2)
        if fallen[2] < lowest:
            place[frame], turned[frame] = place[frame - 1], turned[frame - 1]
            continue
        x, y, z = seconds * _TUMBLE
        place[frame], turned[frame] = fallen, turn("z", z) @ turn("y", y) @ turn("x", x) @ upright
    return place, turned


def _relative(plain: Recording, place: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (frame, 3) from the root and axes (frame, 3, 3), both in the body's axes as the root turns them."""
    root = ExactPoser(plain.body, plain.root_base).joint_transforms(plain.poses)[:, 0]
    back = transposed(root[:, :3, :3] @ bind_transforms(plain.body)[0, :3, :3].T)
    return applied(back, place - root[:, :3, 3]), back @ axes


def _rod(radius: float, low: float, high: float) -> Mesh:
    """A cylinder along y."""
    rod = _prism(np.array([radius, radius]), high - low)
    vertex = rod.vertex[:, [0, 2, 1]] * (1, 1, -1) + (0.0, (low + high) / 2, 0.0)
    return Mesh(vertex, rod.face)


def _prism(radii: np.ndarray, height: float) -> Mesh:
    """An elliptic disc across z, ``height`` thick."""
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radii
    half = np.full((_SIDES, 1), height / 2)
    middle = [(0.0, 0.0, -height / 2), (0.0, 0.0, height / 2)]
    vertex = np.concatenate([np.hstack([ring, -half]), np.hstack([ring, half]), middle])
    low, after = np.arange(_SIDES), np.roll(np.arange(_SIDES), -1)
    high, high_after = low + _SIDES, after + _SIDES
    below, above = np.full(_SIDES, 2 * _SIDES), np.full(_SIDES, 2 * _SIDES + 1)
    corners = [(low, after, high), (after, high_after, high), (after, low, below), (high, high_after, above)]
    return Mesh(vertex, np.concatenate([np.stack(corner, axis=1) for corner in corners]))
