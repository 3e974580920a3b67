"""Progress of a tracking run on disk, so that an interrupted one continues and ends with the same bits.

A checkpoint says all that the run's bits depend on, so that it is never continued as another run's; the error says why.
"""

import hashlib
import json
import os
import sys
import time
import zlib
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.code_hash import code_hash
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.result.result import FrameAnswer
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import TrackState
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import content_hash, read_bytes, write_whole

Identity = dict[str, Any]  # what a run depends on, by names for people: hashes, and settings as JSON-compatible values
Memory = Mapping[str, np.ndarray]  # arrays by name that the next frame depends on besides; see ``TrackState.memory``

_MAGIC = b"mmocap checkpoint 5\n"
_INTERVAL = 2.0  # seconds between saves, at least
_ANSWER = tuple(field.name for field in fields(FrameAnswer))
_CODE = ("version", "code")  # what an identity says of the program; the rest is of what the user gave


def run_identity(scene: Scene, subject: Subject, config: TrackConfig) -> Identity:
    """What identifies a run of a scene. Files count by their content, wherever they lie and whenever they were touched.

    Raises:
        InputError: an image or a video that cannot be read.
    """
    rotation, translation = config.radii(scene.rate)
    dof, device = len(subject.body.skeleton.searched(config.dof)), resolve_device(config.device)
    effective = {"dof": dof, "device": device, "rotation_radius": rotation, "translation_radius": translation}
    settings = asdict(config) | effective
    # Any of these give the same bits; cameras count as they are tracked with.
    del settings["threads"], settings["renderer"], settings["cameras"]
    placed = [(camera.recorded_scale, camera.recorded_offset, camera.mask_mark) for camera in scene.cameras]
    labels = [(camera.label, camera.in_front) for camera in scene.cameras]
    # What masks are made of, in order, and what is subtracted from it.
    sources = [camera.files_for(scene.foreground.source) for camera in scene.cameras]
    images = [[[_hashed(file, _changed_at(file)) for file in files] for files in source] for source in sources]
    labelled = {"labels": _digest(labels)} if any(label or others for label, others in labels) else {}
    return {
        "version": __version__,
        "code": code_hash("tracking.frame_loop"),
        "images": _digest(images),
        "frames": [scene.first_frame, scene.frame_count, scene.stride],
        "frame offsets": [[camera.frame_offset, camera.rate, camera.fraction] for camera in scene.cameras],
        "fps": scene.fps,
        "cameras": _digest([scene.calibrated, placed]),
        "body": _digest(subject.body),
        "first pose": _digest([subject.root_base, subject.pose]),
        **settings,
        **labelled,
        **{f"foreground.{name}": value for name, value in asdict(scene.foreground).items()},
    }


def asked_for(scene: Scene, subject: Subject, config: TrackConfig, more: list[Any]) -> str:
    """A hash of all that a run is asked for, by whatever version of the program, and wherever it is done."""
    identity = run_identity(scene, subject, config) | ({"more": repr(more)} if more else {})
    return _digest({name: value for name, value in identity.items() if name not in (*_CODE, "device")})


def _changed_at(file: Path) -> tuple[int, ...]:
    """When a file was changed; the second of the times cannot be set to another one."""
    return (os.stat(file).st_mtime_ns, os.stat(file).st_ctime_ns) if os.path.exists(file) else ()


@lru_cache(100_000)
def _hashed(file: Path, changed_at: tuple[int, ...]) -> bytes:
    """The hash of a file as it has been since it was changed; it is read once."""
    return content_hash(file)


def _digest(thing: object) -> str:
    """A hash of arrays, numbers and strings, in sequences, dictionaries and dataclasses of any depth."""
    digest, unread = hashlib.sha256(), [thing]
    while unread:
        thing = unread.pop()
        if isinstance(thing, np.ndarray):
            digest.update(f"{thing.dtype} {thing.shape}".encode())
            digest.update(thing.tobytes())
        elif is_dataclass(thing):
            unread += [getattr(thing, field.name) for field in fields(thing)]
        elif isinstance(thing, dict):
            unread.append(list(thing.items()))
        elif isinstance(thing, list | tuple):
            digest.update(f"{len(thing)} in turn".encode())
            unread += thing
        else:
            digest.update(repr(thing).encode())
    return digest.hexdigest()


