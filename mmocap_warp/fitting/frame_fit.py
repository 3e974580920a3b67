"""One frame's body and pose from a guess: by contours to the bottom, and limb by limb out of wrong basins."""

import copy
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.skeleton import ROOT_ANGLES, TRANSLATION, Skeleton
from mmocap_warp.contour.body_problem import body_problem, space_fitter
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.fitter import WIDE, ContourFitter
from mmocap_warp.contour.frame.rooted import Rooting
from mmocap_warp.fitting.standing_search import FirstFrame
from mmocap_warp.tracking.limb_pairs import Limb, like_limbs, limb_pairs, limbs, mirrored, places_exchanged

PRIOR = 0.3
"""How much nearer to the generic body a subject is expected than RestSpace's standard deviations say."""

_SPREAD_FACTOR = 2.5  # standard deviations that angles have when a recording starts, by which limbs are drawn
_POSE_PRIOR = 1e-4  # pull to the rest pose, per squared standard deviation of an angle
_DRAWS = 320  # draws of a limb's angles
_TRIED = 24  # best draws that are fitted roughly
_FINE = 6  # best of these that are fitted finely
_LIMB_STEPS = 5  # descent steps of a limb's fit
_LEAST_GAIN = 1e-3  # cost that a round over the limbs must save
PATIENCE = 2  # rounds in a row over the limbs that save less, before these stay where they are
_BODY_STEPS = 10  # descent steps of a fit of body and pose


@dataclass(frozen=True, eq=False)
class Guess:
    """A body in a pose."""

    beta: np.ndarray  # (parameter,) float64, the body in a :class:`RestSpace`
    root_base: np.ndarray  # (3, 3) float64, see :class:`~mmocap_warp.body.model.Subject`
    pose: np.ndarray  # (coordinate,) float64
    # share of the masks and of the body that the other does not cover (Eq. 5), with a weak prior on the pose
    cost: float = np.inf

    def orientation(self, skeleton: Skeleton) -> np.ndarray:
        """(3, 3) the world from the root's axes in the body: its columns are its left, its up, and where it faces."""
        rooting = Rooting(skeleton, self.root_base, skeleton.searched())
        return np.asarray(rooting.enter(self.pose[None]).base[0])


