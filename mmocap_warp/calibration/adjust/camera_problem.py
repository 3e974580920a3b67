"""Cameras, body and poses as one least-squares problem over the contours of some frames.

All frames share the parameters of the body, of the cameras and of their times; the poses are eliminated as in
:mod:`mmocap_warp.contour.body_problem`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.calibration.adjust.camera_changes import KINDS, OFFSET, POSITION, camera_jacobian, changed
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.body_problem import BodyProblem, space_fitter
from mmocap_warp.contour.frame.fitter import ContourFitter, MatchingConfig
from mmocap_warp.contour.frame.normal_equations import NormalEquations, ViewEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting
from mmocap_warp.masks.observation import Observation

_MARGIN = ((0, 0), (0, 1))  # how arrays (camera, parameter) are padded: the margin of a camera's masks comes last
_LENGTH_SIGMA = 0.002  # metres: standard deviation of a length that is known
_LARGER = 1.0  # pixels: standard deviation of the margin by which a camera's masks are larger than what they show

KnownLength = Callable[[np.ndarray, np.ndarray], tuple[float, np.ndarray, np.ndarray]]
"""A length that is known, such as a person's height: it gives the scale.

From the body's parameters (parameter,) and the cameras' changes (camera, parameter) it says by how much the length is
too short [m], and gives the length's derivatives by both.
"""


@dataclass(frozen=True, eq=False)
class CameraSolution:
    """Cameras, body and poses of one least-squares problem."""

    change: np.ndarray  # (camera, parameter) of the cameras
    beta: np.ndarray  # (parameter,) of the body
    rooted: RootedPoses  # the poses
    free: np.ndarray  # (camera, parameter) bool: what was solved for
    # (free parameter, free parameter) of the cameras, as large as a single frame would leave it, because body and masks
    # are wrong in all frames alike.
    covariance: np.ndarray
    cost: float  # mean cost of the contours in a frame
    larger: np.ndarray | None = None  # (camera,) margins of the masks [px]


@dataclass(frozen=True, eq=False)
class CameraProblem:
    """The problem of cameras and the person before them.

    Each camera's masks may be larger all around than what they show by a margin of its own, because segmentation
    depends on the background. Without this parameter the margin would look like a nearer camera or a longer lens.
    """

    rig: CameraRig  # the cameras that are in doubt, at the masks' size
    lag: np.ndarray  # (camera,) how much later in its own frames each shows what happens, as far as is known [s]
    space: RestSpace  # bodies around the one that is expected
    rooting: Rooting  # moves poses; it searches the root's translation and all its angles
    share: float  # of the space's standard deviations, how far from the expected body the person may be
    sigma: np.ndarray  # (camera, parameter) how far cameras may be from ``rig``; zero holds a parameter
    known: tuple[KnownLength, ...] = ()  # lengths that are known
    larger: float = _LARGER  # standard deviation of each camera's margin [px]; 0 holds it

    @property
    def _own(self) -> np.ndarray:
        """(camera, parameter + 1) standard deviations of each camera's parameters and, last, of its masks' margin."""
        return np.pad(self.sigma, _MARGIN, constant_values=self.larger)

    def solved(
        self,
        observations: Sequence[Observation],
        rooted: RootedPoses,
        velocity: np.ndarray,
        beta: np.ndarray,
        change: np.ndarray,
        stages: Sequence[tuple[MatchingConfig, int]],
        device: str,
        threads: int,
        larger: np.ndarray | None = None,
    ) -> CameraSolution:
        """The solution for some frames.

        Args:
            observations: of the frames.
            rooted: their poses to start from.
            velocity: (frame, dof) of the searched coordinates in the frames [m/s, rad/s].
            beta: (parameter,) of the body to start from.
            change: (camera, parameter) of the cameras to start from.
            stages: how contours are matched, and the steps of each stage; 0 for a single step that nothing limits.
            device: the Warp device.
            threads: CPU threads.
            larger: (camera,) margins of the masks to start from [px].
        """
        # The parameters are the body's, then each camera's free ones and its margin.
        own = self._own
        sigma = np.concatenate([self.share * self.space.sigma, own[own > 0]])
        start = np.column_stack([change, np.zeros(len(change)) if larger is None else larger])
        parameters = np.concatenate([beta, start[own > 0]])
        # One stage after the other, because a fitter holds the masks' distances.
        for matching, steps in stages:
            fitter = space_fitter(self.space, self.rig, observations, device, threads, matching=matching, lens=True)
            problem = BodyProblem(partial(self._linearise, fitter, velocity), self.rooting, np.zeros(len(sigma)), sigma)
            at = np.arange(len(rooted)), rooted, parameters
            solution = problem.solved(*at, steps) if steps else problem.stepped(*at)
            rooted, parameters = solution.rooted, solution.beta
        # The covariance of the cameras' parameters, without body and margins.
        of_cameras = len(beta) + np.flatnonzero(np.nonzero(own > 0)[1] < len(KINDS))
        change, larger = self._unpack(parameters)
        covariance = len(observations) * solution.covariance[np.ix_(of_cameras, of_cameras)]
        beta, cost = parameters[: len(beta)], float(solution.cost.mean())
        return CameraSolution(change, beta, rooted, self.sigma > 0, covariance, cost, larger)

    def _unpack(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The cameras' changes (camera, parameter), and their masks' margins (camera,) [px]."""
        own = np.zeros_like(self._own)
        own[self._own > 0] = parameters[len(self.space.names) :]
        return own[:, :-1], own[:, -1]

    def _linearise(
        self,
        fitter: ContourFitter,
        velocity: np.ndarray,
        frames: np.ndarray,
        rooted: RootedPoses,
        parameters: np.ndarray,
    ) -> NormalEquations:
        # Give the fitter the body and the cameras of these parameters.
        vertex, beta = self.space.body.tracking_vertex, parameters[: len(self.space.names)]
        change, larger = self._unpack(parameters)
        fitter.reshape(*self.space.at(beta, vertex))
        fitter.set_change(*self.space.basis(beta, vertex))
        fitter.set_cameras(changed(self.rig, change))
        fitter.set_larger(larger)

        def views_at(seconds: float) -> ViewEquations:
            step = -seconds * velocity
            return fitter.linearise_views(frames, self.rooting.stepped(rooted, step) if step.any() else rooted)

        # Each view's equations, against the body as it was when the view's images were taken.
        lag = self.lag + change[:, OFFSET]
        first, *others = np.unique(lag)
        views = views_at(first)
        for seconds in others:
            views = views_at(seconds).where((lag == seconds)[None], views)
        # They are in steps of body and lens; these steps by the camera's parameters.
        dof, shared = velocity.shape[1], velocity.shape[1] + len(beta)
        searched = self.rooting.searched
        root = int(np.searchsorted(searched, 0)), int(np.searchsorted(searched, ROOT_ANGLES.start))
        motion = camera_jacobian(self.rig, change, views.axes, views.origin, velocity, root)
        by_camera = np.zeros((*views.matrix.shape[:3], len(KINDS) + 1))
        by_camera[:, :, :dof, :-1], by_camera[:, :, shared:-1, :-1] = motion[:, :, :dof], motion[:, :, dof:]
        by_camera[:, :, -1, -1] = 1.0
        # All views together, and the lengths that are known: each counts once for all frames, in the first.
        free = self._own > 0
        equations = _join_views(views, by_camera, shared, free)
        for length in self.known:
            short, by_body, by_change = length(beta, change)
            row = np.concatenate([np.zeros(dof), by_body, np.pad(by_change, _MARGIN)[free]]) / _LENGTH_SIGMA
            error = short / _LENGTH_SIGMA
            equations.matrix[0] += np.outer(row, row)
            equations.gradient[0] += row * error
            equations.cost[0] += 0.5 * error**2
        return equations


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
        matrix[:, place, place], gradient[:, place] = square[:, k], toward[:, k]
    kept = np.concatenate([np.ones(shared, bool), own.ravel()])
    return NormalEquations(matrix[:, kept][:, :, kept], gradient[:, kept], views.cost.sum(axis=1))


def known_height(space: RestSpace, metres: float) -> KnownLength:
    """The person's height, from the soles to the top of the head in the bind pose."""

    def at(beta: np.ndarray, change: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        rest, _ = space.at(beta)
        top, bottom = int(rest[:, 1].argmax()), int(rest[:, 1].argmin())
        by_shape, _ = space.basis(beta, np.array([top, bottom]))
        height = float(rest[top, 1] - rest[bottom, 1])
        return metres - height, by_shape[:, 0, 1] - by_shape[:, 1, 1], np.zeros(change.shape)

    return at


def known_distance(rig: CameraRig, one: int, other: int, metres: float) -> KnownLength:
    """The distance between the centres of two cameras of a rig."""

    def at(beta: np.ndarray, change: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        centres = changed(rig, change).centres
        way = centres[one] - centres[other]
        derivative = np.zeros(change.shape)
        distance = float(np.linalg.norm(way))
        derivative[one, POSITION] = rig.R[one] @ way / distance
        derivative[other, POSITION] = -rig.R[other] @ way / distance
        return metres - distance, np.zeros(len(beta)), derivative

    return at
