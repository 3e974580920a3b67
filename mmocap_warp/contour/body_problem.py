"""A body from several frames: its parameters and the frames' poses as one least-squares problem."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.frame.descent import LARGEST_STEP, Trust, descend
from mmocap_warp.contour.frame.fitter import ContourFitter
from mmocap_warp.contour.frame.normal_equations import LineariseBody, NormalEquations
from mmocap_warp.contour.frame.rooted import Neighbours, RootedPoses, Rooting
from mmocap_warp.masks.observation import Observation

LARGEST_CHANGE = 3.0
"""No parameter moves further in a step, in its prior standard deviations: their units are as different as they are."""


@dataclass(frozen=True, eq=False)
class BodySolution:
    """A body and the poses it was found in."""

    beta: np.ndarray  # (parameter,) float64
    covariance: np.ndarray  # (parameter, parameter) float64, with the poses unknown too
    rooted: RootedPoses  # the poses
    cost: np.ndarray  # (frame,) float64, what the contours cost


@dataclass(frozen=True, eq=False)
class BodyProblem:
    """What is known of a body."""

    linearise: LineariseBody  # the contours' equations
    rooting: Rooting  # moves poses
    generic: np.ndarray  # (parameter,) the body that is expected before anything is seen
    sigma: np.ndarray  # (parameter,) how far it is from that, as standard deviations
    # how many of the first searched coordinates are the same in all frames: those of a base that is fixed
    still: int = 0

    def solved(self, frames: np.ndarray, rooted: RootedPoses, beta: np.ndarray, steps: int = 12) -> BodySolution:
        """The body and its poses in frames by their numbers, from poses and parameters to start with."""
        descent, start = _Descent(self, frames), _State(rooted, np.asarray(beta, float))
        state, equations = descend(descent, start, descent.linearised(start), steps)
        anywhere = self.rooting.anywhere**-2.0
        information = equations.without_poses(equations.contour.with_prior(anywhere[self.still :])).matrix
        base = np.arange(self.still)
        information[base, base] += anywhere[: self.still]
        covariance = np.linalg.inv(information)[self.still :, self.still :]
        return BodySolution(state.beta, covariance, state.rooted, equations.contour.cost)

    def stepped(self, frames: np.ndarray, rooted: RootedPoses, beta: np.ndarray) -> BodySolution:
        """The parameters after a single step that nothing limits, for some that move no outline; poses stay."""
        equations = _Descent(self, frames).linearised(_State(rooted, beta))
        reduced = equations.without_poses(equations.contour.with_prior(self.rooting.anywhere**-2.0))
        covariance = np.linalg.inv(reduced.matrix)
        return BodySolution(beta + covariance @ reduced.gradient, covariance, rooted, equations.contour.cost)


def space_fitter(
    space: RestSpace, rig: CameraRig, observations: Sequence[Observation], device: str, threads: int, **others: Any
) -> ContourFitter:
    """A fitter of a space's body that observes frames, one candidate for each unless ``others``, its own, say more."""
    skeleton, frames = space.body.skeleton, len(observations)
    settings: dict[str, Any] = {"candidates": frames, "parameters": len(space.names), **others}
    fitter = ContourFitter(
        space.body, rig, skeleton.searched(), skeleton.coordinate_limits,
        frames=frames, device=device, threads=threads, **settings,
    )  # fmt: skip
    fitter.observe_all(observations)
    return fitter


def body_problem(
    fitter: ContourFitter,
    space: RestSpace,
    root_base: np.ndarray,
    share: float,
    neighbours: Neighbours | None = None,
    still: int = 0,
) -> BodyProblem:
    """The problem of a body in a rest space, seen in the frames that a fitter observes.

    Args:
        fitter: of the space's body, with as many parameters as the space.
        space: bodies around the one that is expected.
        root_base: (3, 3), see :class:`~mmocap_warp.body.model.Subject`.
        share: of the space's standard deviations, how far from the expected body a subject may be.
        neighbours: the frames' neighbours, for late views; their poses stay as they are.
        still: of the searched coordinates, how many of the first are the same in all frames.
    """
    body = space.body

    def linearise(frames: np.ndarray, rooted: RootedPoses, beta: np.ndarray) -> NormalEquations:
        fitter.reshape(*space.at(beta, body.tracking_vertex))
        fitter.set_change(*space.basis(beta, body.tracking_vertex))
        return fitter.linearise(frames, rooted, neighbours[frames] if neighbours else None)

    rooting = Rooting(body.skeleton, root_base, body.skeleton.searched())
    return BodyProblem(linearise, rooting, np.zeros(len(space.names)), share * space.sigma, still)


