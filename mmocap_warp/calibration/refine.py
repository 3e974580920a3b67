"""Cameras and their times made better by the person before them.

1. Silhouettes that do not agree are brought to agree by two of their points, without a body.
2. A body is fitted to the first frame and followed; whole frames by which a camera lags are found on the way.
3. Cameras, times, body and poses of frames spread over the clip are one problem.
4. The person is followed again with what was found, and the problem is solved again. Of all parameters only those
   change that have to.
5. Frames that had no part in it judge whether that is better than before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.calibration.camera_problem import CameraProblem, KnownLength, known_distance, known_height
from mmocap_warp.calibration.cameras import CENTRE, OFFSET, POSITION, ROTATION, Deviations, changed, difference
from mmocap_warp.calibration.coherence import coherence
from mmocap_warp.calibration.footage import Footage
from mmocap_warp.calibration.held_out import Explained, HeldOut
from mmocap_warp.calibration.landmarks import LandmarkProblem, landmarks
from mmocap_warp.calibration.motion import Motion
from mmocap_warp.calibration.significance import selected
from mmocap_warp.contour.body_problem import BodySolution
from mmocap_warp.contour.fitter import ContourFitter, MatchingConfig
from mmocap_warp.contour.rooted import Rooting
from mmocap_warp.device import available_threads, resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.result.result import STATUS
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.config import TrackConfig
from mmocap_warp.tracking.fit import FitConfig, fit_clip
from mmocap_warp.tracking.frame_fit import PRIOR
from mmocap_warp.tracking.standing_search import NoSubjectError
from mmocap_warp.tracking.track import track_observations
from mmocap_warp.views.observation import Observation
from mmocap_warp.views.rig import CameraRig

_WIDE = MatchingConfig(reach=0.2, huber=0.03, sigma=0.03)  # for what is still far from the masks
_STEPS = (10, 15)  # with wide matching, then with the usual one
_FARTHER = 3.0  # times as far as cameras are said to be wrong, a start without a body may turn them
_COHERENT = 0.005  # of coherence by which such a start must be better
_COHERENCE_FRAMES = 8
_LAGS = 12  # frames to either side that are looked at for whole ones
_CLEARLY_LATER = 0.97  # of a view's cost at the time that it was thought to be
_ROUNDS = 2
_FITTED = 2.0  # [s] that the first body is fitted to
_FEWEST = 4  # frames that cameras are solved from, and that judge them
_FOUND = [STATUS.index(name) for name in ("tracked", "partial", "rescued")]
_A_TURN, _A_MOVE = np.radians(1.0), 0.04  # [rad, m]: less than these a camera has hardly moved


@dataclass(frozen=True)
class RefineConfig:
    """Settings of a refinement.

    Attributes:
        deviations: how far cameras may be from their calibration; what is zero is held.
        fixed: the camera that stands still; None for the one beside which the others have to move least.
        height: of the person, where it is known [m].
        distance: between the centres of two cameras, where it is known: their names and metres.
        frames: that the cameras are solved from.
        judges: frames that judge them.
        scale: of masks and cameras; None for images at most 640 pixels long.
        seed: of the random numbers.
        device: ``auto``, ``cpu`` or a CUDA device.
        threads: CPU threads; None for all that this process may use.
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
class Refinement:
    """Cameras as they were found.

    Attributes:
        rig: as calibrated, at full size, with what was found.
        change: (camera, parameter) by which they differ from the calibration, see
            :data:`~mmocap_warp.calibration.cameras.KINDS`; pixels are those of the calibrated images.
        sigma: (camera, parameter) standard deviations; of those that stayed, as they would be known.
        moved: (camera, parameter) bool: those that changed; all others are exactly what they were.
        undetermined: (camera, parameter) bool: those that the masks do not tell.
        fixed: number of the camera that stood still.
        before, after: how well frames that had no part are explained.
    """

    rig: CameraRig
    change: np.ndarray
    sigma: np.ndarray
    moved: np.ndarray
    undetermined: np.ndarray
    fixed: int
    before: Explained
    after: Explained

    @property
    def better(self) -> bool:
        """Whether frames that had no part are explained better, all views together and each by the others alone."""
        gains = [
            float(np.nanmean(after) - np.nanmean(before))
            for before, after in ((self.before.together, self.after.together), (self.before.apart, self.after.apart))
        ]
        return bool(self.moved.any()) and min(gains) > 0


