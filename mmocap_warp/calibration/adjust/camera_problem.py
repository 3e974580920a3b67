"""Cameras, body and poses as one least-squares problem over the contours of some frames.

All frames share the parameters of the body, of the cameras and of their times; the poses are eliminated as in
:mod:`mmocap_warp.contour.body_problem`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.calibration.adjust.camera_changes import KINDS, OFFSET, POSITION, camera_jacobian, changed
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.body_problem import BodyProblem
from mmocap_warp.contour.frame.fitter import ContourFitter, MatchingConfig
from mmocap_warp.contour.frame.normal_equations import NormalEquations, ViewEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting
from mmocap_warp.masks.observation import Observation

_LENGTH_SIGMA = 0.002  # metres: standard deviation of a length that is known
LARGER = 1.0
"""Standard deviation of the margin by which a camera's masks are larger than what they show [px]."""


@dataclass(frozen=True, eq=False)
class KnownLength:
    """A length that is known, such as a person's height: it gives the scale.

    Attributes:
        metres: its value.
        at: from the body's parameters and the cameras' changes, the length [m] and its derivative by all of them.
    """

    metres: float
    at: Callable[[np.ndarray, np.ndarray], tuple[float, np.ndarray]]


@dataclass(frozen=True, eq=False)
class CameraProblem:
    """The problem of cameras and the person before them.

    Each camera's masks may be larger all around than what they show by a margin of its own, because segmentation
    depends on the background. Without this parameter the margin would look like a nearer camera or a longer lens.

    Attributes:
        fitter: of the space's body, with its parameters and with lenses, observing the frames.
        rig: the cameras that are in doubt, at the masks' size.
        lag: (camera,) how much later in its own frames each shows what happens, as far as is known [s].
        space: bodies around the one that is expected.
        rooting: moves poses; it searches the root's translation and all its angles.
        share: of the space's standard deviations, how far from the expected body the person may be.
        sigma: (camera, parameter) how far cameras may be from ``rig``; zero holds a parameter.
        known: lengths that are known.
        larger: standard deviation of each camera's margin [px]; 0 holds it.
    """

    fitter: ContourFitter
    rig: CameraRig
    lag: np.ndarray
    space: RestSpace
    rooting: Rooting
    share: float
    sigma: np.ndarray
    known: tuple[KnownLength, ...] = ()
    larger: float = LARGER

    def __post_init__(self) -> None:
        if not self.rooting.folds or not np.isin(np.arange(3), self.rooting.searched).all():
            raise ValueError("rooting must search the root's translation and all its angles")

    @property
    def free(self) -> np.ndarray:
        """(camera, parameter) bool: what is solved for."""
        return self.sigma > 0

    @property
    def _free_with_margin(self) -> np.ndarray:
        """(camera, parameter + 1) bool: the same, and in the last column whether the masks' margin is solved for."""
        return np.concatenate([self.free, np.full((len(self.rig), 1), self.larger > 0)], axis=1)

    @property
    def of_cameras(self) -> np.ndarray:
        """(parameter,) bool: which of the problem's parameters are cameras' changes, neither body nor margins."""
        free = self._free_with_margin
        margin = np.arange(free.shape[1]) == len(KINDS)
        return np.concatenate([np.zeros(len(self.space.names), bool), ~np.broadcast_to(margin, free.shape)[free]])

    def problem(self, velocity: np.ndarray) -> BodyProblem:
        """The problem whose parameters are the body's, then each camera's free ones and its margin.

        Args:
            velocity: (frame, dof) of the searched coordinates in the frames [m/s, rad/s].
        """
        own = np.concatenate([self.sigma, np.full((len(self.rig), 1), self.larger)], axis=1)
        sigma = np.concatenate([self.share * self.space.sigma, own[self._free_with_margin]])
        return BodyProblem(partial(self._linearise, velocity), self.rooting, np.zeros(len(sigma)), sigma)

    def start(self, beta: np.ndarray, change: np.ndarray) -> np.ndarray:
        """The problem's parameters for a body (parameter,) and changes of the cameras (camera, parameter)."""
        own = np.concatenate([change, np.zeros((len(change), 1))], axis=1)
        return np.concatenate([beta, own[self._free_with_margin]])

    def change(self, parameters: np.ndarray) -> np.ndarray:
        """(camera, parameter) the cameras' changes among the problem's parameters."""
        return self._unpack(parameters)[0]

    def _unpack(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The cameras' changes (camera, parameter), and their masks' margins (camera,) [px]."""
        own = np.zeros(self._free_with_margin.shape)
        own[self._free_with_margin] = parameters[len(self.space.names) :]
        return own[:, :-1], own[:, -1]

    def _linearise(
        self, velocity: np.ndarray, frames: np.ndarray, rooted: RootedPoses, parameters: np.ndarray
    ) -> NormalEquations:
        # Give the fitter the body and the cameras of these parameters.
        vertex, beta = self.space.body.tracking_vertex, parameters[: len(self.space.names)]
        change, larger = self._unpack(parameters)
        self.fitter.reshape(*self.space.at(beta, vertex))
        self.fitter.set_change(*self.space.basis(beta, vertex))
        self.fitter.set_cameras(changed(self.rig, change))
        self.fitter.set_larger(larger)
        # Each view's equations in steps of body and lens, and these steps by the camera's parameters.
        views = self._views(frames, rooted, velocity, self.lag + change[:, OFFSET])
        dof, shared = velocity.shape[1], velocity.shape[1] + len(beta)
        searched = self.rooting.searched
        root = int(np.searchsorted(searched, 0)), int(np.searchsorted(searched, ROOT_ANGLES.start))
        motion = camera_jacobian(self.rig, change, views.axes, views.origin, velocity, root)
        by_camera = np.zeros((*views.matrix.shape[:3], len(KINDS) + 1))
        by_camera[:, :, :dof, :-1], by_camera[:, :, shared:-1, :-1] = motion[:, :, :dof], motion[:, :, dof:]
        by_camera[:, :, -1, -1] = 1.0
        # All views together, and the lengths that are known.
        equations = _join_views(views, by_camera, shared, self._free_with_margin)
        for length in self.known:
            _add_length(equations, length, dof, beta, change, self._free_with_margin)
        return equations

    def _views(self, frames: np.ndarray, rooted: RootedPoses, velocity: np.ndarray, lag: np.ndarray) -> ViewEquations:
        """Each view against the body as it was when the view's images were taken, with ``lag`` (camera,) [s]."""
        first, *others = np.unique(lag)
        views = self._at_time(frames, rooted, -first * velocity)
        for seconds in others:
            views = self._at_time(frames, rooted, -seconds * velocity).where(lag == seconds, views)
        return views

    def _at_time(self, frames: np.ndarray, rooted: RootedPoses, step: np.ndarray) -> ViewEquations:
        return self.fitter.linearise_views(frames, self.rooting.stepped(rooted, step) if step.any() else rooted)


def camera_fitter(
    space: RestSpace,
    rig: CameraRig,
    observations: Sequence[Observation],
    matching: MatchingConfig,
    device: str,
    threads: int,
) -> ContourFitter:
    """A fitter of the space's body with lenses, which observes some frames, one candidate for each."""
    skeleton = space.body.skeleton
    fitter = ContourFitter(
        space.body, rig, skeleton.searched(), skeleton.coordinate_limits,
        candidates=len(observations), frames=len(observations), parameters=len(space.names), lens=True,
        matching=matching, device=device, threads=threads,
    )  # fmt: skip
    fitter.observe_all(observations)
    return fitter


def _join_views(views: ViewEquations, by_camera: np.ndarray, shared: int, own: np.ndarray) -> NormalEquations:
    """The equations of all views: poses and body first, then each camera's parameters that are solved for."""
    frames, cameras = views.cost.shape
    kinds = by_camera.shape[-1]
    size = shared + cameras * kinds
    matrix, gradient = np.zeros((frames, size, size)), np.zeros((frames, size))
    # All views share poses and body.
    matrix[:, :shared, :shared] = views.matrix[:, :, :shared, :shared].sum(axis=1)
    gradient[:, :shared] = views.gradient[:, :, :shared].sum(axis=1)
    # Each camera has a block of its own, and one beside poses and body.
    moved = views.matrix @ by_camera
    square = np.swapaxes(by_camera, 2, 3) @ moved
    toward = np.einsum("fkni,fkn->fki", by_camera, views.gradient)
    for k in range(cameras):
        place = slice(shared + k * kinds, shared + (k + 1) * kinds)
        matrix[:, :shared, place] = moved[:, k, :shared]
        matrix[:, place, :shared] = np.swapaxes(moved[:, k, :shared], 1, 2)
        matrix[:, place, place] = square[:, k]
        gradient[:, place] = toward[:, k]
    # Only parameters that are solved for stay.
    kept = np.concatenate([np.ones(shared, bool), own.ravel()])
    return NormalEquations(matrix[:, kept][:, :, kept], gradient[:, kept], views.cost.sum(axis=1))


def _add_length(
    equations: NormalEquations, length: KnownLength, dof: int, beta: np.ndarray, change: np.ndarray, own: np.ndarray
) -> None:
    """Add a known length to the first frame's equations, in place; it counts once for all frames."""
    value, derivative = length.at(beta, change)
    by_camera = np.concatenate([derivative[len(beta) :].reshape(change.shape), np.zeros((len(change), 1))], axis=1)
    row = np.concatenate([np.zeros(dof), derivative[: len(beta)], by_camera[own]]) / _LENGTH_SIGMA
    error = (length.metres - value) / _LENGTH_SIGMA
    equations.matrix[0] += np.outer(row, row)
    equations.gradient[0] += row * error
    equations.cost[0] += 0.5 * error**2


def known_height(space: RestSpace, metres: float) -> KnownLength:
    """The person's height, from the soles to the top of the head in the bind pose."""

    def at(beta: np.ndarray, change: np.ndarray) -> tuple[float, np.ndarray]:
        rest, _ = space.at(beta)
        top, bottom = int(rest[:, 1].argmax()), int(rest[:, 1].argmin())
        by_shape, _ = space.basis(beta, np.array([top, bottom]))
        derivative = np.concatenate([by_shape[:, 0, 1] - by_shape[:, 1, 1], np.zeros(change.size)])
        return float(rest[top, 1] - rest[bottom, 1]), derivative

    return KnownLength(metres, at)


def known_distance(rig: CameraRig, one: int, other: int, metres: float) -> KnownLength:
    """The distance between the centres of two cameras of a rig."""

    def at(beta: np.ndarray, change: np.ndarray) -> tuple[float, np.ndarray]:
        centres = changed(rig, change).centres
        way = centres[one] - centres[other]
        derivative = np.zeros(change.shape)
        distance = float(np.linalg.norm(way))
        derivative[one, POSITION] = rig.R[one] @ way / distance
        derivative[other, POSITION] = -rig.R[other] @ way / distance
        return distance, np.concatenate([np.zeros(len(beta)), derivative.ravel()])

    return KnownLength(metres, at)
