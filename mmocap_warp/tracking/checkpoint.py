"""Progress of a tracking run on disk, so that an interrupted one continues and ends with the same bits."""

from __future__ import annotations

import json
import os
import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NoReturn, Self

import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.result.result import FrameAnswer
from mmocap_warp.tracking.run_identity import Identity
from mmocap_warp.tracking.tracker import TrackState

_MAGIC = b"mmocap checkpoint 5\n"
_INTERVAL = 2.0  # seconds between saves, at least
_ANSWER = tuple(field.name for field in fields(FrameAnswer))

_CODE = ("version", "code")
"""What an identity says of the program; the rest is of what the user gave."""


@dataclass(frozen=True, eq=False)
class FinishedFrame:
    """A frame that need not be tracked again.

    Attributes:
        answer: the frame's.
        counter: (run,) int32, the states of the random numbers after it.
    """

    answer: FrameAnswer
    counter: np.ndarray


Memory = Mapping[str, np.ndarray]
"""Arrays by name that the next frame depends on besides; see ``TrackState.memory``."""


class Checkpoint:
    """A checkpoint file: a line that says what it is, a line with the run's identity, then a record per finished frame.

    Frames are appended, so that a save takes as long after a day as after a minute. A record carries a checksum: what
    a crash left half-written at the end is not read, and those frames are tracked again.

    A tracker's memory, such as a filter's particles, may be large, and only the last frame's is needed. So there are
    two places for it, before the frames, and saves take turns: one of the two is always whole.

    Args:
        path: the file.
        identity: the run's, see :func:`~mmocap_warp.tracking.run_identity.run_identity`.
        runs: independent runs.
        coordinates: length of a pose.
        cameras: number of cameras.
        memory: arrays of the names, types and shapes that are saved with the last frame.
    """

    def __init__(
        self, path: Path, identity: Identity, runs: int, coordinates: int, cameras: int, memory: Memory | None = None
    ) -> None:
        self._path = path
        self._identity = identity
        self._header = _header(identity)
        self._record = _record_type(runs, coordinates, cameras)
        self._memory_record = _memory_type(memory or {})
        self._memories = 2 if memory else 0
        self._turn = 0  # number of the place that the next save writes
        self._first = len(self._header) + self._memories * self._memory_record.itemsize  # byte of the first frame
        self._saved = 0  # frames in the file
        self._due = time.monotonic() + _INTERVAL

    @property
    def due(self) -> bool:
        """Whether the last save is long enough ago."""
        return time.monotonic() >= self._due

    def save(self, done: Sequence[FinishedFrame], memory: Memory | None = None) -> None:
        """Add the frames that were finished since the last save; the first save replaces an earlier run's file.

        Args:
            done: all finished frames, from the recording's first.
            memory: after the last of them.

        Raises:
            InputError: its folder cannot be written to, or the disk is full.
        """
        new = done[self._saved :]
        if not new:
            return
        try:
            if self._saved:
                with self._path.open("r+b") as file:
                    file.seek(self._first + self._saved * self._record.itemsize)
                    file.write(self._packed(new))
                    file.truncate()
                    if self._memories:
                        file.seek(len(self._header) + self._turn * self._memory_record.itemsize)
                        file.write(self._packed_memory(len(done), memory or {}))
            else:
                temporary = self._path.with_name(self._path.name + ".part")
                places = self._packed_memory(len(done), memory or {}) * self._memories
                temporary.write_bytes(self._header + places + self._packed(new))
                os.replace(temporary, self._path)
        except OSError as error:
            raise InputError(
                self._path, f"cannot be written ({error})", "check its folder's permissions and free space"
            ) from error
        self._turn = 1 - self._turn
        self._saved = len(done)
        self._due = time.monotonic() + _INTERVAL

    def load(self) -> tuple[list[FinishedFrame], Memory]:
        """The frames that were saved, from the recording's first, and the memory after them; none without a file.

        Raises:
            InputError: the file is no checkpoint, or another run's.
        """
        content = _read(self._path, self._identity)
        if content is None:
            return [], {}
        done = []
        whole = max(0, len(content) - self._first) // self._record.itemsize
        for record in np.frombuffer(content[self._first :], self._record, whole):
            if record["checksum"] != _checksum(record):
                break
            done.append(FinishedFrame(FrameAnswer(*(record[name] for name in _ANSWER)), record["counter"]))
        memory: Memory = {}
        if self._memories:
            frames, memory = self._latest_memory(content, len(done))
            done = done[:frames]
        self._saved = len(done)
        return done, memory

    def _latest_memory(self, content: bytes, done: int) -> tuple[int, Memory]:
        """The latest memory among the frames that are done, and after how many it was; the next save spares it."""
        frames = 0
        memory: Memory = {}
        places = self._memories if done else 0
        for place, record in enumerate(np.frombuffer(content, self._memory_record, places, len(self._header))):
            if record["checksum"] == _checksum(record) and frames < record["frames"] <= done:
                frames, saved = int(record["frames"]), record["memory"]
                memory = {name: saved[name] for name in saved.dtype.names}
                self._turn = 1 - place
        return frames, memory

    def _packed(self, done: Sequence[FinishedFrame]) -> bytes:
        records = np.zeros(len(done), self._record)
        for record, frame in zip(records, done, strict=True):
            for name in _ANSWER:
                record[name] = getattr(frame.answer, name)
            record["counter"] = frame.counter
            record["checksum"] = _checksum(record)
        return records.tobytes()

    def _packed_memory(self, frames: int, memory: Memory) -> bytes:
        record = np.zeros(1, self._memory_record)[0]
        record["frames"] = frames
        for name, array in memory.items():
            record["memory"][name] = array
        record["checksum"] = _checksum(record)
        packed: bytes = record.tobytes()
        return packed


