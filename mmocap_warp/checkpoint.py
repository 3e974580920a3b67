"""Progress of a tracking run on disk, so that an interrupted one continues and ends with the same bits."""

from __future__ import annotations

import hashlib
import json
import os
import time
import zipfile
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from mmocap_warp.body import Subject
from mmocap_warp.cameras import CameraRig
from mmocap_warp.errors import InputError

_INTERVAL = 2.0  # seconds between saves, at least
_SHARE = 20.0  # and at least this many times as long as a save takes


@dataclass(frozen=True)
class Progress:
    """Finished frames and what the next one depends on.

    Attributes:
        pose: (frame, run, 51) float32.
        cost: (frame, run) float32.
        iou: (frame, run, camera) float64.
        evaluations: (frame,) int64.
        status: (frame,) int8.
        seconds: (frame,) float64.
        last_pose: (run, 51) float32, where the next frame starts.
        draw: (run,) int32, counters of the random numbers.
    """

    pose: np.ndarray
    cost: np.ndarray
    iou: np.ndarray
    evaluations: np.ndarray
    status: np.ndarray
    seconds: np.ndarray
    last_pose: np.ndarray
    draw: np.ndarray


def fingerprint(subject: Subject, rig: CameraRig, settings: dict) -> str:
    """A hash of all that a run's bits depend on, so that a checkpoint is never continued as another run's."""
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
    body = subject.body
    arrays = (
        body.tracking.rest, body.tracking.face, body.tracking.joint, body.tracking.weight, body.joint_rest,
        body.joint_frame, body.limits, subject.root_base, subject.pose, rig.K, rig.R, rig.t, rig.size,
    )  # fmt: skip
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


class Checkpoint:
    """A checkpoint file, saved now and then.

    Args:
        path: the file; written under a temporary name and renamed.
        key: the run's :func:`fingerprint`.
    """

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._key = path, key
        self._due = time.monotonic() + _INTERVAL

    @property
    def due(self) -> bool:
        """Whether the last save is long enough ago."""
        return time.monotonic() >= self._due

    def save(self, progress: Progress) -> None:
        """Write the progress, whole or not at all.

        Raises:
            InputError: its folder cannot be written to, or the disk is full.
        """
        started = time.monotonic()
        temporary = self._path.with_name(self._path.name + ".part")
        try:
            with temporary.open("wb") as file:
                np.savez(file, key=np.array(self._key), **asdict(progress))
            os.replace(temporary, self._path)
        except OSError as error:
            raise InputError(
                self._path, f"cannot be written ({error})", "check its folder's permissions and free space"
            ) from error
        now = time.monotonic()
        self._due = now + max(_INTERVAL, _SHARE * (now - started))

    def load(self) -> Progress | None:
        """What was saved, or None where nothing was.

        Raises:
            InputError: the file is damaged or belongs to another run.
        """
        if not self._path.exists():
            return None
        try:
            with np.load(self._path, allow_pickle=False) as file:
                key = str(file["key"])
                progress = Progress(**{field.name: file[field.name] for field in fields(Progress)})
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            raise InputError(self._path, "is damaged, or no checkpoint", "start anew with --force") from None
        if key != self._key:
            raise InputError(
                self._path,
                "the checkpoint is of a run with another subject, cameras or settings",
                "repeat that run's flags, or start anew with --force",
            )
        return progress
