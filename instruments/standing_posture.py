"""What actors stand on and reach for: feet, hands and movements that add up, for ``sequence_motions.py``.

Flash and Henis (J. Cognitive Neuroscience 3, 1991): a movement that begins before the last one has ended adds to it.
Lengths are in metres and angles in radians, in body axes over a floor at zero: +Y up, +X left, +Z ahead.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from least_jerk import minimum_jerk

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import applied, turn
from mmocap_warp.synthesis.exact_posing import led_by
from mmocap_warp.synthesis.motion.limb_motion import Leg, Posture

_FULL_REACH = 0.985  # longest reach as a share of the arm's length: elbows stay bent by 20 degrees
_SOFT = 0.12  # a reach is shortened smoothly from this far before the longest one


@dataclass
class Track:
    """A value over time: a start, and movements that add up.

    Attributes:
        start: (value,) before anything moves.
        moves: beginning [s], duration [s] and change (value,) of each movement.
    """

    start: np.ndarray
    moves: list[tuple[float, float, np.ndarray]] = field(default_factory=list)

    def move(self, begin: float, duration: float, change: np.ndarray | float | tuple[float, ...]) -> None:
        """Add a movement by ``change``."""
        self.moves.append((begin, duration, np.asarray(change, float)))

    def out_and_back(
        self,
        begin: float,
        out: float,
        hold: float,
        back: float,
        change: np.ndarray | float | tuple[float, ...],
    ) -> None:
        """Add a movement by ``change`` that takes ``out`` seconds, and after ``hold`` one back that takes ``back``."""
        self.move(begin, out, change)
        self.move(begin + out + hold, back, -np.asarray(change, float))

    def at(self, time: np.ndarray) -> np.ndarray:
        """(time, value) at times [s]."""
        value = np.tile(np.atleast_1d(np.asarray(self.start, float)), (len(time), 1))
        for begin, duration, change in self.moves:
            value += minimum_jerk((time - begin) / duration)[:, None] * change
        return value


def sway(time: np.ndarray, rates: tuple[float, ...], rng: np.random.Generator) -> np.ndarray:
    """(time,) a wandering value of variance 1: waves of the given rates [Hz], slow ones larger, with random phases."""
    size = 1.0 / np.sqrt(rates)
    phase = rng.uniform(0, 2 * np.pi, len(rates))
    waves = np.sin(2 * np.pi * np.multiply.outer(time, rates) + phase)
    return waves @ size / np.sqrt((size**2).sum() / 2)


@dataclass(frozen=True)
class Foot:
    """A foot that stands, rolls over its sole, turns on its toes, or is in the air.

    Attributes:
        place: (frame, 3), on the floor, of the ankle's foot point when the foot is flat.
        yaw: (frame,), about the vertical, from its direction in the bind pose.
        pitch: (frame,), toes up positive.
        lift: (frame,), of the whole foot.
    """

    place: np.ndarray
    yaw: np.ndarray
    pitch: np.ndarray
    lift: np.ndarray

    def axes(self) -> np.ndarray:
        """(frame, 3, 3)."""
        return turn("y", self.yaw) @ turn("x", -self.pitch)

    def ankle(self, sole: Sole) -> np.ndarray:
        """(frame, 3)."""
        forward, up = sole.ankle(self.pitch)
        return self.place + applied(turn("y", self.yaw), np.stack([0 * up, up + self.lift, forward], axis=-1))


_STEEPEST = np.radians(75.0)
_GRID = 1201  # number of pitches, 1/8 of a degree apart


@dataclass(frozen=True)
class Sole:
    """Where the ankle is over the floor while the foot rolls from heel to toes on the outline of its sole.

    Attributes:
        pitch: (pitch,), of the foot, toes up positive, ascending [rad].
        forward: (pitch,), of the ankle from where it is when the foot is flat [m].
        up: (pitch,), of the ankle from the floor [m].
        contact: (pitch, 2), to the left and forward, of the point that touches, from where the ankle is when flat [m].
    """

    pitch: np.ndarray
    forward: np.ndarray
    up: np.ndarray
    contact: np.ndarray

    @classmethod
    def of(cls, body: BodyModel, side: str) -> Sole:
        """The sole of one side, ``L`` or ``R``, of a body that stands flat in its bind pose."""
        joint = body.skeleton.index(f"{side}Ankle")
        foot = (body.skin.rest[led_by(body, f"{side}Ankle")] - body.joint_rest[joint]).astype(float)
        x, y, z = foot.T
        pitch = np.linspace(-_STEEPEST, _STEEPEST, _GRID)
        sine, cosine = np.sin(pitch)[:, None], np.cos(pitch)[:, None]
        height = cosine * y + sine * z
        touching = height.argmin(axis=1)
        reach = np.take_along_axis(cosine * z - sine * y, touching[:, None], axis=1)[:, 0]
        # From one pitch to the next the foot turns about the vertex that touches, which stays where it is.
        rows = np.arange(_GRID - 1)
        next_reach = (cosine * z - sine * y)[rows + 1, touching[:-1]]
        moved = np.concatenate([[0.0], np.cumsum(reach[:-1] - next_reach)])
        flat = _GRID // 2
        forward = moved - moved[flat]
        return cls(pitch, forward, -height.min(axis=1), np.stack([x[touching], forward + reach], axis=-1))

    def ankle(self, pitch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far forward and up the ankle is at the given pitches [m]."""
        return np.interp(pitch, self.pitch, self.forward), np.interp(pitch, self.pitch, self.up)


