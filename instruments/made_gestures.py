"""Hand signals of a person who stands still: waving, beckoning, halting, pointing.

Hands go from sign to sign along paths of least jerk in about 0.7 s, as free reaches of half a metre do (see
``least_jerk.py``); a hand waves two to three times a second. The rest of the body is as still as people are when they
stand: the centre of mass wanders by about 5 mm (Winter, *Human balance and posture control during standing and
walking*, Gait & Posture 3, 1995), weight moves from foot to foot now and then, and both feet stay where they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from least_jerk import minimum_jerk
from standing_posture import Foot, StandingPosture, Track, sway

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import turn
from mmocap_warp.synthesis.motion.limb_motion import SIGN, rest_place


@dataclass(frozen=True)
class Sign:
    """Where a hand is held and how it moves there: outward, up and forward of the shoulder, in arm lengths.

    Attributes:
        wrist: its place.
        elbow: where the elbow points.
        swing: to either side of the place.
        rate: of swinging [Hz].
    """

    wrist: tuple[float, float, float]
    elbow: tuple[float, float, float]
    swing: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rate: float = 0.0


HANGING = Sign((0.15, -0.95, 0.12), (0.35, 0.0, -1.0))
SIGNS: dict[str, Sign] = {
    "wave": Sign((0.42, 0.42, 0.38), (0.7, -1.0, -0.1), (0.24, -0.03, 0.0), 2.2),
    "high wave": Sign((0.34, 0.86, 0.20), (1.0, -0.2, 0.0), (0.22, 0.0, 0.0), 1.8),
    "come": Sign((0.15, -0.05, 0.60), (0.5, -1.0, -0.2), (0.0, 0.16, -0.20), 1.5),
    "halt": Sign((0.08, 0.10, 0.94), (0.7, -1.0, 0.0)),
    "aside": Sign((0.92, 0.08, 0.22), (0.0, -0.5, -1.0)),
    "go on": Sign((0.62, -0.10, 0.55), (0.6, -1.0, -0.3), (0.26, 0.05, 0.10), 1.1),
    # Hands that meet before both people, 1.1 m up: S2 has higher shoulders and shorter arms.
    "shake": Sign((-0.32, -0.50, 0.68), (0.5, -1.0, -0.2), (0.0, 0.10, 0.0), 2.4),
    "shake of S2": Sign((-0.32, -0.66, 0.55), (0.5, -1.0, -0.2), (0.0, 0.12, 0.0), 2.4),
}

Script = tuple[tuple[float, str, str, float], ...]
"""Per sign: when the hand sets out [s], its side, the sign, and how long it is held [s]."""

SCRIPTS: dict[str, Script] = {
    "S1": ((0.25, "R", "wave", 1.3), (2.25, "R", "come", 1.2)),
    "S2": ((0.25, "L", "wave", 1.0), (1.9, "R", "halt", 0.6), (2.3, "L", "come", 1.2), (4.2, "R", "aside", 0.5)),
    "S3": ((0.2, "R", "high wave", 1.1), (1.9, "L", "halt", 0.5), (2.0, "R", "go on", 1.2), (3.9, "L", "wave", 1.0)),
}

SHAKES: dict[str, Script] = {"S1": ((0.4, "R", "shake", 1.5),), "S2": ((0.4, "R", "shake of S2", 1.5),)}
"""Of two who face each other, 0.82 m apart."""

_MOVE, _RETURN = 0.7, 0.8  # time of a hand's way to a sign, and back down [s]
_FLOW = 0.4  # a hand that has less time than this before its next sign does not go down first [s]
_EASE = 0.25  # time in which a swing grows, and in which it fades [s]
_FOOT_AHEAD, _FOOT_ASIDE, _TOE_OUT = 0.02, 0.02, 0.10  # half of what separates the feet [m], [rad]
_SWAY_RATES = (0.12, 0.21, 0.34, 0.55)
_SWAY_ASIDE, _SWAY_AHEAD, _SHIFT = 0.004, 0.005, 0.02  # sway of the root, and how far the weight shifts [m]
_LEAST_KNEE = np.radians(5.0)


def gesturing(body: BodyModel, frames: int, fps: float, script: Script, seed: int) -> np.ndarray:
    """Full pose vectors (frame, 51), in body axes about the origin of the floor."""
    rng = np.random.default_rng([seed, 3])
    time = np.arange(frames) / fps
    posture = StandingPosture(body, frames)
    # Feet stand still, hips sway, and weight shifts away from the hand that is raised.
    aside = sway(time, _SWAY_RATES, rng)
    shift = Track(np.zeros(1))  # of the weight, from foot to foot
    for begin, side, _, hold in script:
        shift.out_and_back(begin, _MOVE, hold, _RETURN, -SIGN[side] * _SHIFT)
    moved = shift.at(time)[:, 0]
    root = np.zeros((frames, 3))
    root[:, 0] = _SWAY_ASIDE * aside + moved
    root[:, 2] = _SWAY_AHEAD * sway(time, _SWAY_RATES, rng)
    pelvis = turn("y", 0.02 * sway(time, _SWAY_RATES, rng)) @ turn("z", -0.6 * moved)
    half_width = float(abs(rest_place(body, "LHip")[0]))
    feet = {side: _foot(frames, sign, half_width) for side, sign in SIGN.items()}
    posture.stand(root, pelvis, feet, _LEAST_KNEE)

    # The chest turns toward the hand that is raised; the head looks about.
    turned = Track(np.zeros(1))
    for begin, side, _, hold in script:
        turned.out_and_back(begin, _MOVE, hold, _RETURN, -SIGN[side] * 0.05)
    chest = turn("y", turned.at(time)[:, 0] + 0.015 * sway(time, _SWAY_RATES, rng)) @ turn("x", np.full(frames, 0.02))
    look = turn("y", 0.08 * sway(time, (0.2, 0.37, 0.6), rng)) @ turn("x", 0.04 * sway(time, (0.3, 0.5), rng) + 0.03)
    posture.bend(chest, look)

    # Hands, from the shoulders.
    for side, sign in SIGN.items():
        wrist, elbow = _hand(time, [entry for entry in script if entry[1] == side], rng)
        outward = np.array([sign, 1.0, 1.0])
        posture.reach(side, posture.place(f"{side}Shoulder") + wrist * outward * posture.arm_length, elbow * outward)
    return posture.poses


def _foot(frames: int, sign: float, half_width: float) -> Foot:
    place = np.array([sign * (half_width + _FOOT_ASIDE), 0.0, sign * _FOOT_AHEAD])
    still = np.zeros(frames)
    return Foot(np.tile(place, (frames, 1)), still + sign * _TOE_OUT, still, still)


def _hand(
    time: np.ndarray, script: list[tuple[float, str, str, float]], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The wrist's place and where the elbow points, each (frame, 3), as in :class:`Sign`."""
    wrist, elbow = Track(np.array(HANGING.wrist)), Track(np.array(HANGING.elbow))
    swing = np.zeros((len(time), 3))
    now = HANGING
    ends = [*(begin for begin, *_ in script), np.inf][1:]
    for (begin, _, name, hold), following in zip(script, ends, strict=True):
        sign = SIGNS[name]
        _move_hand(wrist, elbow, begin, _MOVE, now, sign)
        held, now = begin + _MOVE, sign
        until = held + hold
        envelope = minimum_jerk((time - held + _EASE) / _EASE) * minimum_jerk((until + _EASE - time) / _EASE)
        swing += (envelope * np.sin(2 * np.pi * sign.rate * (time - held)))[:, None] * sign.swing
        if following > until + _FLOW:
            _move_hand(wrist, elbow, until, _RETURN, sign, HANGING)
            now = HANGING
    tremor = np.stack([0.01 * sway(time, (0.4, 0.7, 1.1), rng) for _ in range(3)], axis=-1)
    return wrist.at(time) + swing + tremor, elbow.at(time)


def _move_hand(wrist: Track, elbow: Track, begin: float, duration: float, start: Sign, end: Sign) -> None:
    wrist.move(begin, duration, np.subtract(end.wrist, start.wrist))
    elbow.move(begin, duration, np.subtract(end.elbow, start.elbow))
