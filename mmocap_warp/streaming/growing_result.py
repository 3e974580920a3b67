"""A result that is written as it grows, so that a process that is killed loses no frame whose answer is final.

Frames are appended to a file beside it, and moved into it in the end; after a kill, before the next session.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import input_errors
from mmocap_warp.formats.usd.usd_result import read_result, write_result
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.streaming.senders import Packet
from mmocap_warp.tracking.frame_loop import collect
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import lost_frame

_KINDS = {"pose": "<f8", "raw_pose": "<f8", "iou": "<f8", "status": "<i1"}  # of a frame in the file

Whose = dict[str, Any]  # entries of a result's config that name its scene and person


class GrowingResult:
    """Keeps the smoothed frames, as a sender does; when it is closed, the result is whole.

    They are the recording's ``frames``, whose rate is ``fps``; ``whose`` names scene and person, as far as known.
    """

    def __init__(
        self, path: Path, subject: Subject, rig: CameraRig, fps: float, config: TrackConfig, frames: range, whose: Whose
    ) -> None:
        start, self._frames = lost_frame(subject.pose[None], len(rig)), frames
        begun = collect(subject, rig, fps, config, [start], frames[:1])  # all that is known before a frame comes
        write_result(_begun(path), begun := replace(begun, raw_pose=begun.pose, config=begun.config | whose))
        self._path, self._kind = path, _record(begun)
        self._file = path.with_name(f"{path.name}.frames").open("wb", buffering=0)

    def send(self, packet: Packet) -> None:
        """Append a smoothed frame; an InputError if there is no room."""
        if packet.smooth:
            frame = packet.answer
            status = [STATUS.index(each) for each in frame.status]
            number = self._frames.start + self._frames.step * frame.number
            record = np.array((number, frame.pose, frame.raw_pose, frame.iou, status), self._kind)
            with input_errors(self._path, "cannot grow ({error})", "make room", OSError):
                self._file.write(record.tobytes())

    def close(self) -> None:
        """Make the result whole."""
        self._file.close()
        finish(self._path)


def finish(path: Path) -> bool:
    """Make a growing result whole, and say whether there was one with frames; without any an older result stays."""
    if not (beside := path.with_name(f"{path.name}.frames")).exists():
        return False
    begun, data = read_result(_begun(path)), beside.read_bytes()
    kind = _record(begun)
    records = np.frombuffer(data, kind, len(data) // kind.itemsize)  # without what was half-written at a kill
    if count := len(records):
        arrays: dict[str, Any] = {name: np.moveaxis(records[name], 0, 1).copy() for name in _KINDS}
        arrays |= {name: np.repeat(getattr(begun, name), count, axis=1) for name in ("cost", "evaluations")}
        write_result(path, replace(begun, frame_numbers=records["frame_numbers"], **arrays))
    beside.unlink()
    _begun(path).unlink()
    return count > 0


def _begun(path: Path) -> Path:
    """Where all is kept meanwhile that is known before a frame comes."""
    return path.with_name(f"{path.stem}.begun{path.suffix}")


def _record(result: Result) -> np.dtype:
    """A frame in the file, of all runs."""
    shapes = [(name, kind, (len(result.pose), *getattr(result, name).shape[2:])) for name, kind in _KINDS.items()]
    return np.dtype([("frame_numbers", "<i8"), *shapes])
