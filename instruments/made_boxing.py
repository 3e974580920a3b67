"""Shadow boxing: guard, straight punches and hooks that start from the feet, steps, slips.

What is known of it, and used here:

- elite amateurs act about 1.5 times a second, with combinations and pauses, and move their hips up and down about
  56 times a minute (Davis, Benson, Pitty, Connorton and Waldock, *The activity profile of elite male amateur boxing*,
  Int. J. Sports Physiology and Performance 10, 2015);
- fists reach 7 to 9 m/s with full effort, hooks more than straight punches (Piorkowski, Lees and Barton, *Single
  maximal versus combination punch kinematics*, Sports Biomechanics 10, 2011); shadow boxing is slower;
- a punch starts from the rear leg, over pelvis and trunk to the arm, the rear foot turning on its toes (Stanley,
  Thomson, Smith and Lamb, *An analysis of the three-dimensional kinetics and kinematics of maximal effort punches among
  amateur boxers*, Int. J. Performance Analysis in Sport 18, 2018).

A stance is written for someone who leads with the left and mirrored for one who leads with the right.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from standing_posture import Foot, StandingPosture, Track, sway

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import turn
from mmocap_warp.synthesis.motion.limb_motion import leg_length

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Punch:
    """A punch, as changes from the guard. Places are to the lead's side, up and ahead; angles turn the rear side ahead.

    Attributes:
        hand: ``lead`` or ``rear``.
        wrist: where the wrist ends, from the neck, in arm lengths.
        via: a change on the way, gone at the end, in arm lengths.
        elbow: where the elbow points at the end.
        pelvis: turn of the pelvis [rad].
        chest: turn of the chest [rad].
        ahead: how far the pelvis moves ahead [m].
        heel: how far the rear heel rises [rad].
        out: time to the end [s].
        back: time back to the guard [s].
    """

    hand: str
    wrist: Point
    via: Point
    elbow: Point
    pelvis: float
    chest: float
    ahead: float
    heel: float
    out: float
    back: float


_NO_VIA = (0.0, 0.0, 0.0)
PUNCHES: dict[str, Punch] = {
    "jab": Punch("lead", (0.06, -0.10, 1.30), _NO_VIA, (0.7, -0.8, 0.0), -0.10, -0.25, 0.035, 0.05, 0.18, 0.25),
    "cross": Punch("rear", (0.02, -0.10, 1.30), _NO_VIA, (-0.7, -0.8, 0.0), 0.50, 0.95, 0.06, 0.45, 0.20, 0.30),
    "lead hook": Punch(
        "lead", (-0.22, -0.14, 0.78), (0.55, 0.0, 0.05), (1.0, 0.15, -0.3), -0.30, -0.70, 0.02, 0.05, 0.22, 0.32
    ),
    "rear hook": Punch(
        "rear", (0.20, -0.14, 0.80), (-0.50, 0.0, 0.05), (-1.0, 0.15, -0.3), 0.50, 0.95, 0.04, 0.40, 0.24, 0.34
    ),
    "body jab": Punch("lead", (0.06, -0.62, 1.16), _NO_VIA, (0.8, -0.6, 0.0), -0.10, -0.25, 0.05, 0.05, 0.20, 0.28),
}

_GUARD: dict[str, Point] = {
    "lead": (0.16, -0.16, 0.60),
    "rear": (-0.20, -0.18, 0.40),
}  # places of the wrists from the neck
_GUARD_ELBOW: dict[str, Point] = {"lead": (0.45, -1.0, -0.2), "rear": (-0.45, -1.0, -0.2)}


@dataclass(frozen=True)
class Round:
    """What a boxer does.

    Attributes:
        lead: the side in front, ``L`` or ``R``.
        punches: when each begins [s], and a key of ``PUNCHES``.
        steps: when each begins [s], and how far it goes, to the lead's side and ahead [m].
        slips: when the head moves off the line [s], and how far, to the lead's side [m].
        pace: punches take as many times less time.
    """

    lead: str
    punches: tuple[tuple[float, str], ...]
    steps: tuple[tuple[float, float, float], ...]
    slips: tuple[tuple[float, float], ...]
    pace: float = 1.0

    def timed_punches(self) -> Iterator[tuple[float, Punch, float, float]]:
        """When each punch begins, the punch, and how long its ways out and back take [s]."""
        for begin, name in self.punches:
            punch = PUNCHES[name]
            yield begin, punch, punch.out / self.pace, punch.back / self.pace


ROUNDS: dict[str, Round] = {
    "S1": Round(
        "L",
        (
            (0.3, "jab"),
            (0.75, "cross"),
            (1.5, "jab"),
            (1.95, "jab"),
            (2.4, "cross"),
            (3.2, "lead hook"),
            (3.8, "cross"),
        ),
        ((1.05, 0.0, 0.14), (2.75, 0.05, -0.16)),
        ((2.85, 0.07),),
    ),
    "S2": Round(
        "L",
        ((0.35, "jab"), (0.8, "jab"), (1.3, "cross"), (2.1, "lead hook"), (2.75, "cross"), (3.4, "body jab")),
        ((0.4, 0.0, 0.10), (1.65, 0.12, 0.0), (3.0, -0.08, -0.12)),
        ((1.75, -0.06),),
        0.95,
    ),
    "S3": Round(
        "R",
        (
            (0.25, "jab"),
            (0.6, "cross"),
            (1.05, "lead hook"),
            (1.9, "jab"),
            (2.25, "rear hook"),
            (2.9, "body jab"),
            (3.35, "cross"),
            (4.2, "jab"),
            (4.55, "cross"),
            (5.0, "lead hook"),
        ),
        ((1.4, 0.10, 0.10), (3.7, -0.12, -0.12)),
        ((1.5, 0.08), (3.8, -0.08)),
        1.15,
    ),
}

FIGHTS: dict[str, Round] = {
    "S1": Round(
        "L",
        ((0.3, "jab"), (0.7, "cross"), (1.9, "jab"), (2.3, "lead hook"), (3.3, "cross")),
        ((0.2, 0.0, 0.12), (2.7, -0.10, -0.10)),
        ((1.25, 0.08), (2.8, -0.08)),
    ),
    "S2": Round(
        "L",
        ((1.1, "jab"), (1.45, "cross"), (2.6, "body jab"), (3.0, "cross"), (3.5, "lead hook")),
        ((0.9, 0.10, 0.0), (2.0, 0.0, -0.10)),
        ((0.35, -0.08), (2.0, 0.08)),
    ),
}
"""Of two who face each other: one slips while the other punches."""

_PELVIS, _CHEST = -0.60, -0.70  # turns of pelvis and chest in the guard, the rear side back [rad]
_CROUCH, _LEAN = 0.06, 0.14  # share of the leg's length that the hips are lower; lean of the chest [rad]
_FEET: dict[str, tuple[float, float, float]] = {"lead": (0.12, 0.23, -0.35), "rear": (-0.16, -0.24, -0.85)}  # and yaw
_REAR_HEEL = np.radians(12.0)  # the rear heel is always raised by this
_PIVOT = 0.7  # turn of the rear foot for the rise of its heel
_STEP, _STEP_LIFT = 0.24, 0.03  # time and height of a foot's step; the feet step one after the other [s, m]
_AIRBORNE = 0.7  # share of a step's time in which the foot goes ahead
_SLIP = (0.22, 0.08, 0.30)  # times of a slip: out, hold, back [s]
_BOUNCE, _BOUNCE_RATE = 0.010, 56.0 / 60.0  # height and rate at which the hips bounce [m, Hz]
_HOLD = 0.02  # time for which a punch is held at its end [s]
_TRUNK_FIRST = 0.04  # time by which the hips are ahead of the hand [s]
_LEAST_KNEE = np.radians(8.0)
_STANCE_SCALE = 0.86  # leg length that the stance is written for [m]


def boxing(body: BodyModel, frames: int, fps: float, script: Round, seed: int) -> np.ndarray:
    """Full pose vectors (frame, 51), in body axes about the origin of the floor; the opponent is ahead, at +Z."""
    rng = np.random.default_rng([seed, 4])
    time = np.arange(frames) / fps
    posture = StandingPosture(body, frames)
    sign = 1.0 if script.lead == "L" else -1.0
    sides = {"lead": script.lead, "rear": "R" if script.lead == "L" else "L"}
    leg = leg_length(body)
    size = leg / _STANCE_SCALE

    # Feet, hips and pelvis, from which the legs follow.
    turns, heel = _turns(script, time)
    feet = {hand: _foot(posture, side, hand, script, time, heel, sign, size) for hand, side in sides.items()}
    root = _root(script, time, size, rng) * (sign, 1.0, 1.0)
    root[:, 1] -= _CROUCH * leg + _BOUNCE
    pelvis = turn("y", sign * turns[:, 0]) @ turn("x", np.full(frames, 0.5 * _LEAN))
    posture.stand(root, pelvis, {sides[hand]: foot for hand, foot in feet.items()}, _LEAST_KNEE)

    # Chest and head, which lean aside in slips.
    aside = _slips(script, time) + 0.02 * sway(time, (0.4, 0.7, 1.1), rng)
    chest = (
        turn("z", -sign * aside) @ turn("y", sign * turns[:, 1]) @ turn("x", _LEAN + 0.02 * sway(time, (0.5, 0.9), rng))
    )
    head = (
        turn("z", -0.7 * sign * aside)
        @ turn("y", 0.3 * sign * (turns[:, 1] - _CHEST))
        @ turn("x", np.full(frames, 0.16))
    )
    posture.bend(chest, head)

    # Hands, from the neck.
    for hand, side in sides.items():
        wrist, elbow = _hand(hand, script, time, rng)
        posture.reach(
            side, posture.place("Neck") + wrist * (sign, 1.0, 1.0) * posture.arm_length, elbow * (sign, 1.0, 1.0)
        )
    return posture.poses


def _turns(script: Round, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pelvis' and the chest's turn (frame, 2), and the rise of the rear heel (frame,), for a left lead [rad]."""
    turns, heel = Track(np.array([_PELVIS, _CHEST])), Track(np.array([_REAR_HEEL]))
    for begin, punch, out, back in script.timed_punches():
        turns.out_and_back(begin - _TRUNK_FIRST, out, _HOLD, back, (punch.pelvis, punch.chest))
        heel.out_and_back(begin - _TRUNK_FIRST, out, _HOLD, back, punch.heel)
    return turns.at(time), heel.at(time)[:, 0]


