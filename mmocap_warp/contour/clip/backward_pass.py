"""A second opinion on a stretch of a clip: it is followed backwards too, and each frame's better pose is kept.

A limb that a tracker lost it finds again some frames later. From there the way back leads along the limb, where the way
ahead lost it: a fist folds before the chest in one direction of time, and comes out of it in the other. One that no
later frame knows may be where it was in an earlier one. Two that explain each other's masks, such as crossed arms, may
be wrong in all frames alike: they are looked for anew.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.contour.clip.motion_points import POINTS_A_JOINT, MotionPoints
from mmocap_warp.contour.frame.normal_equations import LineariseFrames
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting

DescendFrames = Callable[[np.ndarray, RootedPoses], tuple[RootedPoses, np.ndarray]]
"""Poses that contours lead to from some, each in its frame (pose,), and what they cost (pose,)."""
PairsAnew = Callable[[int, RootedPoses], RootedPoses]
"""Poses of a frame, as one (1,) is but for a pair of limbs that were looked for from rest."""

AreaCost = Callable[[np.ndarray, RootedPoses], np.ndarray]
"""What frames' masks and the body in a pose for each do not cover of each other (frame,)."""

AHEAD = 0.6
"""How far beyond a window frames are followed back from [s]: its own end may be where a limb is lost."""
STARTS = 2
"""Poses that a frame on the way back is descended from: the last, and where its motion leads."""
_DAMPED = 0.8  # of the last motion is taken to go on
_WORSE = 1.35  # a cost so many times as high is that of another answer
_ANOTHER = 0.04  # [m] by which a joint is elsewhere in another answer
_LOOKED_UP = 0.1  # [s] between frames on the way back in which limbs are recalled
_RARELY = 5  # of these frames every so many-th is one in which pairs are looked for anew
_RECALLED = 0.25  # [s] between the frames from which
_TRIED = 6  # of the limbs recalled are descended with: those whose areas cost least
_CLEARLY = 0.95  # of a pose's cost at most has one that takes its place
_COVERED = 1e-6  # areas that are as good as none
_ACCELERATION = 36.0  # standard deviation of a joint's between answers [m/s^2]: frames alone shake by 10 mm at 60 Hz


