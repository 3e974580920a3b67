"""How sure the poses of a clip are: standard deviations from the inverse of its normal matrix, and from its residuals.

They have two parts. Noise differs from frame to frame, and is what the clip's normal matrix tells of. The other part is
the same in all frames, and no number of frames averages it out: the body's shape, how its parts are turned in the bind
pose, which no outline shows, and cameras that disagree.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.bind_pose import bind_pose_turns
from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.rotations import transposed
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.contour.clip.clip_problem import OVERLAP, ClipProblem, SolvedWindow
from mmocap_warp.contour.clip.device_band import Motion
from mmocap_warp.contour.clip.motion_penalty import MotionPenalty
from mmocap_warp.contour.clip.motion_points import POINTS_A_JOINT
from mmocap_warp.contour.frame.normal_equations import LineariseViews, NormalEquations
from mmocap_warp.contour.frame.rooted import FrameArrays, RootedPoses

NOISE = 1.3  # measured deviations from frame to frame, in units of those that the normal matrix predicts
SYSTEMATIC = 0.7  # those that all frames share, in units of what the body's family and the residuals predict
USUAL_MISFIT = 0.011  # root mean square of contours' distances at which deviations are as large as predicted [m]
MOST_SYSTEMATIC = 2.0  # by how much the systematic share of residuals grows at most, in usual ones
BODY_INTERVAL = 0.2  # seconds between the frames in which the body's share of the uncertainty is computed


@dataclass(frozen=True, eq=False)
class Uncertainty(FrameArrays):
    """Standard deviations of each frame."""

    # (frame, coordinate) float64 [m, rad], of poses that have left their rooting; zero for what is held
    pose: np.ndarray
    joint: np.ndarray  # (frame, joint, 3) float64, of the joints' centres along the world's axes [m]


JointAxes = Callable[[RootedPoses], np.ndarray]
"""Matrices (frame, joint, 3, 3) that errors of joints' centres are multiplied by: to express them along other axes, or
to stretch them along some."""


def body_axes(rooted: RootedPoses) -> np.ndarray:
    """(frame, 1, 3, 3): to the body's left, up and ahead."""
    return np.asarray(transposed(rooted.base)[:, None])


def stretched(factor: np.ndarray) -> JointAxes:
    """The world's axes, with what is off along the body's axes multiplied by factors (joint, 3)."""

    def axes(rooted: RootedPoses) -> np.ndarray:
        along = body_axes(rooted)
        return np.asarray(transposed(along) @ (factor[:, :, None] * along))

    return axes


class Deviations:
    """Standard deviations of a clip's frames, window by window as they are solved.

    The clip is solved under the penalty on its ``acceleration`` [m/s^2]. Joints have the ``axes``, or those of the
    world.
    """

    def __init__(self, problem: ClipProblem, acceleration: float, axes: JointAxes | None = None) -> None:
        self._problem, self._acceleration, self._axes = problem, acceleration, axes
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
        rooted, covariance, rooting = rooted[own], covariance[own], self._problem.rooting
        pose = np.zeros_like(rooted.pose)
        pose[:, rooting.searched] = np.minimum(_sigma(rooting.leaving(rooted), covariance), rooting.anywhere)
        _, derivative = self._problem.points.linearised(rooted)
        centres = _along(self._axes, rooted, derivative[:, ::POINTS_A_JOINT])
        joint = _sigma(centres.reshape(len(rooted), -1, len(rooting.searched)), covariance)
        return Uncertainty(pose, joint.reshape(centres.shape[:3]))


def marginal_covariance(
    problem: ClipProblem, contour: NormalEquations, rooted: RootedPoses, acceleration: float
) -> np.ndarray:
    """Covariance of the searched coordinates of each frame, (frame, dof, dof), all others unknown too.

    It is the inverse of what contours, the penalty on accelerations [m/s^2] and the joints' limits say around solved
    poses; the limits keep what nothing shows, such as the twist of a straight limb, within what is possible.
    """
    penalty, own = MotionPenalty(acceleration, problem.rate), contour.with_prior(problem.rooting.anywhere**-2.0)
    if problem.band:
        return problem.band.inverse_diagonal(Motion(problem.points, rooted, penalty, contour.observed), own)
    motion = penalty.around(*problem.points.linearised(rooted), contour.observed)
    return (motion.band + own).inverse_diagonal()


