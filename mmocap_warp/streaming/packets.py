"""What is told of a frame: its number and time, and where the body's joints are and how they turn."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from mmocap_warp.body.model import Subject, joint_transforms
from mmocap_warp.body.rotations import transposed
from mmocap_warp.tracking.live import LiveFrame


@dataclass(frozen=True, eq=False)
class Packet:
    """An answer to a frame, of the first run.

    Attributes:
        frame: its number.
        time: when it was seen, in seconds since 1970.
        smooth: whether frames after it had a say.
        status: a name of ``STATUS``.
        names: of the joints.
        place: (joint, 3) in the world [m].
        turn: (joint, 3, 3) from the body's bind pose, in the world.
        iou: (camera,) NaN for a lost view.
        dropped: frames that were dropped so far.
    """

    frame: int
    time: float
    smooth: bool
    status: str
    names: tuple[str, ...]
    place: np.ndarray
    turn: np.ndarray
    iou: np.ndarray
    dropped: int

    @cached_property
    def quaternion(self) -> np.ndarray:
        """(joint, 4) x, y, z, w of ``turn``."""
        from scipy.spatial.transform import Rotation

        quaternion: np.ndarray = Rotation.from_matrix(self.turn).as_quat()
        return quaternion

    @cached_property
    def json(self) -> bytes:
        """As ZMQ and WebSocket send it."""
        plain = {name: getattr(self, name) for name in ("frame", "time", "smooth", "status", "names", "dropped")}
        arrays = {"place": self.place.round(5).tolist(), "turn": self.quaternion.round(6).tolist()}
        iou = [None if each != each else each for each in self.iou.round(4).tolist()]
        return json.dumps({**plain, **arrays, "iou": iou}, separators=(",", ":")).encode()


class Sender(Protocol):
    """Who is told of packets; nothing of it waits for those who listen."""

    def send(self, packet: Packet) -> None:
        """Tell of a packet."""

    def close(self) -> None:
        """Tell nothing more."""


def packet_maker(subject: Subject) -> Callable[[LiveFrame, float, bool, int], Packet]:
    """What makes packets of a subject's frames, of their times, of whether they are smoothed, and of how many were dropped."""
    skeleton = subject.body.skeleton

    def make(frame: LiveFrame, time: float, smooth: bool, dropped: int) -> Packet:
        world = joint_transforms(subject, frame.pose[:1])[1][0]
        turn = world[:, :3, :3] @ transposed(skeleton.frame.astype(float))
        known = frame.number, time, smooth, frame.status[0], skeleton.joints
        return Packet(*known, world[:, :3, 3], turn, frame.iou[0], dropped)

    return make