class BackwardPass:
    """Follows frames from the last to the first, and chooses between what is found and what was known.

    Args:
        descend: how a frame is fitted.
        linearise: the contours' equations.
        rooting: moves poses.
        points: what is kept from accelerating.
        rate: frames a second.
        areas: what contours do not see: a limb that hides in the trunk has no outline there, and so no error.
        limbs: the coordinates (coordinate,) of each.
        pairs_anew: for pairs of limbs; None where there are none.
    """

    def __init__(
        self,
        descend: DescendFrames,
        linearise: LineariseFrames,
        rooting: Rooting,
        points: MotionPoints,
        rate: float,
        areas: AreaCost,
        limbs: Sequence[np.ndarray],
        pairs_anew: PairsAnew | None = None,
    ) -> None:
        self._descend, self._linearise = descend, linearise
        self._rooting, self._points, self._rate = rooting, points, rate
        self._areas, self._limbs, self._pairs_anew = areas, limbs, pairs_anew

    def revised(self, frames: np.ndarray, known: RootedPoses, held: RootedPoses) -> RootedPoses:
        """For each frame the pose known or the one found on the way back: those that together cost least.

        Only another answer counts, in which a joint is elsewhere, and only where a stretch of frames so gains more by
        contours and areas than a frame's contours cost. Where there is none, ``known`` itself is returned.

        Args:
            frames: consecutive frames by their numbers.
            known: their poses.
            held: final poses of the frames before.
        """
        contour = self._linearise(frames, known)
        seen = contour.observed
        if not seen.any():
            return known
        back = self._followed_back(frames, known, contour.cost, seen)
        ahead, cost = known, contour.cost.copy()
        at = np.flatnonzero(self._apart(back, known))
        if len(at):  # compared where both lie at the bottom of what they cost
            descended, cost[at] = self._descend(frames[at], known[at])
            ahead = known.with_frames(at, self._rooting.refold(descended))
        another = self._apart(back, ahead)
        if not another.any():
            return known
        back = back.where(another, ahead)
        costs = np.zeros((2, len(held) + len(frames)))
        costs[:, len(held) :] = cost, self._linearise(frames, back).cost
        costs[:, len(held) + np.flatnonzero(another)] += self._uncovered(frames, ahead, back, another, cost)
        scale = self._rate**2 / (_ACCELERATION * np.sqrt(POINTS_A_JOINT))
        both = (held.followed_by(poses.interpolated(seen)) for poses in (ahead, back))
        place = np.stack([scale * self._points.at(poses).reshape(len(poses), -1) for poses in both])
        chosen = (least_costly(costs, place)[len(held) :] == 1) & another
        least = np.median(contour.cost[seen])
        for stretch in np.split(np.arange(len(frames)), np.flatnonzero(np.diff(chosen)) + 1):
            was, became = costs[:, len(held) + stretch].sum(axis=1)
            chosen[stretch] &= was - became > least
        return back.where(chosen, known) if chosen.any() else known

    def _uncovered(
        self, frames: np.ndarray, ahead: RootedPoses, back: RootedPoses, another: np.ndarray, cost: np.ndarray
    ) -> np.ndarray:
        """What both answers' areas cost (answer, frame), as much as the contours (frame,) of those known."""
        both = np.stack([self._areas(frames[another], poses[another]) for poses in (ahead, back)])
        scaled: np.ndarray = both * (cost[another].sum() / max(both[0].sum(), _COVERED))
        return scaled

    def _apart(self, one: RootedPoses, other: RootedPoses) -> np.ndarray:
        """(frame,) bool: whether a joint is elsewhere."""
        away = self._points.at(one) - self._points.at(other)
        apart: np.ndarray = np.linalg.norm(away[:, ::POINTS_A_JOINT], axis=2).max(axis=1) > _ANOTHER
        return apart

    def _followed_back(self, frames: np.ndarray, known: RootedPoses, cost: np.ndarray, seen: np.ndarray) -> RootedPoses:
        """Poses from the last frame that is seen to the first, each found from those after it.

        Where what is found costs clearly more than what is known (frame,), the way goes on from what is known.
        """
        rooting, way, end = self._rooting, known, int(np.flatnonzero(seen)[-1])
        last = before = rooting.leave(known[end : end + 1], np.zeros(3))[0]
        for f in reversed(range(end + 1)):
            if not seen[f]:
                continue
            if f < end:
                starts = rooting.enter(np.stack([last, last + _DAMPED * (last - before)]))
                starts = rooting.stepped(starts, np.zeros(len(rooting.searched)))  # within the limits
                found, its_cost = self._descend(np.full(STARTS, frames[f]), starts)
                best = int(np.argmin(its_cost))
                if its_cost[best] < _WORSE * cost[f]:
                    way = way.with_frames(np.array([f]), found[best : best + 1])
            there, recalled = way[f : f + 1], None
            if self._limbs and (end - f) % self._between == 0:
                recalled = self._recalled(int(frames[f]), there, known[seen])
            if self._pairs_anew and not recalled and (end - f) % (_RARELY * self._between) == 0:
                recalled = self._better(int(frames[f]), there, self._pairs_anew(int(frames[f]), there))
            before, last = last, rooting.leave(recalled or there, last[ROOT_ANGLES])[0]
            if recalled:
                before = last  # it did not come from there
                way = self._retaken(frames, way.with_frames(np.array([f]), recalled), f, seen)
        return rooting.refold(way)

    @property
    def _between(self) -> int:
        """Frames from one in which limbs are recalled to the next."""
        return max(1, round(_LOOKED_UP * self._rate))

    def _recalled(self, frame: int, there: RootedPoses, known: RootedPoses) -> RootedPoses | None:
        """A pose (1,) with a limb as it was in a frame that is known, if that clearly costs less.

        A limb that neither direction of time finds may have come back to where it was.
        """
        others = np.arange(len(known))[:: max(1, round(_RECALLED * self._rate))]
        pose = np.repeat(there.pose, len(others) * len(self._limbs), axis=0)
        for changed, (other, limb) in zip(pose, product(others, self._limbs), strict=True):
            changed[limb] = known.pose[other, limb]
        starts = RootedPoses(np.repeat(there.base, len(pose), axis=0), pose)
        areas = self._areas(np.full(len(pose), frame), starts)
        return self._better(frame, there, starts[np.argsort(areas, kind="stable")[:_TRIED]])

    def _retaken(self, frames: np.ndarray, way: RootedPoses, f: int, seen: np.ndarray) -> RootedPoses:
        """The way with poses found ahead from frame ``f``, where a limb was recalled, as far as they clearly cost less.

        Between two frames in which limbs are recalled one was lost.
        """
        for g in range(f + 1, min(f + self._between, len(frames))):
            better = self._better(int(frames[g]), way[g : g + 1], way[g - 1 : g]) if seen[g] else None
            if better is None:
                break
            way = way.with_frames(np.array([g]), better)
        return way

    def _better(self, frame: int, there: RootedPoses, starts: RootedPoses) -> RootedPoses | None:
        """The best pose (1,) that contours lead to from some, if it is another answer and clearly costs less."""
        starts = there.followed_by(starts)
        at = np.full(len(starts), frame)
        found, contours = self._descend(at, starts)
        found = self._rooting.refold(found)
        areas = self._areas(at, found)
        cost = contours * areas[0] + areas * contours[0]  # of the pose that is there both count alike
        limit = _CLEARLY * cost[0]
        cost[~self._apart(found, there)] = np.inf
        best = int(np.argmin(cost))
        return found[best : best + 1] if cost[best] < limit else None


def least_costly(cost: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Which of several answers each frame takes, so that all frames together cost least (Viterbi's algorithm).

    Second differences of places count by half their square: what jumps from one answer to another pays for it. They
    couple three frames; the best way to a frame is therefore known for each pair of answers to it and the one before.

    Args:
        cost: (answer, frame) of each by itself.
        place: (answer, frame, value) whose second differences have unit variance.

    Returns:
        (frame,) the answers' numbers; of equally good ones the first.
    """
    answers, frames = cost.shape
    if frames < 3:
        cheapest: np.ndarray = np.argmin(cost, axis=0)
        return cheapest
    first, second, third = place[:, None, None, :-2], place[None, :, None, 1:-1], place[None, None, :, 2:]
    jump = 0.5 * ((first - 2.0 * second + third) ** 2).sum(axis=-1)  # (answer two before, before, answer, frame)
    total = cost[:, 0, None] + cost[None, :, 1]  # (answer before, answer)
    came_from = np.zeros((frames, answers, answers), int)
    for f in range(2, frames):
        ways = total[:, :, None] + jump[..., f - 2]
        came_from[f] = ways.argmin(axis=0)
        total = ways.min(axis=0) + cost[:, f]
    chosen = np.zeros(frames, int)
    chosen[-2:] = np.unravel_index(np.argmin(total), total.shape)
    for f in reversed(range(2, frames)):
        chosen[f - 2] = came_from[f, chosen[f - 1], chosen[f]]
    return chosen
