"""Cameras, their times, and the person before them, adjusted together: the stages that refining and checking share.

1. Where silhouettes do not agree, two landmarks of each bring them to agree, without a body.
2. A body is fitted to the first frame and tracked; lags of whole frames are found on the way.
3. Cameras, times, body and poses of frames spread over the clip are solved as one problem.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.calibration.adjust import camera_changes, camera_problem
from mmocap_warp.calibration.adjust.camera_changes import OFFSET, POSITION, ROTATION, AdjustConfig, changed
from mmocap_warp.calibration.adjust.camera_problem import CameraProblem, CameraSolution, KnownLength
from mmocap_warp.calibration.adjust.footage import MIN_FRAMES, Footage, Motion, Person
from mmocap_warp.calibration.adjust.silhouette_agreement import LandmarkProblem, coherence, landmarks
from mmocap_warp.contour.body_problem import space_fitter
from mmocap_warp.contour.frame.fitter import WIDE, MatchingConfig
from mmocap_warp.contour.frame.rooted import Rooting
from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.fitting.frame_fit import PRIOR
from mmocap_warp.fitting.standing_search import NoSubjectError
from mmocap_warp.fitting.subject_fit import FitConfig, fit_clip
from mmocap_warp.result.pose_errors import nanmean
from mmocap_warp.result.result import STATUS
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking.frame_loop import track_observations
from mmocap_warp.tracking.track_config import TrackConfig

_NEAR = MatchingConfig(reach=0.02, huber=0.006)  # shadows at the feet lie farther from the outline than this reaches
FROM_FAR = ((WIDE, 10), (MatchingConfig(), 10), (_NEAR, 10))
"""Stages of a solution that starts far off: how contours are matched, and the steps of each stage."""
_FROM_NEAR = ((MatchingConfig(), 6), (_NEAR, 8))  # the stages of a solution that starts near
_START_RANGE = 3.0  # times the stated deviations that the start by landmarks may turn a camera
_MIN_COHERENCE_GAIN = 0.005  # gain of coherence for which the start by landmarks is taken
_COHERENCE_FRAMES = 8  # frames whose coherence is compared
_MAX_LAG = 12  # frames to either side in which whole-frame lags are looked for
_LAG_COST_RATIO = 0.97  # a lag is believed where a view's cost falls below this share of its cost without a lag
_FIT_SECONDS = 2.0  # seconds of the recording that the first body is fitted to
_FOUND_STATUS = [STATUS.index(name) for name in ("tracked", "partial", "rescued")]
_TURN_UNIT, _SHIFT_UNIT = np.radians(1.0), 0.04  # radians and metres: below these a camera has hardly moved

Progress = Callable[[str, float], None]
"""Called with the name of the stage that is done, and the share of all work."""


class Adjustment:
    """The stages. A camera is described by its difference from the calibration, (camera, parameter) of ``KINDS``.

    ``body`` is the generic one that the person's is expected to be near to.

    Raises:
        InputError: it has one camera alone, or the body's root is held.
    """

    def __init__(self, scene: Scene, body: BodyModel, config: AdjustConfig) -> None:
        if len(scene.cameras) < 2:
            raise InputError(scene.path, "names one camera, and comparing needs two views at least", "name another one")
        if not set(range(ROOT_ANGLES.stop)) <= set(body.skeleton.searched()):
            problem = "its body is held at the root, and cameras are compared by a body that is free to move"
            raise InputError(scene.path, problem, "calibrate by a recording of a person, or by a board")
        self.scene, self.config, self._body = scene, config, body
        self.device, self.threads = resolve_device(config.device), config.threads or available_threads()
        self.footage = Footage(scene, config.scale)
        self.given = self.footage.rig  # the cameras as they were calibrated, at the masks' size
        self.space = RestSpace(body)  # bodies around the generic one
        self.sigma = config.deviations.of(self.given)  # (camera, parameter) how far off the calibration may be
        self._world_floats = bool(self.sigma[:, POSITION].any())  # all cameras and the person may move together
        names, distance = self.given.names, config.distance
        self._stated_fixed = None if config.fixed is None else names.index(config.fixed)
        # Whether nothing but the choice of the camera that stands still says where the world is.
        self.world_is_chosen = self._world_floats and self._stated_fixed is None
        # Lengths that give the scale.
        self._known: list[KnownLength] = []
        if config.height is not None:
            self._known.append(camera_problem.known_height(self.space, config.height))
        if distance is not None:
            one, other = (names.index(name) for name in distance[:2])
            self._known.append(camera_problem.known_distance(self.given, one, other, distance[2]))

    def start(self) -> np.ndarray:
        """The changes by which silhouettes agree where they did not; otherwise zeros."""
        none = np.zeros(self.sigma.shape)
        # Only rotations are free, or principal points where rotations are held.
        free = ROTATION if self.sigma[:, ROTATION].any() else camera_changes.CENTRE
        sigma = none.copy()
        sigma[:, free] = _START_RANGE * self.sigma[:, free]
        if self._stated_fixed is not None:
            sigma[self._stated_fixed] = 0.0
        observations = self.footage.observations(none[:, OFFSET])
        if not sigma.any() or not observations or len(self.given) < 3:  # two views have no hull
            return none
        # The solution is taken only where the silhouettes' hulls agree better with it.
        solution = LandmarkProblem(self.given, landmarks(self.given, observations), self.footage.fps, sigma).solve()
        some = observations[:: max(1, len(observations) // _COHERENCE_FRAMES)]
        before, after = (nanmean(coherence(changed(self.given, each), some), axis=0) for each in (none, solution))
        return solution if after > before + _MIN_COHERENCE_GAIN else none

    def fit_body(self, change: np.ndarray) -> Subject:
        """The body in its first pose."""
        self.footage.check_length()
        if self.config.subject is not None:
            return self.config.subject
        count = max(1, round(_FIT_SECONDS * self.footage.fps))
        config = FitConfig(seed=self.config.seed, device=self.device, threads=self.threads)
        observations = self.footage.observations(change[:, OFFSET])[:count]
        remedy = "look at the masks (mmocap mask), and check that they belong to these cameras"
        with input_errors(self.scene.path, "{error}", remedy, NoSubjectError):
            return fit_clip(self._body, changed(self.given, change), self.footage.fps, observations, config)

    def track_person(self, change: np.ndarray, subject: Subject) -> Person:
        """The person through all frames."""
        # Masks are shifted by whole frames; what is left of the offsets goes with each observation.
        observations = self.footage.observations(change[:, OFFSET])
        lag = self.footage.rest(change[:, OFFSET])
        seen = [replace(observation, late=-lag) for observation in observations] if lag.any() else observations
        config = TrackConfig(seed=self.config.seed, device=self.device, threads=self.threads)
        rig, fps = changed(self.given, change), self.footage.fps
        result = track_observations(subject, rig, seen, fps, config)
        found = np.flatnonzero(np.isin(result.status[0], _FOUND_STATUS))
        if len(found) < 2 * MIN_FRAMES:
            problem = f"the person was tracked in {len(found)} of {len(seen)} frames, {2 * MIN_FRAMES} are needed"
            remedy = "choose other frames with --frames, or start from a better calibration"
            raise InputError(self.scene.path, problem, remedy)
        rooting = Rooting(self._body.skeleton, subject.root_base, self._body.skeleton.searched())
        return Person(subject, observations, Motion(rooting, rooting.enter(result.pose[0]), fps), found)

    def lag_costs(self, change: np.ndarray, person: Person, frames: np.ndarray) -> np.ndarray:
        """(lag, frame, camera) cost of each view against the body as it was so many of the scene's frames earlier.

        Lags run as far to either side as cameras may be late.
        """
        fps = self.scene.fps
        reach = min(_MAX_LAG, int(np.ceil(2 * self.config.deviations.offset * fps)))
        seen, rig = [person.observations[frame] for frame in frames], changed(self.given, change)
        fitter = space_fitter(self.space, rig, seen, self.device, self.threads, lens=True)
        fitter.reshape(*self.space.at(self.space.nearest(person.subject.body), self._body.tracking_vertex))
        shifted = (person.motion.at(frames - lag * self.footage.fps / fps) for lag in np.arange(-reach, reach + 1))
        return np.stack([fitter.linearise_views(np.arange(len(frames)), poses).cost for poses in shifted])

    def add_whole_lags(self, change: np.ndarray, person: Person) -> tuple[np.ndarray, Person]:
        """The changes with whole frames by which cameras lag, and the person tracked anew where there are any."""
        costs = self.lag_costs(change, person, person.spread(self.config.frames)).sum(axis=1)
        reach = len(costs) // 2
        # A view's best lag counts only where it is clearly better than no lag.
        own = np.where(costs.min(axis=0) < _LAG_COST_RATIO * costs[reach], costs.argmin(axis=0) - reach, 0)
        if not own.any():
            return change, person
        # Lags count from the fixed camera, or from most cameras.
        own -= int(np.median(own)) if self._stated_fixed is None else own[self._stated_fixed]
        later = change.copy()
        later[:, OFFSET] += own / self.scene.fps
        return later, self.track_person(later, person.subject)

    def sigma_with_fixed(self, fixed: int) -> np.ndarray:
        """How far cameras may be, where one gives the time, and stands still if nothing else holds the world."""
        sigma = self.sigma.copy()
        sigma[fixed, OFFSET] = 0.0
        if self._world_floats or self._stated_fixed is not None:
            sigma[fixed, ROTATION], sigma[fixed, POSITION] = 0.0, 0.0
        return sigma

    def sigma_in_place(self) -> np.ndarray:
        """How far cameras may be if they may turn, and their principal points and times may be off, but no more."""
        sigma = self.sigma.copy()
        sigma[:, POSITION], sigma[:, camera_changes.FOCAL] = 0.0, 0.0
        return sigma

    def solve(
        self,
        change: np.ndarray,
        person: Person,
        sigma: np.ndarray,
        *,
        again: bool = False,
        beside: CameraSolution | None = None,
    ) -> CameraSolution:
        """Cameras about their calibration by ``sigma`` (camera, parameter), from frames over the clip.

        ``again`` takes fewer steps: for cameras that were solved for before, with which the person was tracked. Where
        they were solved ``beside`` a distortion that was held, a single step from there says what that would be.
        """
        frames, motion = person.spread(self.config.frames), person.motion
        lag = self.footage.rest(change[:, OFFSET]) - change[:, OFFSET]  # the lag with which masks were read
        problem = CameraProblem(self.given, lag, self.space, motion.rooting, PRIOR, sigma, tuple(self._known))
        seen, velocity = [person.observations[frame] for frame in frames], motion.velocity(frames)
        if beside is not None:
            start, margins = (beside.rooted, velocity, beside.beta, beside.change), beside.larger
            return problem.solved(seen, *start, ((_NEAR, 0),), self.device, self.threads, margins)
        start = motion.rooted[frames], velocity, self.space.nearest(person.subject.body), change
        return problem.solved(seen, *start, _FROM_NEAR if again else FROM_FAR, self.device, self.threads)

    def stillest_camera(self, change: np.ndarray) -> int:
        """The camera beside which the others move least; many that move a little count more than one that moves far."""
        if self._stated_fixed is not None:
            return self._stated_fixed
        moves = np.array([self.relative_to(change, camera)[0] for camera in range(len(change))])
        turns, shifts = (moves[..., ROTATION] / _TURN_UNIT) ** 2, (moves[..., POSITION] / _SHIFT_UNIT) ** 2
        return int(np.argmin(np.log1p(turns.sum(axis=-1) + shifts.sum(axis=-1)).sum(axis=1)))

    def relative_to(self, change: np.ndarray, fixed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same cameras in a world in which one of them has not moved, and how the old world lies in that one.

        That is a rotation (3, 3) and a shift (3,) [m]. Times count from that camera's too.
        """
        own = change.copy()
        own[:, OFFSET] -= change[fixed, OFFSET]
        if not self._world_floats:
            return own, np.eye(3), np.zeros(3)
        rig, given = changed(self.given, change), self.given
        turn, shift = given.R[fixed].T @ rig.R[fixed], given.R[fixed].T @ (rig.t[fixed] - given.t[fixed])
        moved = camera_changes.difference(given, replace(rig, R=rig.R @ turn.T, t=rig.t - rig.R @ turn.T @ shift))
        moved[:, OFFSET] = own[:, OFFSET]
        return moved, turn, shift
