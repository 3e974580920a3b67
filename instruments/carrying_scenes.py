"""Make a scene of somebody who carries something: ``python instruments/carrying_scenes.py FOLDER NAME``.

NAME is ``walker-with-racket``, ``walker-with-case``, ``boxer`` or ``boxer-with-racket``: the walker of the built-in
scene, or somebody who boxes, with a racket in the right hand, or with a case that is let go.

The things are made here and written beside the masks as ``.obj`` files, as people have them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from made_boxing import ROUNDS, boxing
from walk_scene import FOREGROUND, FPS, camera_ring, segmentation, walker, walking

from mmocap_warp.body.model import bind_transforms
from mmocap_warp.body.rotations import applied, transposed, turn, zyx_angles
from mmocap_warp.body.shape_space import heading_rotation, upright_base
from mmocap_warp.errors import InputError
from mmocap_warp.formats.attachments import ALL, FIXED, Attachment, attachment_lines
from mmocap_warp.rigging.attaching import carrying
from mmocap_warp.synthesis.exact_posing import ExactPoser
from mmocap_warp.synthesis.footage.made_recording import Recording
from mmocap_warp.synthesis.writing import write_made_scene
from mmocap_warp.whole_file import write_whole

_BOXERS_HEADING = 1.9  # [rad]
_BOXED = slice(40, 104)  # frames of a round
_SIDES = 24  # of what is round
_PALM = (-0.03, -0.07, 0.075)  # from the right wrist's centre, in the bind pose [m]

_CASE = (0.10, 0.32, 0.44)  # across, high and long [m]
_HANDLE = 0.04  # over the case [m]
_LET_GO = 0.45  # of the recording
_TUMBLE = np.array([0.9, 0.5, -1.6])  # turning about the world's axes while it falls [rad/s]
_GRAVITY = 9.81  # [m/s^2]
# In a mask, a racket's head may lie apart from the hand.
_FOREGROUND = FOREGROUND.replace('keep = "largest"', 'keep = "all"')


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


def write_carried(folder: Path, name: str) -> Path:
    """Write one of ``CARRIED`` as a scene, with the mesh of what is carried; the path of ``scene.toml``.

    Raises:
        InputError: a folder that cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, f"cannot be written to ({error})", "choose another folder") from error
    recording, things = CARRIED[name](folder)
    return write_made_scene(
        folder,
        recording,
        recording.truth(),
        name=folder.resolve().name,
        about=f"A {name.replace('-', ' ')}, made up with known truth.",
        foreground=_FOREGROUND + "\n".join([*attachment_lines(things, folder), ""]),
    )


_Made = tuple[Recording, tuple[Attachment, ...]]


def _boxer(folder: Path) -> _Made:
    """A second of shadow boxing: a cross with the right hand, a step, and a jab."""
    body, base = walker(), upright_base("+z") @ heading_rotation(_BOXERS_HEADING)
    poses = boxing(body, _BOXED.stop, FPS, ROUNDS["S1"], seed=13)[_BOXED]
    poses[:, :3] = poses[:, :3] @ base.T
    return Recording(body, base, poses, FPS, camera_ring(), segmentation(body)), ()


def _with_racket(plain: Recording, folder: Path) -> _Made:
    """Fixed to the right wrist."""
    mesh = racket().written(folder / "racket.obj")
    thing = Attachment("Racket", mesh, "RWrist", _PALM, (75.0, 0.0, 90.0), free=FIXED)
    return _carried(plain, thing), (thing,)


def _with_case(plain: Recording, folder: Path) -> _Made:
    """Carried in the right hand and let go; it falls to the floor and stays there."""
    mesh = case().written(folder / "case.obj")
    shift, turned = _relative(plain, *_case_course(plain))
    thing = Attachment("Case", mesh, position=tuple(np.round(shift[0], 2).tolist()), free=ALL)
    recording = _carried(plain, thing)
    recording.poses[:, -6:-3], recording.poses[:, -3:] = shift - thing.position, zyx_angles(turned)
    return recording, (thing,)


CARRIED: dict[str, Callable[[Path], _Made]] = {
    "walker-with-racket": lambda folder: _with_racket(walking(), folder),
    "walker-with-case": lambda folder: _with_case(walking(), folder),
    "boxer": _boxer,
    "boxer-with-racket": lambda folder: _with_racket(_boxer(folder)[0], folder),
}
"""By name, what makes a recording and what is carried in it, whose meshes it writes to a folder."""


def _carried(plain: Recording, thing: Attachment) -> Recording:
    """The recording with a thing where it is attached."""
    body = carrying(plain.body, [thing])[0]
    poses = np.zeros((len(plain), body.skeleton.coordinates))
    poses[:, : plain.poses.shape[1]] = plain.poses
    return replace(plain, body=body, poses=poses, segmentation=segmentation(body))


def _case_course(plain: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Where the case's origin is in the world (frame, 3), and its axes (frame, 3, 3) in the columns.

    It hangs upright from the hand, along the way that the body faces. Let go, it falls and tumbles until a corner
    reaches the floor, and stays as it is.
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
    corner = case().vertex
    for frame in range(gone + 1, len(world)):
        seconds = (frame - gone) / plain.fps
        fallen = place[gone] + seconds * velocity - (0.0, 0.0, _GRAVITY * seconds**2 / 2)
        x, y, z = seconds * _TUMBLE
        tumbled = turn("z", z) @ turn("y", y) @ turn("x", x) @ upright
        landed = fallen[2] + (corner @ tumbled.T)[:, 2].min() < 0
        place[frame], turned[frame] = (place[frame - 1], turned[frame - 1]) if landed else (fallen, tumbled)
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


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[2] not in CARRIED:
        raise SystemExit(f"usage: python instruments/carrying_scenes.py FOLDER {'|'.join(CARRIED)}")
    try:
        print(f"wrote {write_carried(Path(sys.argv[1]), sys.argv[2])}")
    except InputError as error:
        print(error, file=sys.stderr)
        raise SystemExit(3) from None
