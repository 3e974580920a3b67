"""A motion clip, which is a skeleton of any make that moves, and Biovision's ``.bvh`` read as one."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from mmocap_warp.body.rotations import applied, nearest_rotation, turn
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.whole_file import read_text


@dataclass(frozen=True)
class MotionClip:
    """A skeleton in motion, in its file's own axes and unit of length."""

    fps: float  # frames per second
    joint_names: tuple[str, ...]  # one per joint, as in the file; a joint stands where its bone begins
    rest: np.ndarray  # (joint, 3), places in the rest pose
    place: np.ndarray  # (frame, joint, 3)
    rotation: np.ndarray  # (frame, joint, 3, 3), of each bone in the world, the identity in the rest pose

    def at_rate(self, fps: float) -> Self:
        """The clip resampled: places linearly, rotations by the rotation nearest to the mean of their neighbours'."""
        last = len(self.place) - 1
        when = np.arange(int(last * fps / self.fps) + 1) * self.fps / fps
        before = np.minimum(when.astype(int), max(last - 1, 0))
        after, share = np.minimum(before + 1, last), (when - before)[:, None, None]
        place = (1 - share) * self.place[before] + share * self.place[after]
        share = share[..., None]
        mixed = (1 - share) * self.rotation[before] + share * self.rotation[after]
        return replace(self, fps=fps, place=place, rotation=nearest_rotation(mixed))


_REMEDY = "export it again as BVH"
_MIN_INTERVAL, _MAX_INTERVAL = 1e-4, 10.0  # that a frame may last [s]


class _Joint(NamedTuple):
    name: str
    parent: int
    offset: tuple[float, float, float]
    channels: tuple[str, ...]
    first_column: int


class _Words:
    """The words of a file, one after the other."""

    def __init__(self, path: Path, text: str) -> None:
        self.path, self._line = path, 0  # the line is that of the word that was taken last
        self._left = ((word, line) for line, row in enumerate(text.splitlines(), 1) for word in row.split())

    def take(self, *expected: str) -> str:
        """The next word; one of ``expected``, in any case of letters, where some are given."""
        word, self._line = next(self._left, ("", 0))
        if not word:
            raise InputError(self.path, f"ends before {' or '.join(expected) or 'the next value'}", _REMEDY)
        if expected and word.lower() not in (e.lower() for e in expected):
            raise self._error(f"expected {' or '.join(expected)}, found '{word}'")
        return word

    def expect(self, *words: str) -> None:
        """Take words that must come next, one after the other."""
        for word in words:
            self.take(word)

    def _error(self, problem: str) -> InputError:
        """The error of the word that was taken last."""
        return InputError(f"{self.path}: line {self._line}", problem, _REMEDY)

    def number(self) -> float:
        """The next word as a number."""
        word = self.take()
        try:
            return float(word)
        except ValueError:
            raise self._error(f"'{word}' is not a number") from None

    def count(self, what: str, most: int) -> int:
        """The next word as a whole number from 0 to ``most``; ``what`` it counts is named in errors."""
        number = self.number()
        if not (0 <= number <= most and number == int(number)):
            raise self._error(f"{number:g} is not a valid number of {what}")
        return int(number)

    def rest(self) -> list[str]:
        """All words that are left."""
        return [word for word, _ in self._left]


def read_bvh(path: str | Path) -> MotionClip:
    """Read a ``.bvh`` file; the rest pose is the one of its offsets."""
    path = Path(path)
    words = _Words(path, read_text(path, "check its name", errors="replace"))
    joints = _read_hierarchy(words)
    words.expect("MOTION", "Frames:")
    frames = words.count("frames", 10**9)
    words.expect("Frame", "Time:")
    interval = words.number()
    columns = joints[-1].first_column + len(joints[-1].channels)
    with input_errors(path, "holds a frame that is not numbers ({error})", _REMEDY, ValueError):
        values = np.array(words.rest(), float)
    sound = frames >= 1 and _MIN_INTERVAL <= interval <= _MAX_INTERVAL and len(values) == frames * columns
    if not sound or not np.isfinite(values).all():
        problem = f"says {frames} frames of {columns} values every {interval:g} s, and holds {len(values)} values"
        raise InputError(path, problem, _REMEDY)
    return _pose_joints(joints, values.reshape(frames, columns), 1.0 / interval)


def _read_hierarchy(words: _Words) -> list[_Joint]:
    words.expect("HIERARCHY", "ROOT")
    joints: list[_Joint] = []
    open_joints = [_read_joint(words, -1, joints)]
    while open_joints:
        word = words.take("JOINT", "End", "}").lower()
        if word == "joint":
            open_joints.append(_read_joint(words, open_joints[-1], joints))
        elif word == "end":
            words.expect("Site", "{", "OFFSET")
            for _ in range(3):
                words.number()
            words.expect("}")
        else:
            open_joints.pop()
    return joints


def _read_joint(words: _Words, parent: int, joints: list[_Joint]) -> int:
    """Add a joint, from its name to its channels; returns its number."""
    name = words.take()
    words.expect("{", "OFFSET")
    offset = (words.number(), words.number(), words.number())
    words.expect("CHANNELS")
    count = words.count("channels", 6)
    allowed = [f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ"]
    channels = tuple(words.take(*allowed).lower() for _ in range(count))
    column = joints[-1].first_column + len(joints[-1].channels) if joints else 0
    joints.append(_Joint(name, parent, offset, channels, column))
    return len(joints) - 1


def _pose_joints(joints: list[_Joint], values: np.ndarray, fps: float) -> MotionClip:
    rest = np.array([joint.offset for joint in joints])
    place = np.tile(rest, (len(values), 1, 1))
    rotation = np.tile(np.eye(3), (len(values), len(joints), 1, 1))
    for j, joint in enumerate(joints):
        for column, channel in enumerate(joint.channels, joint.first_column):
            if channel.endswith("position"):
                place[:, j, "xyz".index(channel[0])] = values[:, column]  # in place of the offset
            else:
                rotation[:, j] = rotation[:, j] @ turn(channel[0], np.radians(values[:, column]))
        if joint.parent >= 0:  # which comes first, and is in the world by now
            rest[j] += rest[joint.parent]
            place[:, j] = place[:, joint.parent] + applied(rotation[:, joint.parent], place[:, j])
            rotation[:, j] = rotation[:, joint.parent] @ rotation[:, j]
    return MotionClip(fps, tuple(joint.name for joint in joints), rest, place, rotation)
