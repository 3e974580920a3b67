"""How sure the poses of a clip are: standard deviations from the inverse of its normal matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.contour.clip import OVERLAP, WINDOW, ClipProblem
from mmocap_warp.contour.motion_penalty import MotionPenalty
from mmocap_warp.contour.motion_points import POINTS_A_JOINT
from mmocap_warp.contour.rooted import RootedPoses


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Standard deviations of each frame.

    Attributes:
        pose: (frame, coordinate) float64 [m, rad], of poses that have left their rooting; zero for what is held.
        joint: (frame, joint, 3) float64, of the joints' centres along the world's axes [m].
    """

    pose: np.ndarray
    joint: np.ndarray


def marginal_covariance(
    problem: ClipProblem, frames: np.ndarray, rooted: RootedPoses, acceleration: float
) -> np.ndarray:
    """Covariance of the searched coordinates of each frame, (frame, dof, dof), all others unknown too.

    It is the inverse of what contours, the penalty on accelerations and the joints' limits say; the limits keep what
    nothing shows, such as the twist of a straight limb, within what is possible.

    Args:
        problem: the clip's.
        frames: consecutive, by their numbers.
        rooted: their poses, solved.
        acceleration: of the penalty that they were solved under [m/s^2].
    """
    contour = problem.linearise(frames, rooted)
    points = problem.points.linearised(rooted)
    motion = MotionPenalty(acceleration, problem.rate).around(*points, contour.observed)
    return (motion.band + contour.with_prior(problem.rooting.anywhere**-2.0)).inverse_diagonal()


def uncertainty(problem: ClipProblem, rooted: RootedPoses, acceleration: float) -> Uncertainty:
    """Standard deviations of a clip's solved poses, in windows that overlap on both sides; arguments as above."""
    window, overlap = round(WINDOW * problem.rate), round(OVERLAP * problem.rate)
    pieces = []
    for first in range(0, len(rooted), window):
        before, after = max(first - overlap, 0), min(first + window + overlap, len(rooted))
        covariance = marginal_covariance(problem, np.arange(before, after), rooted[before:after], acceleration)
        own = slice(first - before, first - before + window)
        pieces.append(_deviations(problem, rooted[first : first + window], covariance[own]))
    return Uncertainty(
        np.concatenate([piece.pose for piece in pieces]), np.concatenate([piece.joint for piece in pieces])
    )


def _deviations(problem: ClipProblem, rooted: RootedPoses, covariance: np.ndarray) -> Uncertainty:
    """From the covariances (frame, dof, dof) of rooted coordinates."""
    searched = problem.rooting.searched
    pose = np.zeros_like(rooted.pose)
    pose[:, searched] = np.minimum(_sigma(problem.rooting.leaving(rooted), covariance), problem.rooting.anywhere)
    _, derivative = problem.points.linearised(rooted)
    centres = derivative[:, ::POINTS_A_JOINT]
    joint = _sigma(centres.reshape(len(rooted), -1, len(searched)), covariance)
    return Uncertainty(pose, joint.reshape(centres.shape[:3]))


def _sigma(derivative: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(frame, value) standard deviations of values with derivatives (frame, value, dof)."""
    sigma: np.ndarray = np.sqrt(((derivative @ covariance) * derivative).sum(axis=-1))
    return sigma