class Checkpoint:
    """A checkpoint file: a line that says what it is, a line with the run's identity, then a record per finished frame.

    Frames are appended, so that a save takes as long after a day as after a minute. A record carries a checksum: what a
    crash left half-written at the end is not read, and those frames are tracked again.

    A tracker's memory, such as a filter's particles, may be large, and only the last frame's is needed. So there are
    two places for it, before the frames, and saves take turns: one of the two is always whole.

    Frames are saved every few seconds, and when the ``with`` of a checkpoint ends, however it ends. Those of a second
    start follow those of the first.
    """

    def __init__(self, path: Path, identity: Identity, state: TrackState, cameras: int) -> None:
        self._path, self._identity = path, identity
        self._state, self._header = state, _header(identity)
        memory = [(name, array.dtype.newbyteorder("<"), array.shape) for name, array in state.memory.items()]
        self._memory_record = np.dtype([("frames", "<i8"), ("memory", memory), ("checksum", "<u4")])
        self._record = _record_type(state.pose, cameras)
        self._memories = 2 if state.memory else 0
        self._turn = 0  # number of the place that the next save writes
        self._first = len(self._header) + self._memories * self._memory_record.itemsize  # byte of the first frame
        self._records: list[bytes] = []  # of all finished frames
        # How many frames are finished, and the memory after them: set at once, so that an interruption between two
        # lines finds both or neither.
        self._finished: tuple[int, Memory] = (0, state.memory)
        self._saved = 0  # frames in the file
        self._due = time.monotonic() + _INTERVAL

    def resumed(self) -> tuple[list[FrameAnswer], TrackState]:
        """The answers that were saved, and the state after them; an InputError for no checkpoint, or another run's."""
        content = read_checkpoint(self._path, self._identity) or b""
        # Frames count up to the first that a crash spoilt, and up to the last whose memory is whole.
        frames = max(0, len(content) - self._first) // self._record.itemsize
        records = np.frombuffer(content[self._first :], self._record, frames)
        frames = next((i for i, record in enumerate(records) if record["checksum"] != _checksum(record)), frames)
        memory: Memory = {}
        if self._memories and frames:
            frames, memory = self._latest_memory(content, frames)
        if not frames:
            return [], self._state
        records = records[:frames]
        self._records = [record.tobytes() for record in records]
        self._finished = frames, memory
        self._saved = frames
        answers = [FrameAnswer(*(record[name] for name in _ANSWER)) for record in records]
        return answers, self._state.restored(answers[-1].pose, records[-1]["counter"], memory)

    def _latest_memory(self, content: bytes, done: int) -> tuple[int, Memory]:
        """The latest memory among the frames that are done, and after how many it was; the next save spares it."""
        frames = 0
        memory: Memory = {}
        for place, record in enumerate(np.frombuffer(content, self._memory_record, self._memories, len(self._header))):
            if record["checksum"] == _checksum(record) and frames < record["frames"] <= done:
                frames, saved = int(record["frames"]), record["memory"]
                memory = {name: saved[name] for name in saved.dtype.names}
                self._turn = 1 - place
        return frames, memory

    def add(self, answer: FrameAnswer, state: TrackState) -> None:
        """Take the next frame's answer, and the tracker's state after it."""
        values = {name: getattr(answer, name) for name in _ANSWER} | {"counter": state.counter}
        self._records.append(_packed(self._record, values))
        self._finished = len(self._records), state.memory

    def save_if_due(self) -> None:
        """Save if the last save is long enough ago."""
        if time.monotonic() >= self._due:
            self.save()

    def save(self) -> None:
        """Add the frames that were finished since the last save; the first save replaces an earlier run's file.

        Raises:
            InputError: its folder cannot be written to, or the disk is full.
        """
        frames, memory = self._finished
        new = b"".join(self._records[self._saved : frames])
        if not new:
            return
        record = {"frames": frames, "memory": tuple(memory.values())}
        place = _packed(self._memory_record, record) if self._memories else b""
        problem, remedy = "cannot be written ({error})", "check its folder's permissions and free space"
        with input_errors(self._path, problem, remedy, OSError):
            if self._saved:
                with self._path.open("r+b") as file:
                    file.seek(self._first + self._saved * self._record.itemsize)
                    file.write(new)
                    file.truncate()
                    file.seek(len(self._header) + self._turn * len(place))
                    file.write(place)
            else:
                write_whole(self._path, self._header + place * self._memories + new)
        self._turn, self._saved = 1 - self._turn, frames
        self._due = time.monotonic() + _INTERVAL

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.save()


