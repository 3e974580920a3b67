"""Cameras, their times, and the person before them, adjusted together: the stages that refining and checking share.

1. Silhouettes that do not agree are brought to agree by two of their points, without a body.
2. A body is fitted to the first frame and followed; whole frames by which a camera lags are found on the way.
3. Cameras, times, body and poses of frames spread over the clip are one problem.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.calibration.adjust.camera_changes import (
    CENTRE,
    OFFSET,
    POSITION,
    ROTATION,
    Deviations,
    changed,
    difference,
)
from mmocap_warp.calibration.adjust.camera_problem import (
    CameraProblem,
    KnownLength,
    camera_fitter,
    known_distance,
    known_height,
)
from mmocap_warp.calibration.adjust.coherence import coherence
from mmocap_warp.calibration.adjust.footage import Footage
from mmocap_warp.calibration.adjust.landmarks import LandmarkProblem, landmarks
from mmocap_warp.calibration.adjust.person_motion import Motion
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.frame.fitter import WIDE, ContourFitter, MatchingConfig
from mmocap_warp.contour.frame.rooted import Rooting
from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.fitting.frame_fit import PRIOR
from mmocap_warp.fitting.standing_search import NoSubjectError
from mmocap_warp.fitting.subject_fit import FitConfig, fit_clip
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig

_NEAR = MatchingConfig(reach=0.02, huber=0.006)  # shadows at the feet lie farther than that from the outline
FROM_FAR = ((WIDE, 10), (MatchingConfig(), 10), (_NEAR, 10))  # steps with each matching
_FROM_NEAR = ((MatchingConfig(), 6), (_NEAR, 8))
_FARTHER = 3.0  # times as far as cameras are said to be wrong, a start without a body may turn them
_COHERENT = 0.005  # of coherence by which such a start must be better
_COHERENCE_FRAMES = 8
_LAGS = 12  # frames to either side that are looked at for whole ones
_CLEARLY_LATER = 0.97  # of a view's cost at the time that it was thought to be
_FITTED = 2.0  # [s] that the first body is fitted to
_FEWEST = 4  # frames that cameras are solved from, and that judge them
_FOUND = [STATUS.index(name) for name in ("tracked", "partial", "rescued")]
_A_TURN, _A_MOVE = np.radians(1.0), 0.04  # [rad, m]: less than these a camera has hardly moved

Progress = Callable[[str, float], None]
"""Called with what was done, and the share of all work."""


@dataclass(frozen=True)
class AdjustConfig:
    """Settings of an adjustment of cameras.

    Attributes:
        deviations: how far cameras may be from their calibration; what is zero is held.
        fixed: the camera that stands still; None for the one beside which the others have to move least.
        height: of the person, where it is known [m].
        distance: between the centres of two cameras, where it is known: their names and metres.
        frames: that the cameras are solved from.
        judges: frames that judge them, which have no part in it.
        scale: of masks and cameras; None for images at most 640 pixels long.
        seed: of the random numbers.
        device: ``auto``, ``cpu`` or a CUDA device.
        threads: CPU threads; None for all that this process may use.
        subject: the person in the pose of the first frame, where that is known; else a body is fitted to it.
    """

    deviations: Deviations = field(default_factory=Deviations)
    fixed: str | None = None
    height: float | None = None
    distance: tuple[str, str, float] | None = None
    frames: int = 20
    judges: int = 10
    scale: float | None = None
    seed: int = 0
    device: str = "auto"
    threads: int | None = None
    subject: Subject | None = None

    def __post_init__(self) -> None:
        for name in ("frames", "judges"):
            if getattr(self, name) < 2:
                raise ValueError(f"{name} must be at least 2, got {getattr(self, name)}")
        if self.scale is not None and not 0.0 < self.scale <= 1.0:
            raise ValueError(f"scale must be in (0, 1], got {self.scale}")
        for name, metres in (("height", self.height), ("distance", self.distance and self.distance[2])):
            if metres is not None and not 0.0 < metres < 100.0:
                raise ValueError(f"{name} must be in (0, 100) m, got {metres}")


@dataclass(frozen=True, eq=False)
class Person:
    """The person as cameras show them.

    Attributes:
        subject: the body, with the pose of the first frame.
        observations: the frames' masks, each camera's shifted by whole frames.
        motion: the poses.
        found: (frame,) int, the frames in which the person was found.
    """

    subject: Subject
    observations: list[Observation]
    motion: Motion
    found: np.ndarray

    def spread(self, count: int) -> np.ndarray:
        """At most so many of the frames in which the person was found, evenly spread, with the first and the last.

        Of few, as many are left as are needed to judge.
        """
        at = np.linspace(0, len(self.found) - 1, min(count, len(self.found) - _FEWEST))
        frames: np.ndarray = self.found[at.round().astype(int)]
        return frames

    def between(self, count: int, taken: np.ndarray) -> np.ndarray:
        """At most so many of the other frames than those ``taken``, evenly spread, none at the ends."""
        others = np.setdiff1d(self.found, taken)
        at = (np.arange(min(count, len(others))) + 0.5) * len(others) / max(min(count, len(others)), 1)
        frames: np.ndarray = others[at.astype(int)]
        return frames


@dataclass(frozen=True, eq=False)
class Adjusted:
    """Cameras, body and poses as they were solved for.

    Attributes:
        change: (camera, parameter) of the cameras.
        beta: (parameter,) of the body.
        pose: (coordinate,) of the first frame.
        free: (camera, parameter) bool: what was solved for.
        covariance: (free parameter, free parameter) of the cameras, as sure as one frame would leave them: body and
            masks are wrong in all frames alike.
        cost: what contours cost in a frame, in the mean.
    """

    change: np.ndarray
    beta: np.ndarray
    pose: np.ndarray
    free: np.ndarray
    covariance: np.ndarray
    cost: float


class Adjustment:
    """The stages. Cameras are told by how they differ from the calibration, (camera, parameter) of ``KINDS``.

    Args:
        scene: the recording.
        body: the generic body that the person's is expected to be near to.
        config: settings.

    Attributes:
        footage: the masks.
        given: the cameras as they were calibrated, at the masks' size.
        space: bodies around the generic one.
        sigma: (camera, parameter) how far cameras may be from their calibration.

    Raises:
        ValueError: a camera that the scene does not have.
    """

    def __init__(self, scene: Scene, body: BodyModel, config: AdjustConfig) -> None:
        self.scene, self.config, self._body = scene, config, body
        self.device = resolve_device(config.device)
        self.threads = config.threads or available_threads()
        self.footage = Footage.of(scene, config.scale)
        self.given = self.footage.rig
        self.space = RestSpace(body)
        self.sigma = config.deviations.of(self.given)
        for name in (config.fixed, *(config.distance or ())[:2]):
            if name is not None and name not in self.given.names:
                raise ValueError(f"camera must be one of {list(self.given.names)}, got {name!r}")
        self._stated = None if config.fixed is None else self.given.names.index(config.fixed)

    def started(self) -> np.ndarray:
        """Changes by which silhouettes agree, where they did not."""
        none = np.zeros(self.sigma.shape)
        free = ROTATION if self.sigma[:, ROTATION].any() else CENTRE
        sigma = none.copy()
        sigma[:, free] = _FARTHER * self.sigma[:, free]
        if self._stated is not None:
            sigma[self._stated] = 0.0
        observations = self.footage.observations(none[:, OFFSET])
        if not sigma.any() or not observations:
            return none
        seen = landmarks(self.given, observations)
        started = LandmarkProblem(self.given, seen, self.footage.fps, sigma).solved()
        some = observations[:: max(1, len(observations) // _COHERENCE_FRAMES)]
        before, after = (np.nanmean(coherence(changed(self.given, each), some)) for each in (none, started))
        return started if after > before + _COHERENT else none

    def fitted(self, change: np.ndarray) -> Subject:
        """The body in its first pose."""
        if self.config.subject is not None:
            return self.config.subject
        count = max(1, round(_FITTED * self.footage.fps))
        config = FitConfig(seed=self.config.seed, device=self.device, threads=self.threads)
        observations = self.footage.observations(change[:, OFFSET])[:count]
        try:
            subject = fit_clip(self._body, changed(self.given, change), self.footage.fps, observations, config)
        except NoSubjectError as error:
            remedy = "look at the masks (mmocap mask), and whether they are of these cameras"
            raise InputError(self.scene.path, str(error), remedy) from None
        return subject

    def followed(self, change: np.ndarray, subject: Subject) -> Person:
        """The person through all frames."""
        observations = self.footage.observations(change[:, OFFSET])
        config = TrackConfig(seed=self.config.seed, device=self.device, threads=self.threads)
        rig, fps = changed(self.given, change), self.footage.fps
        lag = self.footage.rest(change[:, OFFSET])
        seen = [replace(observation, late=-lag) for observation in observations] if lag.any() else observations
        result = track_observations(subject, rig, seen, fps, config)
        skeleton = self._body.skeleton
        rooting = Rooting(skeleton, subject.root_base, skeleton.searched())
        found = np.flatnonzero(np.isin(result.status[0], _FOUND))
        if len(found) < 2 * _FEWEST:
            problem = f"the person could be followed in {len(found)} frames, {2 * _FEWEST} are needed"
            raise InputError(self.scene.path, problem, "choose others with --frames, or start nearer to the truth")
        return Person(subject, observations, Motion(rooting, rooting.enter(result.pose[0]), fps), found)

    def with_lags(self, change: np.ndarray, person: Person) -> tuple[np.ndarray, Person]:
        """With whole frames by which cameras lag, and the person followed anew where there are any."""
        fps = self.scene.fps
        farthest = min(_LAGS, int(np.ceil(2 * self.config.deviations.offset * fps)))
        frames = person.spread(self.config.frames)
        lags = np.arange(-farthest, farthest + 1)
        fitter = self._fitter(changed(self.given, change), person, frames, MatchingConfig())
        fitter.reshape(*self.space.at(self.space.nearest(person.subject.body), self._body.tracking_vertex))
        costs = np.stack(
            [
                fitter.linearise_views(
                    np.arange(len(frames)), person.motion.at(frames - lag * self.footage.fps / fps)
                ).cost.sum(axis=0)
                for lag in lags
            ]
        )
        best = costs.argmin(axis=0)
        found = np.where(costs.min(axis=0) < _CLEARLY_LATER * costs[farthest], lags[best], 0)
        if not found.any():
            return change, person
        found -= (
            int(np.median(found)) if self.config.fixed is None else found[self.given.names.index(self.config.fixed)]
        )
        later = change.copy()
        later[:, OFFSET] += found / fps
        return later, self.followed(later, person.subject)

    def with_fixed(self, fixed: int) -> np.ndarray:
        """How far cameras may be, where one tells the time, and stands still if nothing else holds the world."""
        sigma = self.sigma.copy()
        sigma[fixed, OFFSET] = 0.0
        if self._floats or self._stated is not None:
            sigma[fixed, ROTATION], sigma[fixed, POSITION] = 0.0, 0.0
        return sigma

    @property
    def _floats(self) -> bool:
        """Whether all cameras and the person may move together."""
        return bool(self.sigma[:, POSITION].any())

    def solved(self, change: np.ndarray, person: Person, sigma: np.ndarray, *, again: bool = False) -> Adjusted:
        """Cameras that may be so far (camera, parameter) from their calibration, from frames over the clip.

        It takes fewer steps where cameras were solved for before, and the person was followed with these: ``again``.
        """
        stages = _FROM_NEAR if again else FROM_FAR
        frames = person.spread(self.config.frames)
        velocity = person.motion.velocity(frames)
        rooted, free = person.motion.rooted[frames], sigma > 0
        lag = self.footage.rest(change[:, OFFSET]) - change[:, OFFSET]  # that masks were read with
        parameters = np.array([])
        for stage, (matching, count) in enumerate(stages):  # one at a time: a fitter holds the masks' distances
            fitter = self._fitter(self.given, person, frames, matching)
            problem = CameraProblem(
                fitter, self.given, lag, self.space, person.motion.rooting, PRIOR, sigma, self._known
            )
            if stage == 0:
                parameters = problem.start(self.space.nearest(person.subject.body), change)
            solution = problem.problem(velocity).solved(np.arange(len(frames)), rooted, parameters, count)
            rooted, parameters = solution.rooted, solution.beta
        first = person.motion.rooting.leave(rooted[:1], person.subject.pose[ROOT_ANGLES])[0]
        pose = first if frames[0] == 0 else person.subject.pose
        cameras = problem.of_cameras
        covariance = len(frames) * solution.covariance[np.ix_(cameras, cameras)]
        beta = parameters[: len(self.space.names)]
        return Adjusted(problem.change(parameters), beta, pose, free, covariance, float(solution.cost.mean()))

    def _fitter(self, rig: CameraRig, person: Person, frames: np.ndarray, matching: MatchingConfig) -> ContourFitter:
        """One that observes some of the frames."""
        observations = [person.observations[frame] for frame in frames]
        return camera_fitter(self.space, rig, observations, matching, self.device, self.threads)

    @property
    def _known(self) -> tuple[KnownLength, ...]:
        """Lengths that give the scale."""
        height, distance, names = self.config.height, self.config.distance, self.given.names
        known = [] if height is None else [known_height(self.space, height)]
        if distance is not None:
            one, other, metres = distance
            known.append(known_distance(self.given, names.index(one), names.index(other), metres))
        return tuple(known)

    def stillest(self, change: np.ndarray) -> int:
        """The camera beside which the others have to move least; many that move a little count more than one far."""
        if self._stated is not None:
            return self._stated
        moves = [self.seen_from(change, camera)[0] for camera in range(len(change))]
        size = [
            np.log1p(
                ((move[:, ROTATION] / _A_TURN) ** 2).sum(axis=1) + ((move[:, POSITION] / _A_MOVE) ** 2).sum(axis=1)
            )
            for move in moves
        ]
        return int(np.argmin(np.sum(size, axis=1)))

    def seen_from(self, change: np.ndarray, fixed: int) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """The same cameras in a world in which one of them has not moved, and how the old world lies in that one.

        That is a rotation (3, 3) and a shift (3,) [m]. Times count from that camera's too.
        """
        own = change.copy()
        own[:, OFFSET] -= change[fixed, OFFSET]
        if not self._floats:
            return own, (np.eye(3), np.zeros(3))
        rig, given = changed(self.given, change), self.given
        turn = given.R[fixed].T @ rig.R[fixed]
        shift = given.R[fixed].T @ (rig.t[fixed] - given.t[fixed])
        seen = replace(rig, R=rig.R @ turn.T, t=rig.t - rig.R @ turn.T @ shift)
        moved = difference(given, seen)
        moved[:, OFFSET] = own[:, OFFSET]
        return moved, (turn, shift)


def moved_subject(subject: Subject, turn: np.ndarray, shift: np.ndarray) -> Subject:
    """A subject in another world, in which the old one lies turned and shifted."""
    pose = subject.pose.astype(float).copy()
    pose[:3] = turn @ pose[:3] + shift
    return replace(subject, root_base=turn @ subject.root_base, pose=pose)