@dataclass(frozen=True, eq=False)
class BodyChanges:
    """Ways in which a body may not be quite the right one."""

    vertex: np.ndarray  # (parameter, tracking vertex, 3) of the skin in the bind pose by each [m]
    joint: np.ndarray  # (parameter, joint, 3) of the joints' centres by each [m]
    sigma: np.ndarray  # (parameter,) prior standard deviations


def body_changes(body: BodyModel) -> BodyChanges:
    """What a body can be solved for, how bind poses differ besides, and how its sides differ."""
    space, seen = RestSpace(body), body.tracking_vertex
    turns = bind_pose_turns(body, space.weight)
    vertex, joint = space.basis(np.zeros(len(space.names)), seen)
    sides_sigma, sides_vertex, sides_joint = space.between_sides()
    return BodyChanges(
        np.concatenate([vertex, turns.vertex[:, seen], sides_vertex[:, seen]]),
        np.concatenate([joint, turns.joint, sides_joint]),
        np.concatenate([space.sigma, turns.sigma, sides_sigma]),
    )


def departure(provenance: Mapping[str, object]) -> float:
    """How far a fitted body lies from the generic one, in standard deviations of its family; at least 1.

    What is known of the family, such as where joints lie under the skin, holds so much less for that body.
    """
    fitted = provenance.get("fit.departure")
    return max(1.0, float(fitted)) if isinstance(fitted, (int, float)) else 1.0


class BodyDeviations:
    """What a body that is not quite the right one, and cameras that disagree, do to a clip's poses, window by window.

    A body's parameters are taken to be as sure as one frame and the prior make them: frames err alike about it. A pose
    follows the body as it would if that frame were fitted alone, which is looked at every ``BODY_INTERVAL``. To this
    come the changes that the residuals of a window's frames, averaged, still ask for: of the body, and by how much the
    views disagree about body and poses.

    Args:
        problem: the clip's.
        linearise: the contours' equations of seen frames, by view, with the body's parameters.
        changes: those parameters.
        axes: of the joints; None for the world's.
        departure: what all this is multiplied by, see :func:`departure`.
    """

    def __init__(
        self,
        problem: ClipProblem,
        linearise: LineariseViews,
        changes: BodyChanges,
        axes: JointAxes | None = None,
        departure: float = 1.0,
    ) -> None:
        self._problem, self._linearise, self._change, self._axes = problem, linearise, changes.joint, axes
        self._information = np.concatenate([problem.rooting.anywhere, changes.sigma]) ** -2.0
        self._departure, self._first = departure, 0
        coordinates = problem.rooting.none.pose.shape[1]
        self._last = Uncertainty(np.zeros((1, coordinates)), np.zeros((1, *changes.joint.shape[1:])))

    def of(self, window: SolvedWindow) -> Uncertainty:
        """Those of the next window's final frames. A window that shows nothing keeps those of the last seen frame."""
        step = max(1, round(BODY_INTERVAL * self._problem.rate))
        at = np.flatnonzero(window.contour.observed[: window.final])[::step]
        if len(at):
            sigma = self._of(self._first + at, window.rooted[at])
        else:
            sigma, at = self._last, np.zeros(1, int)
        self._first += window.final
        self._last = sigma[-1:]
        frames = np.arange(window.final)
        return Uncertainty(_interpolated(frames, at, sigma.pose), _interpolated(frames, at, sigma.joint))

    def _of(self, frames: np.ndarray, rooted: RootedPoses) -> Uncertainty:
        """Those of seen frames."""
        # How sure the body is after one frame, and how each pose follows a change of the body.
        rooting, points = self._problem.rooting, self._problem.points
        dof = len(rooting.searched)
        views = self._linearise(frames, rooted)
        matrix = views.together.with_prior(self._information)
        pose = -np.linalg.solve(matrix[:, :dof, :dof], matrix[:, :dof, dof:])  # (frame, dof, parameter)
        follows = matrix[:, dof:, dof:] + matrix[:, dof:, :dof] @ pose
        body = np.linalg.inv(follows)  # of the whole inverse, the body's block
        # What each view asks of the pose alone (frame, dof, view), and of a body that is the same in all frames.
        alone = np.linalg.solve(matrix[:, :dof, :dof], np.swapaxes(views.gradient[..., :dof], 1, 2))
        asked = (views.gradient[..., dof:] + views.gradient[..., :dof] @ pose).mean(axis=0)  # (view, parameter)
        change = np.linalg.solve(follows.mean(axis=0), asked.T)  # (parameter, view)
        # A joint moves with its bones, and with the pose that follows them.
        joint = points.centres_by_rest(rooted, self._change)
        by_pose = _along(self._axes, rooted, points.linearised(rooted)[1][:, ::POINTS_A_JOINT])
        by_pose = by_pose.reshape(len(rooted), -1, dof)
        by_body = by_pose @ pose + _along(self._axes, rooted, joint).reshape(len(rooted), by_pose.shape[1], -1)
        leaving = rooting.leaving(rooted)
        coordinate = np.zeros_like(rooted.pose)
        coordinate[:, rooting.searched] = _systematic(leaving @ pose, body, change, leaving @ alone)
        of_joint = _systematic(by_body, body, change, by_pose @ alone).reshape(joint.shape[:3])
        return Uncertainty(self._departure * coordinate, self._departure * of_joint)