@dataclass(frozen=True, eq=False)
class _State:
    """Poses and a body."""

    rooted: RootedPoses
    beta: np.ndarray


@dataclass(frozen=True, eq=False)
class _Reduced:
    """What all frames share, a base that stands still and the body, once each frame's pose follows it; and how."""

    matrix: np.ndarray  # (parameter, parameter), those of the base first
    gradient: np.ndarray  # (parameter,)
    pose_step: np.ndarray  # (frame, dof) with the body as it is
    pose_by_body: np.ndarray  # (frame, dof, parameter) what a step of the body takes from it


@dataclass(frozen=True, eq=False)
class _Equations:
    """The problem around a state. ``prior`` is the matrix, the gradient and the cost of the body's distance."""

    contour: NormalEquations
    prior: tuple[np.ndarray, np.ndarray, float]

    @property
    def cost(self) -> np.ndarray:
        return self.contour.cost

    @property
    def shared_cost(self) -> float:
        return self.prior[2]

    def without_poses(self, pose_matrix: np.ndarray) -> _Reduced:
        """Schur's complement: eliminates the poses, whose matrices ``pose_matrix`` (frame, dof, dof) are."""
        dof = pose_matrix.shape[1]
        across = self.contour.matrix[:, :dof, dof:]
        pose_gradient, gradient = self.contour.gradient[:, :dof], self.contour.gradient[:, dof:]
        solved = np.linalg.solve(pose_matrix, np.concatenate([pose_gradient[:, :, None], across], axis=2))
        pose_step, pose_by_body = solved[:, :, 0], solved[:, :, 1:]
        own = self.contour.matrix[:, dof:, dof:] - np.swapaxes(across, 1, 2) @ pose_by_body
        followed = gradient - np.einsum("fdp,fd->fp", across, pose_step)
        return _Reduced(self.prior[0] + own.sum(axis=0), self.prior[1] + followed.sum(axis=0), pose_step, pose_by_body)


class _Descent:
    """Steps of poses and body; see :class:`mmocap_warp.contour.frame.descent.Problem`."""

    def __init__(self, problem: BodyProblem, frames: np.ndarray) -> None:
        self._problem, self._frames = problem, frames
        is_length, self._still = problem.rooting.is_length, problem.still
        self._trust, self._trust_of_base = Trust(is_length[self._still :]), Trust(is_length[: self._still])

    def linearised(self, state: _State) -> _Equations:
        information, off = self._problem.sigma**-2.0, state.beta - self._problem.generic
        base = np.zeros(self._still)  # is pulled nowhere
        matrix, pull = np.diag(np.concatenate([base, information])), np.concatenate([base, -information * off])
        cost = 0.5 * float(information @ off**2)
        contour = self._problem.linearise(self._frames, state.rooted, state.beta)
        return _Equations(self._base_with_body(contour) if self._still else contour, (matrix, pull, cost))

    def _base_with_body(self, contour: NormalEquations) -> NormalEquations:
        """The equations with the coordinates of a fixed base moved behind those of each frame."""
        still, dof = self._still, len(self._problem.rooting.searched)
        order = np.concatenate([np.arange(still, dof), np.arange(still), np.arange(dof, contour.gradient.shape[1])])
        return NormalEquations(contour.matrix[:, order][:, :, order], contour.gradient[:, order], contour.cost)

    def stepped(self, state: _State, equations: _Equations, damping: np.ndarray) -> tuple[_State, float]:
        trust = self._trust.matrix(equations.contour, damping)
        dof = trust.shape[1]
        reduced = equations.without_poses(equations.contour.matrix[:, :dof, :dof] + trust)
        # Frames that were refused hold the body back too, by as much of its own scale.
        pull = (damping.max() - 1) * np.diag(np.diag(reduced.matrix))
        pull[: self._still, : self._still] += self._trust_of_base.alone(damping.max())
        change = np.linalg.solve(reduced.matrix + pull, reduced.gradient)
        most = np.concatenate([np.full(self._still, LARGEST_STEP), LARGEST_CHANGE * self._problem.sigma])
        change = np.clip(change, -most, most)
        step = np.clip(reduced.pose_step - reduced.pose_by_body @ change, -LARGEST_STEP, LARGEST_STEP)
        step = np.concatenate([np.tile(change[: self._still], (len(step), 1)), step], axis=1)
        moved = _State(self._problem.rooting.stepped(state.rooted, step), state.beta + change[self._still :])
        return moved, float(max(np.abs(step).max(), np.abs(change).max(initial=0.0)))