class FrameFit:
    """Improves guesses at a frame, by bodies of a space around the generic one.

    A limb that hides in the trunk has no outline there, and so no error that contours could show. But it leaves a part
    of the masks unexplained. So limbs are drawn at random within their limits and judged by areas.
    """

    def __init__(self, space: RestSpace, frame: FirstFrame, patience: int = PATIENCE) -> None:
        body, skeleton = space.body, space.body.skeleton
        self.space, self._patience = space, patience
        self._skeleton, self._vertex = skeleton, body.tracking_vertex
        self._limbs = limbs(skeleton)
        self._pairs, self._like = limb_pairs(skeleton), like_limbs(skeleton)
        self._random = np.random.default_rng(frame.seed)
        fitter = partial(space_fitter, space, frame.rig, [frame.observation], frame.device, frame.threads)
        self._rough, self._fine = fitter(matching=WIDE), fitter()
        self._rough_pose = fitter(candidates=_TRIED, parameters=0, matching=WIDE)
        self._fine_pose = fitter(candidates=_FINE, parameters=0)
        self._objective = frame.objective(body, np.eye(3), _DRAWS)
        prior = np.zeros(skeleton.coordinates)
        prior[ROOT_ANGLES.stop :] = _POSE_PRIOR / np.repeat(skeleton.spread[1:], 3) ** 2
        self._objective.prior.assign(prior)

    def polished(self, guess: Guess) -> Guess:
        """The guess with body and pose where the contours cost least; its cost is that of the areas there."""
        return self._solved(self._solved(guess, self._rough), self._fine)

    def _solved(self, guess: Guess, fitter: ContourFitter) -> Guess:
        problem = body_problem(fitter, self.space, guess.root_base, PRIOR)
        solution = problem.solved(np.zeros(1, int), problem.rooting.enter(guess.pose[None]), guess.beta, _BODY_STEPS)
        pose = problem.rooting.leave(solution.rooted, guess.pose[ROOT_ANGLES])
        self._take_body(solution.beta, guess.root_base)
        return Guess(solution.beta, guess.root_base, pose[0], float(self._objective.costs(pose)[0]))

    def split_random(self) -> np.random.Generator:
        """The random numbers of the next round over the limbs, which this one then goes on behind."""
        own = copy.deepcopy(self._random)
        for limb in self._limbs:
            self._random.uniform(size=(_DRAWS, len(limb.reach)))
            self._random.normal(size=(_DRAWS // 2, len(limb.reach)))
        return own

    def with_limbs_found(
        self, guess: Guess, rounds: int, random: np.random.Generator | None = None, most: float = np.inf
    ) -> Guess:
        """The guess with every limb where it explains the masks best, after at most ``rounds`` rounds over all.

        A guess that costs more than ``most`` after a round is given up.
        """
        fruitless, random = 0, random or self._random
        for _ in range(rounds):
            before = guess.cost
            self._take_body(guess.beta, guess.root_base)
            for limb in self._limbs:
                guess = self._better(guess, self._drawn(guess, limb, random))
            solved = self._solved(guess, self._fine)
            guess = solved if solved.cost < guess.cost else guess  # contours may pull a limb the wrong way
            fruitless = fruitless + 1 if guess.cost > before - _LEAST_GAIN else 0
            if fruitless == self._patience or guess.cost > most:
                break
        return guess

    def with_sides_swapped(self, guess: Guess) -> list[Guess]:
        """A guess for each pair of limbs, fitted from the mirrored pose of the pair."""
        exchanged = mirrored(self._skeleton, guess.pose)
        return [self._refitted(guess, _with_limbs(guess.pose, pair, exchanged)) for pair in self._pairs]

    def with_places_exchanged(self, guess: Guess) -> list[Guess]:
        """A guess for each pair of limbs, fitted from where each limb lies in the other's place: crossed arms uncross.

        In a body without pairs, any two limbs that are alike make a pair.
        """
        body = self.space.model(guess.beta)
        rooting = Rooting(self._skeleton, guess.root_base, self._skeleton.searched())
        points = MotionPoints(self._skeleton, body.joint_rest, rooting.searched)
        there = rooting.enter(guess.pose[None])
        guesses = []
        for one, other in self._pairs or self._like:
            exchanged = places_exchanged(there, (one.coordinates, other.coordinates), points, rooting)
            guesses.append(self._refitted(guess, rooting.leave(exchanged, guess.pose[ROOT_ANGLES])[0]))
        return guesses

    def _refitted(self, guess: Guess, pose: np.ndarray) -> Guess:
        """The guess, fitted from another pose (coordinate,)."""
        self._take_body(guess.beta, guess.root_base)
        return self.polished(replace(guess, pose=self._descended(self._rough_pose, guess, pose[None])[0]))

    def with_pairs_anew(self, guess: Guess) -> list[Guess]:
        """A guess for each pair of limbs, fitted from where both are at rest.

        Crossed arms may each explain the other's mask. Neither moving one of them nor exchanging their angles uncrosses
        them: mirrored, crossed arms are crossed.
        """
        rest = np.zeros_like(guess.pose)
        starts = [replace(guess, pose=_with_limbs(guess.pose, pair, rest)) for pair in self._pairs]
        return [self.with_limbs_found(self.polished(start), 1) for start in starts]

    def _drawn(self, guess: Guess, limb: Limb, random: np.random.Generator) -> np.ndarray:
        """The best poses (candidate, coordinate) among many whose limb is drawn.

        Half of the draws are anywhere within the limits. Half are nearer to the rest pose, the limb's last joint at
        rest: an arm with a folded hand explains the masks from elsewhere, and stays there while the hand is folded.
        One is what the other side's limb does.
        """
        reach, skeleton = limb.reach, self._skeleton
        low, high = np.clip(skeleton.coordinate_limits[reach], -np.pi, np.pi).T
        spread = _SPREAD_FACTOR * skeleton.spread[(reach - TRANSLATION) // 3]
        drawn = np.tile(guess.pose, (_DRAWS, 1))
        drawn[:, reach] = random.uniform(low, high, (_DRAWS, len(reach)))
        near = random.normal(0.0, spread, (_DRAWS // 2, len(reach)))
        drawn[: len(near), limb.coordinates] = np.clip(0.0, *skeleton.coordinate_limits[limb.coordinates].T)
        drawn[: len(near), reach] = np.clip(near, low, high)
        self._objective.hold(wp.array(guess.pose[None], dtype=wp.float32, device=self._objective.device), reach)
        best = drawn[np.argsort(self._objective.costs(drawn), kind="stable")[:_TRIED]]
        self._objective.release()
        best[-1, limb.coordinates] = mirrored(skeleton, guess.pose)[limb.coordinates]
        return best

    def _better(self, guess: Guess, starts: np.ndarray) -> Guess:
        """The guess, or the best fit from starts (candidate, coordinate) if that costs less."""
        near = self._descended(self._rough_pose, guess, starts)[:_FINE]
        candidates = self._descended(self._fine_pose, guess, near)
        pose, cost = candidates[0], float(self._objective.costs(candidates[:1])[0])
        return replace(guess, pose=pose, cost=cost) if cost < guess.cost else guess

    def _descended(self, fitter: ContourFitter, guess: Guess, starts: np.ndarray) -> np.ndarray:
        """Poses that contours lead to from starts (candidate, coordinate), with the guess's body, the best first."""
        count = len(starts)
        fitter.start_at(starts, np.tile(guess.root_base, (count, 1, 1)), np.zeros(count, np.int32))
        fitter.descend(count, _LIMB_STEPS)
        poses = fitter.descent.best.numpy()[:count].astype(float)
        return np.asarray(poses[np.argsort(self._objective.costs(poses), kind="stable")])

    def _take_body(self, beta: np.ndarray, root_base: np.ndarray) -> None:
        rest, joint_rest = self.space.at(beta, self._vertex)
        self._rough_pose.reshape(rest, joint_rest)
        self._fine_pose.reshape(rest, joint_rest)
        arrays = self._objective.body
        arrays.rest.assign(rest[None].astype(np.float32))
        arrays.joint_rest.assign(joint_rest[None].astype(np.float32))
        arrays.root_base.assign(root_base[None].astype(np.float32))


def by_turns(fits: Sequence[FrameFit], work: Callable[..., Guess], *guesses: Sequence[Any]) -> list[Guess]:
    """Work of a fit on each guess: a thread for each of the fits, which take them in turn."""
    items, count = list(zip(*guesses, strict=True)), len(fits)
    with ThreadPoolExecutor(count) as pool:
        done = list(pool.map(lambda i: [work(fits[i], *item) for item in items[i::count]], range(count)))
    return [done[place % count][place // count] for place in range(len(items))]


def _with_limbs(pose: np.ndarray, moved: tuple[Limb, ...], other: np.ndarray) -> np.ndarray:
    """A pose (coordinate,) with some limbs as another has them."""
    changed = pose.copy()
    for limb in moved:
        changed[limb.coordinates] = other[limb.coordinates]
    return changed