def _systematic(by_body: np.ndarray, body: np.ndarray, change: np.ndarray, alone: np.ndarray) -> np.ndarray:
    """(frame, value) standard deviations of what all frames have in common.

    Args:
        by_body: (frame, value, parameter) derivatives by the body.
        body: (frame, parameter, parameter) its covariance.
        change: (parameter, view) that each view asks for.
        alone: (frame, value, view) what each view asks for beside that.
    """
    views = change.shape[1]
    remains = by_body @ change.sum(axis=1)
    by_view = by_body @ change + alone
    scatter = views / max(views - 1, 1) * views * by_view.var(axis=2)
    return np.asarray(np.sqrt(_sigma(by_body, body) ** 2 + remains**2 + scatter))


def misfit(contour: NormalEquations, searched: np.ndarray, usual: float = USUAL_MISFIT) -> float:
    """Root mean square of contours' distances [m]; where no contour was found, the distance that was searched counts.

    It is what the cost is for each unit of information about the translation, in metres; the usual one where no
    translation is searched, or nothing is seen.
    """
    shifts = np.flatnonzero(searched < TRANSLATION)
    seen = contour.observed
    if not len(shifts) or not seen.any():
        return usual
    information = 3 * np.einsum("fdd->fd", contour.matrix[seen])[:, shifts].mean(axis=1)
    return float(np.sqrt(np.mean(2 * contour.cost[seen] / information)))


def combine(
    noise: Uncertainty, body: Uncertainty, misfit: float, widest: np.ndarray, usual: float = USUAL_MISFIT
) -> Uncertainty:
    """Standard deviations of all that is wrong with poses.

    Both parts, of noise and of the body, are in proportion to the misfit [m]: residuals are as large as they are, not
    as large as was assumed. The larger they are, the larger is the share of them that is the same in all frames,
    because masks' noise does not grow: so the second part is in proportion twice, within ``MOST_SYSTEMATIC``. No
    coordinate exceeds the ``widest`` (coordinate,). The ``usual`` misfit shrinks with small bodies as the lengths do
    that contours are matched by [m].
    """
    scale = misfit / usual
    alike = SYSTEMATIC * min(max(scale, 1.0), MOST_SYSTEMATIC)
    pose = scale * np.hypot(NOISE * noise.pose, alike * body.pose)
    joint = scale * np.hypot(NOISE * noise.joint, alike * body.joint)
    return Uncertainty(np.minimum(pose, widest), joint)


def _interpolated(frames: np.ndarray, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (n, ...) of the frames ``at``, and between them by their distances, in other frames."""
    columns = [np.interp(frames, at, column) for column in values.reshape(len(at), -1).T]
    return np.asarray(np.stack(columns, axis=1).reshape(len(frames), *values.shape[1:]))


def _along(axes: JointAxes | None, rooted: RootedPoses, derivative: np.ndarray) -> np.ndarray:
    """Derivatives of joints' centres (frame, joint, 3, parameter), along other axes."""
    return derivative if axes is None else axes(rooted) @ derivative


def _sigma(derivative: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(frame, value) standard deviations of values with derivatives (frame, value, dof)."""
    return np.asarray(np.sqrt(((derivative @ covariance) * derivative).sum(axis=-1)))
