"""A penalty on how the points of a body accelerate, in physical units."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from mmocap_warp.contour.clip.block_band import BlockBand
from mmocap_warp.contour.clip.motion_points import POINTS_A_JOINT

SPEED = 3.0
"""Standard deviation of a point's velocity [m/s]; it ends motion where frames show nothing, and else weighs nothing."""
FAR = 1.0
"""An error of this many standard deviations, shared by the frames around, pulls half as hard as its square would."""
UNSEEN = 14.4
"""Standard deviation of an acceleration that no frame shows [m/s^2], as large as that of hands and feet that move."""
USUAL_RATE = 60.0
"""Frames a second. At lower rates a difference of velocities is over longer, and varies with the root of the rate."""
AROUND = np.array([1, 4, 6, 4, 1]) / 16
"""Of errors of consecutive frames in the mean that says how far the middle one is."""
HELD = 2 + len(AROUND) // 2
"""How many frames back the penalty of a frame looks: an acceleration couples three, and their mean needs two more."""


@dataclass(frozen=True, eq=False)
class MotionCost:
    """The penalty around the poses of a clip."""

    cost: np.ndarray  # (frame,) float64, a frame's share: how it follows from those before it
    gradient: np.ndarray  # (frame, dof) float64, the direction in which the penalty falls; errors keep their weights
    band: BlockBand  # its matrix

    def without_first(self, frames: int) -> Self:
        """Of the later frames alone, with the first ones held where they are."""
        return type(self)(self.cost[frames:], self.gradient[frames:], self.band.without_first(frames))


@dataclass(frozen=True, eq=False)
class PenaltyTerms:
    """What a penalty makes of points, before their derivatives come in."""

    cost: np.ndarray  # (frame,) float64, a frame's share
    pull: np.ndarray  # (frame, joint, value) float64, the direction in which it falls, of the joint's points
    couplings: np.ndarray  # (3, frame, joint) float64, of frames 0, 1 and 2 apart, by the earlier one


class MotionPenalty:
    """What accelerations and velocities of the joints cost, in units of their standard deviations.

    A joint's error is the mean over its points. A small error costs half its square. A large one, of a blow or a
    landing, weighs less (``1 / (1 + square)``, after Cauchy), so that the speed of such a motion is kept. Whether an
    error is large is judged by its mean with the errors of the frames around: an arm that strikes accelerates the same
    way for some frames, noise does not. That needs frames that show the motion. Around a frame that shows nothing the
    square counts, or all motion would be squeezed into a few jerks; the standard deviation of an acceleration is at
    least ``UNSEEN`` there.

    Args:
        acceleration: standard deviation of a joint's acceleration at ``USUAL_RATE`` or more [m/s^2].
        rate: frames a second.
    """

    def __init__(self, acceleration: float, rate: float) -> None:
        acceleration *= min(rate / USUAL_RATE, 1.0) ** 0.5
        self._scale = {1: rate / SPEED, 2: rate**2 / acceleration}
        self._far_unseen = {1: 1.0, 2: max(1.0, (UNSEEN / acceleration) ** 2)}

    def around(self, points: np.ndarray, derivative: np.ndarray, seen: np.ndarray) -> MotionCost:
        """The penalty around points (frame, point, 3) with derivatives (frame, point, 3, dof) in frames ``seen``."""
        frames, _, _, dof = derivative.shape
        terms = self.terms(points, seen)
        slopes = derivative.reshape(frames, -1, dof) / np.sqrt(POINTS_A_JOINT)
        gradient = np.einsum("frd,fr->fd", slopes, terms.pull.reshape(frames, -1))
        across = np.swapaxes(slopes, 1, 2)
        by_row = np.repeat(terms.couplings, 3 * POINTS_A_JOINT, axis=2)[..., None]
        blocks = [across[o:] @ (by_row[o, : frames - o] * slopes[: frames - o]) for o in range(min(3, frames))]
        return MotionCost(terms.cost, gradient, BlockBand(blocks))

    def terms(self, points: np.ndarray, seen: np.ndarray) -> PenaltyTerms:
        """What :meth:`around` is made of, without derivatives."""
        frames, joints = len(points), points.shape[1] // POINTS_A_JOINT
        pull = np.zeros((frames, joints, 3 * POINTS_A_JOINT))
        couplings = np.zeros((3, frames, joints))
        for _, stencil, error, far, _ in self._errors(points, seen):
            rows = len(error)
            for i, weight in enumerate(stencil):
                pull[i : i + rows] -= (weight / far)[..., None] * error
                for j in range(i + 1):
                    couplings[i - j, j : j + rows] += weight * stencil[j] / far
        return PenaltyTerms(self.cost(points, seen), pull, couplings)

    def cost(self, points: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """(frame,) what :meth:`around` gives as each frame's cost, without what only a step needs."""
        cost = np.zeros(len(points))
        for order, _, error, far, all_seen in self._errors(points, seen):
            square = (error**2).sum(axis=2)  # (row, joint)
            # With this an error that is as those around it costs as much as Cauchy's function says, and never less.
            for_weight = np.where(all_seen, FAR**2 * (np.log(far) + 1.0 / far - 1.0), 0.0)
            cost[order:] += 0.5 * (square / far + for_weight).sum(axis=1)
        return cost

    def _errors(self, points: np.ndarray, seen: np.ndarray) -> Iterator[tuple[Any, ...]]:
        """Of velocities, then accelerations: the order, the stencil, errors (row, joint, value), how far (row, joint).

        Last comes whether each row's frames are all seen (row, 1).
        """
        place = points.reshape(len(points), points.shape[1] // POINTS_A_JOINT, -1) / np.sqrt(POINTS_A_JOINT)
        for order, scale in self._scale.items():
            rows = len(points) - order
            if rows <= 0:
                continue
            stencil = np.diff(np.eye(order + 1), n=order, axis=0)[0] * scale
            error = sum(weight * place[i : i + rows] for i, weight in enumerate(stencil))
            all_seen = np.all([seen[i : i + rows] for i in range(order + 1)], axis=0)[:, None]
            far = np.where(all_seen, 1.0 + (_shared(error) ** 2).sum(axis=2) / FAR**2, self._far_unseen[order])
            yield order, stencil, error, far, all_seen


def _shared(error: np.ndarray) -> np.ndarray:
    """Means (row, joint, value) of errors around each row; the first and the last row stand for those beyond."""
    beyond = len(AROUND) // 2
    padded = np.pad(error, [(beyond, beyond), (0, 0), (0, 0)], mode="edge")
    return np.asarray(sum(weight * padded[i : i + len(error)] for i, weight in enumerate(AROUND)))
