"""A packet of a live frame, and a port to send it to."""

from __future__ import annotations

import socket

import numpy as np
from synthetic import ring_rig, synthetic_poses, synthetic_subject

from mmocap_warp.body.model import Subject, joint_transforms
from mmocap_warp.streaming.senders import Packet
from mmocap_warp.tracking.live_smoothing import LiveFrame

RIG = ring_rig(2)
SUBJECT = synthetic_subject()


def packet(subject: Subject = SUBJECT, smooth: bool = False, person: str = "") -> Packet:
    """Frame 7, at 2.5 s, seen by the first camera alone."""
    pose = np.concatenate([subject.pose[:3], synthetic_poses(3)[2][3:]])[None]
    answer = LiveFrame(7, pose, pose, joint_transforms(subject, pose)[1], np.array([[0.91, np.nan]]), ("partial",))
    return Packet(answer, subject, 2.5, smooth, 3, person)


def free_port() -> int:
    """A port of this machine that nobody listens at."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])
