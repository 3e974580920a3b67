"""All poses of a clip as one least-squares problem: what the contours say, and a penalty on accelerations."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.contour import ACCELERATION
from mmocap_warp.contour.clip.backward_pass import AHEAD, BackwardPass
from mmocap_warp.contour.clip.device_band import DeviceBand, Motion
from mmocap_warp.contour.clip.motion_penalty import HELD, MotionPenalty
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.descent import LARGEST_STEP, RAISE, STOP, Trust
from mmocap_warp.contour.frame.normal_equations import LineariseFrames, NormalEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting

COARSE_ACCELERATION = 72.0  # ``ACCELERATION`` for a first pass, in which frames still find the contours they belong to
WINDOW = 2.0  # what is solved together [s]
OVERLAP = 0.4  # the end of a window that is solved again with what follows it [s]
LAG = 10  # frames that are solved together while a clip is still being recorded
COMMIT = 4  # how many of them are final each time
_LAG_STEPS = 2  # descent steps of these frames

_NOISE = 0.05  # share of itself that a step may add to a frame's cost


@dataclass(frozen=True)
class Pass:
    """Steps under one penalty."""

    acceleration: float  # standard deviation of a point's acceleration, by coordinate [m/s^2]
    steps: int  # how many are tried at most


def coarse_then_fine(acceleration: float = ACCELERATION) -> tuple[Pass, ...]:
    """Four steps under a weak penalty, then three under the one that is asked for."""
    return Pass(max(acceleration, COARSE_ACCELERATION), 4), Pass(acceleration, 3)


@dataclass(frozen=True, eq=False)
class SolvedWindow:
    """Consecutive frames that were solved together."""

    rooted: RootedPoses  # their poses
    contour: NormalEquations  # what the contours say around these
    final: int  # how many of them are final, from the first


@dataclass(frozen=True, eq=False)
class ClipProblem:
    """What all frames of a clip share."""

    linearise: LineariseFrames  # the contours' equations
    rooting: Rooting  # moves poses
    points: MotionPoints  # what is kept from accelerating
    rate: float  # frames a second
    # a second opinion on a window's poses; where it differs the window is solved anew. None to do without
    backward: BackwardPass | None = None
    band: DeviceBand | None = None  # solves steps on a GPU; None for NumPy, on a CPU twenty times as fast

    def windows(
        self,
        course: RootedPoses,
        passes: tuple[Pass, ...] = coarse_then_fine(),
        shows: np.ndarray | None = None,
        ready: Callable[[int], object] = lambda end: None,
    ) -> Iterator[SolvedWindow]:
        """The clip's poses in windows of frames that are solved in turn, so that memory does not grow with the clip.

        All but a window's end is final: the next window starts from there, with its last poses held. A window may end
        after frames that ``shows`` (frame,) bool names; where it is None, after those that show anything. Frames of
        the ``course`` may be missing at first: ``ready`` waits for those up to one, before they are looked at.
        """
        window, overlap, ahead = window_frames(self.rate), round(OVERLAP * self.rate), round(AHEAD * self.rate)
        first, held, rooted = 0, self.rooting.none, self.rooting.none  # poses from the first frame of a window on
        while first < len(course):
            # Solve the window.
            last = min(first + window, len(course))
            ready(last)
            count, frames = last - first, np.arange(first, last)
            rooted = rooted.followed_by(course[first + len(rooted) : last])
            solved, contour = self.solved_together(frames, rooted[:count], held, passes)
            # Follow it backwards from beyond its end; where that finds better poses, solve it anew from these.
            if self.backward:
                beyond = min(last + ahead, len(course))
                ready(beyond)
                rooted = rooted.followed_by(course[first + len(rooted) : beyond])
                known = solved.followed_by(rooted[count:])
                revised = self.backward.revised(np.arange(first, beyond), known, held, contour)
                if revised is not known:
                    rooted = revised
                    solved, contour = self.solved_together(frames, rooted[:count], held, passes)
                tracked = self.rooting.refold(course[first:last])
                returned = self.backward.returned(frames, solved, contour, tracked, held)
                if returned is not solved:
                    solved, contour = returned, self.linearise(frames, returned)
            # Its end is solved once more with the frames that follow.
            final = count
            if last < len(course):
                final = _final_frames(contour.observed if shows is None else shows[first:last], overlap)
            yield SolvedWindow(solved, contour, final)
            first, rooted = first + final, solved[final:].followed_by(rooted[count:])
            held = held.followed_by(solved[:final])[-HELD:]

    def solved_together(
        self, frames: np.ndarray, rooted: RootedPoses, held: RootedPoses, passes: tuple[Pass, ...]
    ) -> tuple[RootedPoses, NormalEquations]:
        """Consecutive frames by their numbers, solved at once, and what the contours say around their poses.

        ``held`` are the final poses before them.
        """
        contour = self.linearise(frames, rooted)
        rooted = held.followed_by(rooted).interpolated(_known(held, contour))[len(held) :]
        for each in passes:
            rooted, contour = self._descended(frames, rooted, held, contour, each)
        return rooted, contour

    def _descended(
        self, frames: np.ndarray, rooted: RootedPoses, held: RootedPoses, contour: NormalEquations, under: Pass
    ) -> tuple[RootedPoses, NormalEquations]:
        """Poses after damped Gauss-Newton steps, fewer where one becomes tiny, and the contours' equations around them.

        Each frame has a damping of its own. A frame whose own cost rose by more than matching is noisy stays where it
        was, and is damped ten times as much in the next step: a fist before the chest has no outline, and one that is
        lost drags its neighbours along.
        """
        penalty, trust = MotionPenalty(under.acceleration, self.rate), Trust(self.rooting.is_length)
        damping = np.ones(len(rooted))
        for _ in range(under.steps):
            # Step, and judge each frame by what it costs there.
            own = replace(contour, matrix=contour.matrix + trust.matrix(contour, damping))
            step, motion_cost = self._step(held.followed_by(rooted), len(held), _known(held, contour), own, penalty)
            step = np.clip(step, -LARGEST_STEP, LARGEST_STEP)
            moved = self.rooting.stepped(rooted, step)
            there = self.linearise(frames, moved)
            places = self.points.at(held.followed_by(moved))
            cost = there.cost + penalty.cost(places, _known(held, there))[len(held) :]
            taken = cost <= (contour.cost + motion_cost) * (1.0 + _NOISE)
            # Take the step where it helps, and damp the next one where it does not.
            taken |= ~contour.observed
            rooted, contour = moved.where(taken, rooted), there.where(taken, contour)
            damping = np.where(taken, np.maximum(damping / RAISE, 1.0), damping * RAISE)
            if np.abs(step).max() < STOP:
                break
        return rooted, contour

    def _step(
        self, rooted: RootedPoses, held: int, known: np.ndarray, own: NormalEquations, penalty: MotionPenalty
    ) -> tuple[np.ndarray, np.ndarray]:
        """The step (frame, dof) from poses, and their share of the penalty (frame,); the first ones are ``held``.

        ``known`` (frame,) bool are the frames that show anything, or are held, and ``own`` is what each of the others
        says.
        """
        if self.band:
            moving = Motion(self.points, rooted, penalty, known)
            return self.band.solved(moving, held, own), moving.terms.cost[held:]
        motion = penalty.around(*self.points.linearised(rooted), known).without_first(held)
        return (motion.band + own.matrix).solved(own.gradient + motion.gradient), motion.cost


def window_frames(rate: float) -> int:
    """How many frames are solved together; two at least, so that every window has a final one."""
    return max(2, round(WINDOW * rate))


def _known(held: RootedPoses, contour: NormalEquations) -> np.ndarray:
    """(frame,) bool: frames that are held, then those that show anything."""
    return np.pad(contour.observed, (len(held), 0), constant_values=True)


def _final_frames(observed: np.ndarray, overlap: int) -> int:
    """How many frames of a window are final: all but its end, which does not begin where frames show nothing.

    A gap that is longer than half a window is cut all the same.
    """
    end = len(observed) - overlap
    shows = np.flatnonzero(observed[:end])
    final = int(shows[-1]) + 1 if len(shows) else 0
    return final if final >= len(observed) // 2 else end


class FixedLag:
    """Solves a clip that is still being recorded: the newest frames, whenever enough have come.

    ``acceleration`` is a joint's standard deviation, by coordinate [m/s^2], and ``first`` the first frame's number.
    """

    def __init__(self, problem: ClipProblem, acceleration: float = ACCELERATION, first: int = 0) -> None:
        self._problem, self._passes = problem, (Pass(acceleration, _LAG_STEPS),)
        self._held = self._waiting = problem.rooting.none
        self._final = first  # number of the first frame that is not final

    def add(self, rooted: RootedPoses) -> RootedPoses | None:
        """Takes the next frame's pose, as it was tracked, and returns the poses that are final now, if any are."""
        self._waiting = self._waiting.followed_by(rooted)
        return self._solved(COMMIT) if len(self._waiting) >= LAG else None

    def rest(self) -> RootedPoses | None:
        """The poses of the last frames, when no more will come."""
        return self._solved(len(self._waiting)) if len(self._waiting) else None

    def _solved(self, commit: int) -> RootedPoses:
        """The first ``commit`` of the waiting frames."""
        frames = np.arange(self._final, self._final + len(self._waiting))
        rooted, _ = self._problem.solved_together(frames, self._waiting, self._held, self._passes)
        self._final += commit
        self._waiting = rooted[commit:]
        self._held = self._held.followed_by(rooted[:commit])[-HELD:]
        return rooted[:commit]
