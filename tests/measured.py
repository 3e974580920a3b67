"""Results that were never tracked: given poses as answers, and a walk whose contacts are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from gait_curves import CADENCE, TOE_OFF
from made_walks import Walk
from synthetic import ring_rig

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.shape_space import heading_rotation, upright_base
from mmocap_warp.result.result import Result

LEG_AHEAD = {"left": 0.0, "right": 0.5}
"""Of each leg's phase before the left one's."""


def answer(
    body: BodyModel, poses: np.ndarray, *, up: str = "+y", heading: float = 0.0, fps: float = 60.0, runs: int = 1
) -> Result:
    """A result whose poses (frame, coordinate), in the axes of an upright body, are these in every run."""
    base = upright_base(up) @ heading_rotation(heading)
    poses = poses.copy()
    poses[:, :3] = poses[:, :3] @ base.T
    shape = runs, len(poses)
    rig = replace(ring_rig(2), up=up)
    return Result(
        subject=Subject(body, base, poses[0], {}),
        cameras=rig,
        fps=fps,
        frame_numbers=np.arange(len(poses)),
        pose=np.tile(poses, (runs, 1, 1)),
        cost=np.zeros(shape),
        iou=np.ones((*shape, len(rig))),
        evaluations=np.zeros(shape, np.int64),
        status=np.zeros(shape, np.int8),
        seconds=1.0,
        config={},
        versions={},
    )


def made_walk(body: BodyModel, cycles: float, fps: float, **more: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses (frame, coordinate) of a walk, and the left leg's phase (frame,)."""
    per_frame = CADENCE / 120.0 / fps
    phase = -cycles / 2 + per_frame * np.arange(int(cycles / per_frame))
    return Walk(body, **more).poses(phase), phase


def known_events(phase: np.ndarray, side: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The first frames of contacts, the first after them, and whether the foot stands in each frame."""
    own = phase + LEG_AHEAD[side]
    standing = own - np.floor(own) <= TOE_OFF
    changes = 1 + np.flatnonzero(np.diff(standing))
    return changes[standing[changes]], changes[~standing[changes]], standing


def mirrored(body: BodyModel, poses: np.ndarray) -> np.ndarray:
    """Each pose's mirror image: left and right exchanged, turned the other way about y and z."""
    names = body.skeleton.joints
    other = [names.index({"L": "R", "R": "L"}[n[0]] + n[1:]) if n != "Root" and n[0] in "LR" else names.index(n)
             for n in names]  # fmt: skip
    angles = poses[:, 3:].reshape(len(poses), -1, 3)[:, other] * (1, -1, -1)
    return np.concatenate([poses[:, :3] * (-1, 1, 1), angles.reshape(len(poses), -1)], axis=1)