def _root(script: Round, time: np.ndarray, size: float, rng: np.random.Generator) -> np.ndarray:
    """The root's path for a left lead: to the lead's side, up, ahead."""
    root = Track(np.zeros(3))
    for begin, punch, out, back in script.timed_punches():
        root.out_and_back(begin, out, _HOLD, back, (0.0, 0.0, punch.ahead))
    for begin, aside, ahead in script.steps:
        root.move(begin, 2 * _STEP, (aside * size, 0.0, ahead * size))
    for begin, aside in script.slips:
        root.out_and_back(begin, *_SLIP, (0.4 * aside, -0.02, 0.0))
    path = root.at(time)
    path[:, 1] += _BOUNCE * np.sin(2 * np.pi * (_BOUNCE_RATE * time + rng.random()))
    path[:, [0, 2]] += 0.006 * np.stack([sway(time, (0.3, 0.6, 1.0), rng) for _ in range(2)], axis=-1)
    return path


def _slips(script: Round, time: np.ndarray) -> np.ndarray:
    """Lean of the chest to the lead's side (frame,) [rad]."""
    lean = Track(np.zeros(1))
    for begin, aside in script.slips:
        lean.out_and_back(begin, *_SLIP, 2.5 * aside)
    return lean.at(time)[:, 0]


