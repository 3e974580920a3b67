"""What is told of a frame: its number and time, and where the body's joints are and how they turn."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mmocap_warp.body.model import Subject, joint_transforms
from mmocap_warp.body.rotations import transposed
from mmocap_warp.tracking.live import LiveFrame


@dataclass(frozen=True, eq=False)
class Packet:
    """An answer to a frame, of its first run.

    Attributes:
        answer: what was found.
        subject: whose body that is.
        time: when the frame was seen, in seconds since 1970.
        smooth: whether frames after it had a say.
        dropped: frames that were dropped so far.
    """

    answer: LiveFrame
    subject: Subject
    time: float
    smooth: bool
    dropped: int

    @cached_property
    def world(self) -> np.ndarray:
        """(joint, 4, 4) of the joints in the world; turned from the body's bind pose [m]."""
        world = joint_transforms(self.subject, self.answer.pose[:1])[1][0]
        world[:, :3, :3] = world[:, :3, :3] @ transposed(self.subject.body.skeleton.frame.astype(float))
        return world

    @cached_property
    def values(self) -> np.ndarray:
        """(joint, 7) the joints' places in the world [m], and how they turn: quaternions x, y, z, w."""
        return np.concatenate([self.world[:, :3, 3], quaternions(self.world[:, :3, :3])], axis=1)

    @cached_property
    def json(self) -> str:
        """As ZMQ and WebSocket send it."""
        told = {"frame": self.answer.number, "time": self.time, "smooth": self.smooth, "dropped": self.dropped}
        told |= {"status": self.answer.status[0], "joints": self.subject.body.skeleton.joints}
        told |= {"place": self.values[:, :3].round(5).tolist(), "turn": self.values[:, 3:].round(6).tolist()}
        iou = [None if each != each else each for each in self.answer.iou[0].round(4).tolist()]
        return json.dumps(told | {"iou": iou}, separators=(",", ":"))


def quaternions(rotations: np.ndarray) -> np.ndarray:
    """(n, 4) x, y, z, w of rotations (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    values: np.ndarray = Rotation.from_matrix(rotations).as_quat()
    return values