def with_code_of(path: Path, identity: Identity) -> Identity:
    """A run's identity as if it was of the version and the code that a checkpoint, where there is one, was begun with.

    Raises:
        InputError: the file cannot be read.
    """
    theirs = _identity_in(_content(path) or b"") or {}
    return identity | {name: theirs[name] for name in _CODE if name in theirs}


def read_checkpoint(path: Path, identity: Identity) -> bytes | None:
    """The content of a run's checkpoint, None without a file; an InputError if it is none, or another run's."""
    content = _content(path)
    if content is None or content.startswith(_header(identity)):
        return content
    if (theirs := _identity_in(content)) is None:
        raise InputError(path, "is damaged, or no checkpoint", "start anew with --force")
    mine = json.loads(json.dumps(identity))
    differing = [name for name in mine | theirs if mine.get(name) != theirs.get(name)]
    if set(differing) <= set(_CODE):
        begun, here = (f"{each.get('version')} (code {str(each.get('code'))[:8]})" for each in (theirs, mine))
        problem = f"the run was begun by mmocap-warp {begun}, this is {here}, whose results may differ"
        remedy = "go back to that version, go on with --accept-changed-code, or start anew with --force"
        raise InputError(path, problem, remedy)
    problem = f"the checkpoint is of a run that differs in its {', '.join(differing)}"
    raise InputError(path, problem, "repeat that run's flags and files, or start anew with --force")


def _header(identity: Identity) -> bytes:
    return _MAGIC + json.dumps(identity).encode() + b"\n"


def _content(path: Path) -> bytes | None:
    """What is in a file; None where there is none."""
    return read_bytes(path, "check its permissions", most=sys.maxsize) if path.exists() else None


def _identity_in(content: bytes) -> Identity | None:
    """The identity in a checkpoint's header; None where the file is damaged or no checkpoint."""
    magic, line = content[: len(_MAGIC)], content[len(_MAGIC) :].partition(b"\n")[0]
    try:
        identity = json.loads(line) if magic == _MAGIC else None
    except (ValueError, RecursionError):
        return None
    return identity if isinstance(identity, dict) else None


def _record_type(pose: np.ndarray, cameras: int) -> np.dtype:
    """A finished frame in the file, of a run's poses (run, coordinate)."""
    runs = len(pose)
    return np.dtype(
        [
            ("pose", "<f4", pose.shape),
            ("cost", "<f4", (runs,)),
            ("iou", "<f8", (runs, cameras)),
            ("evaluations", "<i8"),
            ("status", "<i1", (runs,)),
            ("seconds", "<f8"),
            ("counter", "<i4", (runs,)),
            ("checksum", "<u4"),  # of all before it
        ]
    )


def _checksum(record: np.void | np.ndarray) -> int:
    return zlib.crc32(record.tobytes()[: -np.dtype(np.uint32).itemsize])


def _packed(kind: np.dtype, values: Mapping[str, Any]) -> bytes:
    """A record with its checksum."""
    record = np.zeros(1, kind)
    for name, value in values.items():
        record[name] = value
    record["checksum"] = _checksum(record)
    return record.tobytes()