def room(leg: Leg, root: np.ndarray, pelvis: np.ndarray, ankle: np.ndarray, flexion: float) -> float:
    """How far up the root can go before the knee's flexion from straight is less than ``flexion`` [rad]; [m].

    Args:
        root, ankle: (frame, 3), in the world [m].
        pelvis: (frame, 3, 3), world from the root joint's axes.
        flexion: from straight [rad].
    """
    away = ankle - root - applied(pelvis, leg.hip)
    level = np.hypot(away[:, 0], away[:, 2])
    return float((away[:, 1] + np.sqrt(leg.reach(flexion) ** 2 - level**2)).min())


class StandingPosture(Posture):
    """A posture of somebody who stands on feet and reaches with hands."""

    def __init__(self, body: BodyModel, frames: int) -> None:
        super().__init__(body, frames)
        self._soles = {side: Sole.of(body, side) for side in "LR"}

    @property
    def arm_length(self) -> float:
        """Shoulder to wrist along the bones, mean of both sides [m]."""
        return (self._arms["L"].length + self._arms["R"].length) / 2

    def stand(self, root: np.ndarray, pelvis: np.ndarray, feet: dict[str, Foot], least_knee: float) -> None:
        """Set the root and the legs.

        Args:
            root: (frame, 3), the root joint; its heights count from the greatest mean height at which no knee is bent
                less than ``least_knee``, so zeros stand tall.
            pelvis: (frame, 3, 3), its axes.
            feet: by side.
            least_knee: flexion from straight [rad].
        """
        ankles = {side: foot.ankle(self._soles[side]) for side, foot in feet.items()}
        rooms = [room(self._legs[side], root, pelvis, ankle, least_knee) for side, ankle in ankles.items()]
        root = root + np.array([0.0, np.min(rooms), 0.0])
        axes = {side: foot.axes() for side, foot in feet.items()}
        hinges = {side: turn("y", foot.yaw)[:, :, 0] for side, foot in feet.items()}
        self._set_legs(root, pelvis, ankles, hinges, axes)

    def place(self, joint: str) -> np.ndarray:
        """(frame, 3), where a joint is, given what has been set so far."""
        return self._poser.joint_transforms(self.poses)[:, self._body.skeleton.index(joint), :3, 3]

    def pivoting(self, side: str, foot: Foot) -> Foot:
        """The foot with its places moved so that, as it yaws, it turns about the point that touches the floor."""
        sole, middle = self._soles[side], (foot.pitch[1:] + foot.pitch[:-1]) / 2
        x, z = sole.contact[np.searchsorted(sole.pitch, middle)].T
        turned = np.diff(turn("y", foot.yaw), axis=0)
        moved = np.cumsum(applied(turned, np.stack([x, 0 * x, z], axis=-1)), axis=0)
        return replace(foot, place=foot.place - np.concatenate([np.zeros((1, 3)), moved]))

    def reach(self, side: str, wrist: np.ndarray, points: np.ndarray) -> None:
        """Set an arm by its wrist's place (frame, 3) in the world and where its elbow points (frame, 3).

        A place that is out of reach, or nearly so, is drawn in: the elbow stays bent by 20 degrees.
        """
        from_shoulder = self._within_reach(side, wrist - self.place(f"{side}Shoulder"))
        self._set_arm(side, from_shoulder, points)

    def _within_reach(self, side: str, wrist: np.ndarray) -> np.ndarray:
        """The wrist's places from the shoulder (frame, 3), drawn in smoothly near the arm's length and beyond."""
        share = np.linalg.norm(wrist, axis=-1, keepdims=True) / self._arms[side].length
        bound = _FULL_REACH - _SOFT
        return wrist * np.where(share < bound, 1.0, (bound + _SOFT * np.tanh((share - bound) / _SOFT)) / share)