def _foot(
    posture: StandingPosture,
    side: str,
    hand: str,
    script: Round,
    time: np.ndarray,
    heel: np.ndarray,
    sign: float,
    size: float,
) -> Foot:
    """The lead or the rear foot. It steps from place to place; the rear one turns about its toes as its heel rises."""
    x, z, yaw = _FEET[hand]
    path, lift = Track(np.array([x, 0.0, z]) * size), np.zeros(len(time))
    for begin, aside, ahead in script.steps:
        # The foot on the side of the step goes first.
        first = "lead" if (ahead if abs(ahead) > abs(aside) else aside) > 0 else "rear"
        begin += 0.0 if hand == first else _STEP
        path.move(begin + (1 - _AIRBORNE) / 2 * _STEP, _AIRBORNE * _STEP, np.array([aside, 0.0, ahead]) * size)
        lift += _STEP_LIFT * np.sin(np.pi * np.clip((time - begin) / _STEP, 0.0, 1.0)) ** 2
    place = path.at(time) * (sign, 1.0, 1.0)
    facing = np.full(len(time), sign * yaw)
    if hand == "lead":
        return Foot(place, facing, np.zeros(len(time)), lift)
    turned = facing + sign * _PIVOT * (heel - _REAR_HEEL)
    return posture.pivoting(side, Foot(place, turned, -heel, lift))


def _hand(hand: str, script: Round, time: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The wrist from the neck in arm lengths, and where the elbow points, each (frame, 3), for a left lead."""
    wrist, elbow = Track(np.array(_GUARD[hand])), Track(np.array(_GUARD_ELBOW[hand]))
    for begin, punch, out, back in script.timed_punches():
        if punch.hand != hand:
            continue
        wrist.out_and_back(begin, out, _HOLD, back, np.subtract(punch.wrist, _GUARD[hand]))
        wrist.out_and_back(begin - 0.5 * out, 0.8 * out, 0.0, 0.7 * out, punch.via)
        elbow.out_and_back(begin - 0.6 * out, 1.5 * out, _HOLD, back, np.subtract(punch.elbow, _GUARD_ELBOW[hand]))
    wander = np.stack([0.02 * sway(time, (0.5, 0.9, 1.5), rng) for _ in range(3)], axis=-1)
    return wrist.at(time) + wander, elbow.at(time)
