"""How sure the poses of a clip are: standard deviations from the inverse of its normal matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.contour.clip import OVERLAP, ClipProblem, SolvedWindow
from mmocap_warp.contour.motion_penalty import MotionPenalty
from mmocap_warp.contour.motion_points import POINTS_A_JOINT
from mmocap_warp.contour.normal_equations import NormalEquations
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


class Deviations:
    """Standard deviations of a clip's frames, window by window as they are solved.

    Args:
        problem: the clip's.
        acceleration: of the penalty that it is solved under [m/s^2].
    """

    def __init__(self, problem: ClipProblem, acceleration: float) -> None:
        self._problem, self._acceleration = problem, acceleration
        self._before: tuple[RootedPoses, NormalEquations] | None = None  # the frames before, which say something too

    def of(self, window: SolvedWindow) -> Uncertainty:
        """Those of the next window's final frames."""
        rooted, contour = window.rooted, window.contour
        first = 0
        if self._before:
            first = len(self._before[0])
            rooted, contour = self._before[0].followed_by(rooted), self._before[1].followed_by(contour)
        covariance = marginal_covariance(self._problem, contour, rooted, self._acceleration)
        own = slice(first, first + window.final)
        kept = slice(max(own.stop - round(OVERLAP * self._problem.rate), 0), own.stop)
        self._before = rooted[kept], contour[kept]
        return _deviations(self._problem, rooted[own], covariance[own])


def marginal_covariance(
    problem: ClipProblem, contour: NormalEquations, rooted: RootedPoses, acceleration: float
) -> np.ndarray:
    """Covariance of the searched coordinates of each frame, (frame, dof, dof), all others unknown too.

    It is the inverse of what contours, the penalty on accelerations and the joints' limits say; the limits keep what
    nothing shows, such as the twist of a straight limb, within what is possible.

    Args:
        problem: the clip's.
        contour: what the contours of consecutive frames say.
        rooted: their poses, solved.
        acceleration: of the penalty that they were solved under [m/s^2].
    """
    points = problem.points.linearised(rooted)
    motion = MotionPenalty(acceleration, problem.rate).around(*points, contour.observed)
    return (motion.band + contour.with_prior(problem.rooting.anywhere**-2.0)).inverse_diagonal()


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
