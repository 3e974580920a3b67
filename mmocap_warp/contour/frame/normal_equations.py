"""What contours say about each frame, as the solvers of a clip and of a body take it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mmocap_warp.contour.frame.rooted import FrameArrays, RootedPoses

_ROUNDING = 1e-6  # share of the diagonal that is added: more than rounding takes off sums in single precision


@dataclass(frozen=True, eq=False)
class NormalEquations(FrameArrays):
    """A quadratic model of each frame's cost around its pose, and around the body where that is sought too.

    ``cost(step) = cost - gradient @ step + step @ matrix @ step / 2``, where a step has the searched coordinates
    [m, rad], then the body's parameters. Costs are those of errors in units of their standard deviation, halved: the
    inverse of ``matrix`` is a covariance.
    """

    matrix: np.ndarray  # (frame, n, n) float64, symmetric, positive semidefinite; zero where a frame shows nothing
    gradient: np.ndarray  # (frame, n) float64, the direction in which the cost falls
    cost: np.ndarray  # (frame,) float64

    @property
    def observed(self) -> np.ndarray:
        """(frame,) bool: the frames that show anything."""
        return np.asarray(np.trace(self.matrix, axis1=1, axis2=2) > 0)

    def with_prior(self, information: np.ndarray) -> np.ndarray:
        """(frame, m, m) matrices that can be inverted, with a prior's information (m,) about the first coordinates."""
        dof = len(information)
        matrix = self.matrix[:, :dof, :dof]
        rounding = _ROUNDING * np.einsum("fdd->fd", matrix)
        return np.asarray(matrix + (information + rounding)[:, :, None] * np.eye(dof))

    def plus(self, other: NormalEquations) -> NormalEquations:
        """What both say."""
        return NormalEquations(self.matrix + other.matrix, self.gradient + other.gradient, self.cost + other.cost)

    def of_seen(self, seen: np.ndarray) -> NormalEquations:
        """These, where frames that are not ``seen`` (frame,) bool say nothing."""
        return NormalEquations(self.matrix * seen[:, None, None], self.gradient * seen[:, None], self.cost * seen)


@dataclass(frozen=True, eq=False)
class ViewEquations(FrameArrays):
    """As :class:`NormalEquations`, of each view apart, with what a rigid motion of the whole body is for the root."""

    # (frame, camera, n, n) float64; n are the searched coordinates, the body's parameters, then the lens of the camera
    # itself: the logarithm of its focal lengths, its principal point, its radial distortion k1, and by how much its
    # masks are larger than what they show [px]
    matrix: np.ndarray
    gradient: np.ndarray  # (frame, camera, n) float64
    cost: np.ndarray  # (frame, camera) float64
    axes: np.ndarray  # (frame, camera, 3, 3) float64, in the columns: what the root's angles turn about, in the world
    origin: np.ndarray  # (frame, camera, 3) float64, the root joint in the world [m]

    @property
    def together(self) -> NormalEquations:
        """Those of all views, which have no columns of their own."""
        return NormalEquations(self.matrix.sum(axis=1), self.gradient.sum(axis=1), self.cost.sum(axis=1))


LineariseFrames = Callable[[np.ndarray, RootedPoses], NormalEquations]
"""The equations of frames, by their numbers (frame,) and their poses; n is the number of searched coordinates."""

LineariseViews = Callable[[np.ndarray, RootedPoses], ViewEquations]
"""As above, each view apart, where the body's parameters follow the searched coordinates in n."""

LineariseBody = Callable[[np.ndarray, RootedPoses, np.ndarray], NormalEquations]
"""As above for a body of parameters (parameter,), which follow the searched coordinates in n."""