class SavedRun:
    """A run whose finished frames are saved: every few seconds, and when the ``with`` of it ends, however it ends.

    Args:
        checkpoint: the file.
        state: a tracker's, before its first frame.
    """

    def __init__(self, checkpoint: Checkpoint, state: TrackState) -> None:
        self._checkpoint, self._state = checkpoint, state
        self._done: list[FinishedFrame] = []
        # How many frames are done, and the memory after them: set at once, so that an interruption between two lines
        # finds both or neither.
        self._whole: tuple[int, Memory] = (0, state.memory)

    def resumed(self) -> tuple[list[FrameAnswer], TrackState]:
        """The answers that were saved, from the first frame on, and the tracker's state after them."""
        self._done, memory = self._checkpoint.load()
        if self._done:
            self._whole = len(self._done), memory
            last = self._done[-1]
            self._state = self._state.restored(last.answer.pose, last.counter, memory)
        return [frame.answer for frame in self._done], self._state

    def add(self, answer: FrameAnswer, state: TrackState) -> None:
        """Take the next frame's answer, and the tracker's state after it."""
        self._done.append(FinishedFrame(answer, state.counter))
        self._whole = len(self._done), state.memory

    def save_if_due(self) -> None:
        """Save if that is long enough ago."""
        if self._checkpoint.due:
            self._save()

    def _save(self) -> None:
        frames, memory = self._whole
        self._checkpoint.save(self._done[:frames], memory)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._save()


def check_same_run(path: Path, identity: Identity) -> None:
    """See that a checkpoint, where there is one, is of this run, before anything is built for it.

    Raises:
        InputError: the file is no checkpoint, or another run's.
    """
    _read(path, identity)


def with_code_of(path: Path, identity: Identity) -> Identity:
    """A run's identity as if it was of the version and the code that a checkpoint, where there is one, was begun with.

    Raises:
        InputError: the file cannot be read.
    """
    theirs = _identity_in(_content(path) or b"") or {}
    return identity | {name: theirs[name] for name in _CODE if name in theirs}


def _header(identity: Identity) -> bytes:
    return _MAGIC + json.dumps(identity).encode() + b"\n"


def _content(path: Path) -> bytes | None:
    """What is in a file; None where there is none."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(path, f"cannot be read ({error})", "check its permissions") from error


def _read(path: Path, identity: Identity) -> bytes | None:
    """The content of a run's checkpoint; None where there is no file."""
    content = _content(path)
    if content is not None and not content.startswith(_header(identity)):
        _refuse(path, identity, _identity_in(content))
    return content


def _identity_in(content: bytes) -> Identity | None:
    """The identity in a checkpoint's header; None where the file is damaged or no checkpoint."""
    magic, line = content[: len(_MAGIC)], content[len(_MAGIC) :].partition(b"\n")[0]
    try:
        identity = json.loads(line) if magic == _MAGIC else None
    except (ValueError, RecursionError):
        return None
    return identity if isinstance(identity, dict) else None


def _refuse(path: Path, identity: Identity, theirs: Identity | None) -> NoReturn:
    """Say what is wrong with a file of another header."""
    if theirs is None:
        raise InputError(path, "is damaged, or no checkpoint", "start anew with --force")
    mine = json.loads(json.dumps(identity))
    differing = [name for name in mine | theirs if mine.get(name) != theirs.get(name)]
    if set(differing) <= set(_CODE):
        begun, here = (f"{each.get('version')} (code {str(each.get('code'))[:8]})" for each in (theirs, mine))
        raise InputError(
            path,
            f"the run was begun by mmocap-warp {begun}, this is {here}, whose results may differ",
            "go back to that version, go on with --accept-changed-code, or start anew with --force",
        )
    raise InputError(
        path,
        f"the checkpoint is of a run that differs in its {', '.join(differing)}",
        "repeat that run's flags and files, or start anew with --force",
    )


def _memory_type(memory: Memory) -> np.dtype:
    """A place for a memory in the file."""
    arrays = [(name, array.dtype.newbyteorder("<"), array.shape) for name, array in memory.items()]
    return np.dtype([("frames", "<i8"), ("memory", arrays), ("checksum", "<u4")])


def _record_type(runs: int, coordinates: int, cameras: int) -> np.dtype:
    """A finished frame in the file."""
    return np.dtype(
        [
            ("pose", "<f4", (runs, coordinates)),
            ("cost", "<f4", (runs,)),
            ("iou", "<f8", (runs, cameras)),
            ("evaluations", "<i8"),
            ("status", "<i1", (runs,)),
            ("seconds", "<f8"),
            ("counter", "<i4", (runs,)),
            ("checksum", "<u4"),  # of all before it
        ]
    )


def _checksum(record: np.void) -> int:
    return zlib.crc32(record.tobytes()[: -np.dtype(np.uint32).itemsize])
