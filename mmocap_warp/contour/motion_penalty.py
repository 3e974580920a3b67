"""A penalty on how the points of a body accelerate, in physical units: the same at any frame rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.contour.block_band import BlockBand
from mmocap_warp.contour.motion_points import POINTS_A_JOINT

SPEED = 3.0
"""Standard deviation of a point's velocity [m/s]; it ends motion where frames show nothing, and else weighs nothing."""


@dataclass(frozen=True, eq=False)
class MotionCost:
    """The penalty around the poses of a clip.

    Attributes:
        cost: (frame,) float64, a frame's share: how it follows from those before it.
        gradient: (frame, dof) float64, the direction in which the penalty falls.
        band: its matrix.
    """

    cost: np.ndarray
    gradient: np.ndarray
    band: BlockBand

    def without_first(self, frames: int) -> MotionCost:
        """Of the later frames alone, with the first ones held where they are."""
        return MotionCost(self.cost[frames:], self.gradient[frames:], self.band.without_first(frames))


class MotionPenalty:
    """Half the squares of accelerations and velocities of the points, in units of their standard deviations.

    The points of a joint count as one: each has a quarter of the weight.

    Args:
        acceleration: standard deviation of a point's acceleration, by coordinate [m/s^2].
        rate: frames a second.
    """

    def __init__(self, acceleration: float, rate: float) -> None:
        self._scale = {1: rate / SPEED, 2: rate**2 / acceleration}

    def around(self, points: np.ndarray, derivative: np.ndarray) -> MotionCost:
        """The penalty around points (frame, point, 3) with derivatives (frame, point, 3, dof)."""
        frames, _, _, dof = derivative.shape
        by_frame = points.reshape(frames, -1) / np.sqrt(POINTS_A_JOINT)
        rows = derivative.reshape(frames, -1, dof) / np.sqrt(POINTS_A_JOINT)
        pull = np.zeros_like(by_frame)
        cost = np.zeros(frames)
        couplings = np.zeros((3, frames))  # of frames 0, 1 and 2 apart: (offset, earlier frame)
        for order, scale in self._scale.items():
            if frames <= order:
                continue
            stencil = np.diff(np.eye(order + 1), n=order, axis=0)[0] * scale
            count = frames - order
            error = sum(weight * by_frame[i : i + count] for i, weight in enumerate(stencil))
            cost[order:] += 0.5 * (error**2).sum(axis=1)
            for i, weight in enumerate(stencil):
                pull[i : i + count] -= weight * error
                for j in range(i + 1):
                    couplings[i - j, j : j + count] += weight * stencil[j]
        gradient = np.einsum("fpd,fp->fd", rows, pull)
        across = np.swapaxes(rows, 1, 2)
        apart = range(min(3, frames))
        blocks = [across[o:] @ rows[: frames - o] * couplings[o, : frames - o, None, None] for o in apart]
        return MotionCost(cost, gradient, BlockBand(blocks))