RefineProgress = Callable[[str, float], None]
"""Called with what was done, and the share of all work."""


def refine(
    scene: Scene, body: BodyModel, config: RefineConfig | None = None, progress: RefineProgress | None = None
) -> Refinement:
    """Refine a scene's cameras.

    Args:
        scene: the recording.
        body: the generic body that the person's is expected to be near to.
        config: settings.
        progress: told after every stage.

    Raises:
        ValueError: a camera that the scene does not have.
        InputError: masks that show nobody, too few frames in which the person could be followed.
    """
    return _Refining(scene, body, config or RefineConfig(), progress or (lambda stage, done: None)).done()


@dataclass(frozen=True, eq=False)
class _Person:
    """The person as the cameras in question show them.

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
        """At most so many of the frames in which the person was found, evenly spread, with the first and the last."""
        at = np.linspace(0, len(self.found) - 1, min(count, len(self.found)))
        frames: np.ndarray = self.found[at.round().astype(int)]
        return frames

    def between(self, count: int, taken: np.ndarray) -> np.ndarray:
        """At most so many of the other frames than those ``taken``, evenly spread, none at the ends."""
        others = np.setdiff1d(self.found, taken)
        at = (np.arange(min(count, len(others))) + 0.5) * len(others) / max(min(count, len(others)), 1)
        frames: np.ndarray = others[at.astype(int)]
        return frames


class _Refining:
    """The stages of a refinement; see the module. Cameras are told by how they differ from the calibration."""

    def __init__(self, scene: Scene, body: BodyModel, config: RefineConfig, progress: RefineProgress) -> None:
        self._scene, self._body, self._config, self._progress = scene, body, config, progress
        self._device = resolve_device(config.device)
        self._threads = config.threads or available_threads()
        self._footage = Footage.of(scene, config.scale)
        self._given = self._footage.rig
        self._space = RestSpace(body)
        self._sigma = config.deviations.of(self._given)
        for name in (config.fixed, *(config.distance or ())[:2]):
            if name is not None and name not in self._given.names:
                raise ValueError(f"camera must be one of {list(self._given.names)}, got {name!r}")
        self._stated = None if config.fixed is None else self._given.names.index(config.fixed)

    def done(self) -> Refinement:
        change = self._started()
        fixed = self._stillest(change)
        change, _ = self._seen_from(change, fixed)
        person = self._followed(change, self._fitted(change))
        change, person = self._with_lags(change, person)
        for number in range(_ROUNDS):
            self._progress("cameras", 0.3 + 0.2 * number)
            change, beta, pose, _ = self._solved(change, person, self._with_fixed(fixed), _STEPS)
            fixed = self._stillest(change)
            change, motion = self._seen_from(change, fixed)
            body = replace(person.subject, body=self._space.model(beta), pose=pose)
            person = self._followed(change, _moved(body, *motion))
        return self._chosen(change, person, fixed)

    def _started(self) -> np.ndarray:
        """Changes by which silhouettes agree, where they did not."""
        none = np.zeros(self._sigma.shape)
        free = ROTATION if self._sigma[:, ROTATION].any() else CENTRE
        sigma = none.copy()
        sigma[:, free] = _FARTHER * self._sigma[:, free]
        if self._stated is not None:
            sigma[self._stated] = 0.0
        observations = self._footage.observations(none[:, OFFSET])
        if not sigma.any() or not observations:
            return none
        seen = landmarks(self._given, observations)
        started = LandmarkProblem(self._given, seen, self._footage.fps, sigma).solved()
        some = observations[:: max(1, len(observations) // _COHERENCE_FRAMES)]
        before, after = (np.nanmean(coherence(changed(self._given, each), some)) for each in (none, started))
        self._progress("silhouettes", 0.05)
        return started if after > before + _COHERENT else none

    def _fitted(self, change: np.ndarray) -> Subject:
        """The body in its first pose."""
        count = max(1, round(_FITTED * self._footage.fps))
        config = FitConfig(seed=self._config.seed, device=self._device, threads=self._threads)
        observations = self._footage.observations(change[:, OFFSET])[:count]
        try:
            subject = fit_clip(self._body, changed(self._given, change), self._footage.fps, observations, config)
        except NoSubjectError as error:
            remedy = "look at the masks (mmocap mask), and whether they are of these cameras"
            raise InputError(self._scene.path, str(error), remedy) from None
        self._progress("body", 0.2)
        return subject

    def _followed(self, change: np.ndarray, subject: Subject) -> _Person:
        """The person through all frames."""
        observations = self._footage.observations(change[:, OFFSET])
        config = TrackConfig(seed=self._config.seed, device=self._device, threads=self._threads)
        rig, fps = changed(self._given, change), self._footage.fps
        result = track_observations(subject, rig, observations, fps, config)
        skeleton = self._body.skeleton
        rooting = Rooting(skeleton, subject.root_base, skeleton.searched())
        found = np.flatnonzero(np.isin(result.status[0], _FOUND))
        if len(found) < 2 * _FEWEST:
            problem = f"the person could be followed in {len(found)} frames, {2 * _FEWEST} are needed"
            raise InputError(self._scene.path, problem, "choose others with --frames, or start nearer to the truth")
        return _Person(subject, observations, Motion(rooting, rooting.enter(result.pose[0]), fps), found)

    def _with_lags(self, change: np.ndarray, person: _Person) -> tuple[np.ndarray, _Person]:
        """With whole frames by which cameras lag, and the person followed anew where there are any."""
        fps = self._scene.fps
        farthest = min(_LAGS, int(np.ceil(2 * self._config.deviations.offset * fps)))
        frames = person.spread(self._config.frames)
        lags = np.arange(-farthest, farthest + 1)
        fitter = self._fitter(changed(self._given, change), person, frames, MatchingConfig())
        fitter.reshape(*self._space.at(self._space.nearest(person.subject.body), self._body.tracking_vertex))
        costs = np.stack(
            [
                fitter.linearise_views(
                    np.arange(len(frames)), person.motion.at(frames - lag * self._footage.fps / fps)
                ).cost.sum(axis=0)
                for lag in lags
            ]
        )
        best = costs.argmin(axis=0)
        found = np.where(costs.min(axis=0) < _CLEARLY_LATER * costs[farthest], lags[best], 0)
        if not found.any():
            return change, person
        found -= (
            int(np.median(found)) if self._config.fixed is None else found[self._given.names.index(self._config.fixed)]
        )
        later = change.copy()
        later[:, OFFSET] += found / fps
        return later, self._followed(later, person.subject)

    def _with_fixed(self, fixed: int) -> np.ndarray:
        """How far cameras may be, where one stands still and tells the time."""
        sigma = self._sigma.copy()
        sigma[fixed, ROTATION], sigma[fixed, POSITION], sigma[fixed, OFFSET] = 0.0, 0.0, 0.0
        return sigma

    def _solved(
        self, change: np.ndarray, person: _Person, sigma: np.ndarray, steps: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, BodySolution]:
        """Cameras, body, and the pose of the first frame, from frames over the clip."""
        frames = person.spread(self._config.frames)
        velocity = person.motion.velocity(frames)
        rooted, free = person.motion.rooted[frames], sigma > 0
        beta = np.concatenate([self._space.nearest(person.subject.body), change[free]])
        lag = self._footage.rest(change[:, OFFSET]) - change[:, OFFSET]  # that masks were read with
        for matching, count in zip((_WIDE, MatchingConfig()), steps, strict=True):
            fitter = self._fitter(self._given, person, frames, matching)
            problem = CameraProblem(
                fitter, self._given, lag, self._space, person.motion.rooting, PRIOR, sigma, self._known
            )
            solution = problem.problem(velocity).solved(np.arange(len(frames)), rooted, beta, count)
            rooted, beta = solution.rooted, solution.beta
        first = person.motion.rooting.leave(rooted[:1], person.subject.pose[ROOT_ANGLES])[0]
        pose = first if frames[0] == 0 else person.subject.pose
        return problem.change(beta), beta[: len(self._space.names)], pose, solution

    def _chosen(self, change: np.ndarray, person: _Person, fixed: int) -> Refinement:
        """Only what has to change, and what that is worth."""
        sigma = self._with_fixed(fixed)
        change, _, _, solution = self._solved(change, person, sigma, _STEPS)
        free, shape = sigma > 0, len(self._space.names)
        # Body and masks are wrong in all frames alike: cameras are as sure as one frame leaves them.
        covariance = len(solution.rooted) * solution.covariance[shape:, shape:]
        selection = selected(change[free], covariance, sigma[free])
        moved, determined, deviation = np.zeros(free.shape, bool), ~free, np.zeros(free.shape)
        moved[free], determined[free], deviation[free] = selection.moved, selection.determined, selection.sigma
        beta = solution.beta[:shape]
        change = np.where(moved, change, 0.0)
        if moved.any():
            change, beta, _, _ = self._solved(change, person, np.where(moved, sigma, 0.0), _STEPS)
        before, after = self._judged(change, person, beta)
        full = np.ones(change.shape)
        full[:, CENTRE] = 1.0 / self._footage.scale  # pixels of the calibrated images
        rig = changed(self._scene.calibrated, full * change)
        return Refinement(rig, full * change, full * deviation, moved, ~determined, fixed, before, after)

    def _judged(self, change: np.ndarray, person: _Person, beta: np.ndarray) -> tuple[Explained, Explained]:
        frames = person.between(self._config.judges, person.spread(self._config.frames))
        judge = HeldOut(self._space, person.motion.rooting, PRIOR, self._device, self._threads)
        explained = []
        for each in (np.zeros(change.shape), change):
            observations = self._footage.observations(each[:, OFFSET])
            explained.append(
                judge.explained(
                    changed(self._given, each),
                    self._footage.rest(each[:, OFFSET]),
                    [observations[frame] for frame in frames],
                    person.motion.rooted[frames],
                    beta,
                    person.motion.velocity(frames),
                )
            )
            self._progress("judged", 0.8 + 0.1 * len(explained))
        return explained[0], explained[1]

    def _fitter(self, rig: CameraRig, person: _Person, frames: np.ndarray, matching: MatchingConfig) -> ContourFitter:
        """One that observes some of the frames."""
        skeleton = self._body.skeleton
        fitter = ContourFitter(
            self._body, rig, skeleton.searched(), skeleton.coordinate_limits,
            candidates=len(frames), frames=len(frames), parameters=len(self._space.names), lens=True,
            matching=matching, device=self._device, threads=self._threads,
        )  # fmt: skip
        fitter.observe_all([person.observations[frame] for frame in frames])
        return fitter

    @property
    def _known(self) -> tuple[KnownLength, ...]:
        """Lengths that give the scale."""
        height, distance, names = self._config.height, self._config.distance, self._given.names
        known = [] if height is None else [known_height(self._space, height)]
        if distance is not None:
            one, other, metres = distance
            known.append(known_distance(self._given, names.index(one), names.index(other), metres))
        return tuple(known)

    def _stillest(self, change: np.ndarray) -> int:
        """The camera beside which the others have to move least; many that move a little count more than one far."""
        if self._stated is not None:
            return self._stated
        moves = [self._seen_from(change, camera)[0] for camera in range(len(change))]
        size = [
            np.log1p(
                ((move[:, ROTATION] / _A_TURN) ** 2).sum(axis=1) + ((move[:, POSITION] / _A_MOVE) ** 2).sum(axis=1)
            )
            for move in moves
        ]
        return int(np.argmin(np.sum(size, axis=1)))

    def _seen_from(self, change: np.ndarray, fixed: int) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """The same cameras in a world in which one of them has not moved, and how the old world lies in that one.

        That is a rotation (3, 3) and a shift (3,) [m]. Times count from that camera's too.
        """
        rig, given = changed(self._given, change), self._given
        turn = given.R[fixed].T @ rig.R[fixed]
        shift = given.R[fixed].T @ (rig.t[fixed] - given.t[fixed])
        seen = replace(rig, R=rig.R @ turn.T, t=rig.t - rig.R @ turn.T @ shift)
        moved = difference(given, seen)
        moved[:, OFFSET] = change[:, OFFSET] - change[fixed, OFFSET]
        return moved, (turn, shift)


def _moved(subject: Subject, turn: np.ndarray, shift: np.ndarray) -> Subject:
    """A subject in another world, in which the old one lies turned and shifted."""
    pose = subject.pose.astype(float).copy()
    pose[:3] = turn @ pose[:3] + shift
    return replace(subject, root_base=turn @ subject.root_base, pose=pose)
