"""When a foot stands on the floor: its lowest skin is near the floor, and slow."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.result.positions import blocks, skin_positions

FEET: dict[str, str] = {"left": "LAnkle", "right": "RAnkle"}
"""The joints that feet follow."""

NEAR_FLOOR = 0.03
"""Height of a standing foot's lowest skin over the floor, at most [m]."""
SLOW = 0.5
"""Speed of a standing foot's lowest skin, at most [m/s]."""
SHORTEST = 0.05
"""Contacts and gaps between them that are shorter than this do not count [s]."""

_SOLE = 0.03  # skin that is as low as this over the foot's lowest in the bind pose, in which it stands flat [m]
_LOWEST = 0.005  # skin as near as this to the lowest tells the speed [m]
_FRAMES_AT_ONCE = 1024


@dataclass(frozen=True)
class Foot:
    """A foot over the floor.

    Attributes:
        height: (frame,) of its lowest skin over the floor [m].
        speed: (frame,) of that skin [m/s].
        on_floor: (frame,) bool.
    """

    height: np.ndarray
    speed: np.ndarray
    on_floor: np.ndarray

    @property
    def strikes(self) -> np.ndarray:
        """Frames with which a contact begins, but for one that the first frame shows already."""
        return 1 + np.flatnonzero(self.on_floor[1:] & ~self.on_floor[:-1])

    @property
    def offs(self) -> np.ndarray:
        """First frames after a contact."""
        return 1 + np.flatnonzero(~self.on_floor[1:] & self.on_floor[:-1])


def feet_on_floor(subject: Subject, pose: np.ndarray, seconds: np.ndarray, up: np.ndarray) -> dict[str, Foot]:
    """The feet that a subject has, by side.

    The floor is level, and as high as the lower foot is in half of the frames. No speed is known of a single frame,
    and so no contact.

    Args:
        subject: whose feet.
        pose: (frame, coordinate).
        seconds: (frame,), ascending.
        up: (3,), the world's vertical, of length one.
    """
    tracks = {
        side: _lowest_skin(subject, pose, seconds, up, joint)
        for side, joint in FEET.items()
        if len(_sole(subject, joint))
    }
    if not tracks:
        return {}
    floor = float(np.median(np.min([height for height, _ in tracks.values()], axis=0)))
    feet = {}
    for side, (height, speed) in tracks.items():
        over = height - floor
        feet[side] = Foot(over, speed, _lasting((over < NEAR_FLOOR) & (speed < SLOW), seconds))
    return feet


def _sole(subject: Subject, joint: str) -> np.ndarray:
    """(vertex,) int, the lower skin of a foot; none where there is no such joint."""
    body = subject.body
    if joint not in body.skeleton.joints:
        return np.zeros(0, int)
    foot = np.flatnonzero(body.skin.heaviest_joint == body.skeleton.index(joint))
    height = body.skin.rest[foot, 1]
    return foot[height < height.min(initial=np.inf) + _SOLE]


def _lowest_skin(
    subject: Subject, pose: np.ndarray, seconds: np.ndarray, up: np.ndarray, joint: str
) -> tuple[np.ndarray, np.ndarray]:
    """Height in the world and speed of a foot's lowest skin, each (frame,) float64; the speed NaN of a single frame."""
    sole, frames = _sole(subject, joint), len(pose)
    lowest, speed = np.empty(frames), np.full(frames, np.nan)
    for block in blocks(frames, _FRAMES_AT_ONCE):
        first, last = max(block.start - 1, 0), min(block.stop + 1, frames)  # a speed needs the frames around its own
        inner = slice(block.start - first, block.stop - first)
        places = skin_positions(subject, pose[first:last], sole).astype(float)
        height = places[inner] @ up
        lowest[block] = height.min(axis=1)
        if frames > 1:
            moved = np.linalg.norm(np.gradient(places, seconds[first:last], axis=0)[inner], axis=2)
            low = height < lowest[block, None] + _LOWEST
            speed[block] = (moved * low).sum(axis=1) / low.sum(axis=1)
    return lowest, speed


def _lasting(on_floor: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """Contacts without gaps that are too short, then without contacts that are; the clip's ends cut none short."""
    lasting = on_floor.copy()
    for kind in (False, True):
        changes = 1 + np.flatnonzero(np.diff(lasting))
        for start, stop in pairwise(changes):
            if lasting[start] == kind and seconds[stop] - seconds[start] < SHORTEST:
                lasting[start:stop] = not kind
    return lasting
