"""Progress of a tracking run on disk, so that an interrupted one continues and ends with the same bits."""

from __future__ import annotations

import hashlib
import json
import os
import time
import zlib
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.errors import InputError
from mmocap_warp.result.result import FrameAnswer
from mmocap_warp.views.rig import CameraRig

_MAGIC = b"mmocap checkpoint 1\n"
_INTERVAL = 2.0  # seconds between saves, at least
_ANSWER = tuple(field.name for field in fields(FrameAnswer))

FinishedFrame = tuple[FrameAnswer, np.ndarray]
"""A frame's answer, and the counters of the random numbers after it: (run,) int32."""


def fingerprint(subject: Subject, rig: CameraRig, settings: dict) -> str:
    """A hash of all that a run's bits depend on, so that a checkpoint is never continued as another run's."""
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
    body = subject.body
    arrays = (
        body.tracking.rest, body.tracking.face, body.tracking.joint, body.tracking.weight, body.joint_rest,
        body.skeleton.frame, body.skeleton.limits, subject.root_base, subject.pose, rig.K, rig.R, rig.t, rig.size,
    )  # fmt: skip
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


class Checkpoint:
    """A checkpoint file: a header, then a record for each finished frame.

    Frames are appended, so that a save takes as long after a day as after a minute. A record carries a checksum: what
    a crash left half-written at the end is not read, and those frames are tracked again.

    Args:
        path: the file.
        key: the run's :func:`fingerprint`.
        runs: independent runs.
        coordinates: length of a pose.
        cameras: number of cameras.
    """

    def __init__(self, path: Path, key: str, runs: int, coordinates: int, cameras: int) -> None:
        self._path = path
        self._header = _MAGIC + key.encode()
        self._record = _record_type(runs, coordinates, cameras)
        self._saved = 0  # frames in the file
        self._due = time.monotonic() + _INTERVAL

    @property
    def due(self) -> bool:
        """Whether the last save is long enough ago."""
        return time.monotonic() >= self._due

    def save(self, done: Sequence[FinishedFrame]) -> None:
        """Add the frames that were finished since the last save; the first save replaces an earlier run's file.

        Args:
            done: all finished frames, from the recording's first.

        Raises:
            InputError: its folder cannot be written to, or the disk is full.
        """
        new = done[self._saved :]
        if not new:
            return
        try:
            if self._saved:
                with self._path.open("r+b") as file:
                    file.seek(len(self._header) + self._saved * self._record.itemsize)
                    file.write(self._packed(new))
                    file.truncate()
            else:
                temporary = self._path.with_name(self._path.name + ".part")
                temporary.write_bytes(self._header + self._packed(new))
                os.replace(temporary, self._path)
        except OSError as error:
            raise InputError(
                self._path, f"cannot be written ({error})", "check its folder's permissions and free space"
            ) from error
        self._saved = len(done)
        self._due = time.monotonic() + _INTERVAL

    def load(self) -> list[FinishedFrame]:
        """The frames that were saved, from the recording's first; none where there is no file.

        Raises:
            InputError: the file is no checkpoint, or another run's.
        """
        try:
            content = self._path.read_bytes()
        except FileNotFoundError:
            return []
        except OSError as error:
            raise InputError(self._path, f"cannot be read ({error})", "check its permissions") from error
        header = content[: len(self._header)]
        if len(header) < len(self._header) or not header.startswith(_MAGIC):
            raise InputError(self._path, "is damaged, or no checkpoint", "start anew with --force")
        if header != self._header:
            raise InputError(
                self._path,
                "the checkpoint is of a run with another subject, cameras or settings",
                "repeat that run's flags, or start anew with --force",
            )
        done = []
        whole = (len(content) - len(header)) // self._record.itemsize
        for record in np.frombuffer(content, self._record, whole, len(header)):
            if record["checksum"] != _checksum(record):
                break
            answer = FrameAnswer(*(record[name] for name in _ANSWER))
            done.append((answer, record["draw"]))
        self._saved = len(done)
        return done

    def _packed(self, done: Sequence[FinishedFrame]) -> bytes:
        records = np.zeros(len(done), self._record)
        for record, (answer, draw) in zip(records, done, strict=True):
            for name in _ANSWER:
                record[name] = getattr(answer, name)
            record["draw"] = draw
            record["checksum"] = _checksum(record)
        return records.tobytes()


def _record_type(runs: int, coordinates: int, cameras: int) -> np.dtype:
    """A finished frame in the file."""
    return np.dtype(
        [
            ("pose", "<f4", (runs, coordinates)),
            ("cost", "<f4", (runs,)),
            ("iou", "<f8", (runs, cameras)),
            ("evaluations", "<i8"),
            ("status", "<i1"),
            ("seconds", "<f8"),
            ("draw", "<i4", (runs,)),
            ("checksum", "<u4"),  # of all before it
        ]
    )


def _checksum(record: np.void) -> int:
    return zlib.crc32(record.tobytes()[: -np.dtype(np.uint32).itemsize])
