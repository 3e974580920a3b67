"""When a foot stands on the floor (its lowest skin is near the floor, and slow), and steps and strides from that."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.posing import blocks, skin_positions

_HUMAN_FEET = {"left": "LAnkle", "right": "RAnkle"}  # the joints that a person's feet follow
_REACH = 0.1  # feet reach down to this share of a body's height over its lowest skin in the bind pose

NEAR_FLOOR = 0.03
"""Height of a standing foot's lowest skin over the floor, at most [m]."""
SLOW = 0.5
"""Speed of a standing foot's lowest skin, at most [m/s]."""
SHORTEST = 0.05
"""Contacts and gaps between them that are shorter than this do not count [s]."""

_SOLE = 0.03  # height of the sole over the foot's lowest skin in the bind pose, in which the foot stands flat [m]
_LOWEST = 0.005  # a foot's speed is that of the skin within this height of its lowest [m]
_FRAMES_AT_ONCE = 1024


@dataclass(frozen=True)
class Foot:
    """A foot over the floor."""

    height: np.ndarray  # (frame,) of its lowest skin over the floor [m]
    speed: np.ndarray  # (frame,) of that skin [m/s]
    on_floor: np.ndarray  # (frame,) bool

    @property
    def strikes(self) -> np.ndarray:
        """Frames in which a contact begins; one that is there in the first frame does not count."""
        return 1 + np.flatnonzero(self.on_floor[1:] & ~self.on_floor[:-1])

    @property
    def offs(self) -> np.ndarray:
        """First frames after a contact."""
        return 1 + np.flatnonzero(~self.on_floor[1:] & self.on_floor[:-1])


def feet_of(body: BodyModel) -> dict[str, str]:
    """The joints that its feet follow: a person's by side, ``left`` and ``right``, another body's by their own names.

    A body that has no ankle of a person has feet where limbs end that come in left-right pairs and reach down to the
    ground that it stands on in its bind pose, such as paws.
    """
    skeleton, rest = body.skeleton, body.skin.rest
    if any(joint in skeleton.joints for joint in _HUMAN_FEET.values()):
        return _HUMAN_FEET
    low = rest[:, 1].min() + _REACH * float(np.ptp(rest[:, 1]))
    ends = [joint for pair in skeleton.pairs for joint in pair[1:] if skeleton.index(joint) not in skeleton.parent]
    return {joint: joint for joint in ends if rest[_skin_of(body, joint), 1].min(initial=np.inf) < low}


def feet_on_floor(subject: Subject, pose: np.ndarray, seconds: np.ndarray, up: np.ndarray) -> dict[str, Foot]:
    """The feet that a subject has, named as :func:`feet_of` does.

    The floor is level, and as high as the lowest foot is in half of the frames. No speed is known of a single frame,
    and so no contact. The poses (frame, coordinate) are at ``seconds`` (frame,), ascending; the world's vertical ``up``
    (3,) has length one.
    """
    tracks = {
        name: _lowest_skin(subject, pose, seconds, up, joint)
        for name, joint in feet_of(subject.body).items()
        if len(_sole(subject.body, joint))
    }
    if not tracks:
        return {}
    floor = float(np.median(np.min([height for height, _ in tracks.values()], axis=0)))
    feet = {}
    for name, (height, speed) in tracks.items():
        over = height - floor
        feet[name] = Foot(over, speed, _without_short_changes((over < NEAR_FLOOR) & (speed < SLOW), seconds))
    return feet


def _skin_of(body: BodyModel, joint: str) -> np.ndarray:
    """(vertex,) int, the skin that a joint moves most; none where there is no such joint."""
    if joint not in body.skeleton.joints:
        return np.zeros(0, int)
    return np.flatnonzero(body.skin.heaviest_joint == body.skeleton.index(joint))


def _sole(body: BodyModel, joint: str) -> np.ndarray:
    """(vertex,) int, the lower skin of a foot."""
    foot = _skin_of(body, joint)
    height = body.skin.rest[foot, 1]
    return foot[height < height.min(initial=np.inf) + _SOLE]


def _lowest_skin(
    subject: Subject, pose: np.ndarray, seconds: np.ndarray, up: np.ndarray, joint: str
) -> tuple[np.ndarray, np.ndarray]:
    """Height in the world and speed of a foot's lowest skin, each (frame,) float64; the speed NaN of a single frame."""
    sole, frames = _sole(subject.body, joint), len(pose)
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


def _without_short_changes(on_floor: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """Contacts without short gaps, then without short contacts; what reaches the clip's ends counts as long."""
    lasting = on_floor.copy()
    for kind in (False, True):
        for start, stop in pairwise(1 + np.flatnonzero(np.diff(lasting))):
            if lasting[start] == kind and seconds[stop] - seconds[start] < SHORTEST:
                lasting[start:stop] = not kind
    return lasting


_LEAST_WAY = 0.05  # way of the root during a step that is long enough to have a direction [m]


@dataclass(frozen=True)
class Step:
    """From a foot's heel strike to the other foot's next one."""

    side: str  # of the foot that lands
    frame: int  # in which it lands, as a position in the clip
    seconds: float  # that it takes
    length: float  # from heel to heel, each as it struck, along the root's way meanwhile [m]; NaN where the root stays


@dataclass(frozen=True)
class Stride:
    """From a foot's heel strike to its next one."""

    side: str  # of the foot
    frame: int  # of the first strike, as a position in the clip
    seconds: float  # that it takes
    length: float  # between the places where the heel strikes, on the level [m]
    stance_share: float  # of the time in which the foot stands


@dataclass(frozen=True)
class Walking:
    """What was seen of somebody's gait; empty where nobody walks."""

    steps: list[Step] = field(default_factory=list)
    strides: list[Stride] = field(default_factory=list)

    @property
    def cadence(self) -> float:
        """Steps per minute; NaN where there is none."""
        return 60.0 / float(np.mean([step.seconds for step in self.steps])) if self.steps else np.nan


def walking(
    feet: dict[str, Foot], heel: dict[str, np.ndarray], root: np.ndarray, seconds: np.ndarray, up: np.ndarray
) -> Walking:
    """Steps and strides that lie wholly within the clip; there are steps only where there are two feet.

    The heels, by foot, and the root are (frame, 3) [m] at ``seconds`` (frame,); the vertical ``up`` (3,) has length
    one.
    """
    level = np.eye(3) - np.outer(up, up)
    heel, root = {side: places @ level for side, places in heel.items()}, root @ level
    strikes = sorted((int(frame), side) for side, foot in feet.items() for frame in foot.strikes)
    steps = []
    for (before, other), (frame, side) in pairwise(strikes):
        if side != other and frame > before and len(feet) == 2:  # who jumps lands on both
            way, reach = root[frame] - root[before], heel[side][frame] - heel[other][before]
            distance = float(np.linalg.norm(way))
            length = float(reach @ way) / distance if distance >= _LEAST_WAY else np.nan
            steps.append(Step(side, frame, float(seconds[frame] - seconds[before]), length))
    return Walking(steps, [each for side, foot in feet.items() for each in _strides(side, foot, heel[side], seconds)])


def _strides(side: str, foot: Foot, heel: np.ndarray, seconds: np.ndarray) -> Iterator[Stride]:
    for first, second in pairwise(foot.strikes):
        off = foot.offs[(foot.offs > first) & (foot.offs < second)][0]
        lasts = float(seconds[second] - seconds[first])
        length = float(np.linalg.norm(heel[second] - heel[first]))
        yield Stride(side, int(first), lasts, length, float(seconds[off] - seconds[first]) / lasts)
