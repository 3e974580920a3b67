"""Cameras and their times made better by the person before them.

Cameras, times, body and poses are adjusted, the person is tracked again with the result, and so on. Frames that had no
part in it judge whether that is better than before.

**Only those parameters change that have to.** Every camera that may turn, move and zoom explains masks a little better,
and is a little wrong by that. So the parameters that matter least return to where they were and the others follow, as
long as they matter less than chance does (backward elimination). What belongs together, such as a position along three
axes, returns together: a camera that was moved has moved along its view too, and a longer lens, which looks nearly like
that alone, is not needed beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.calibration.adjust.adjustment import AdjustConfig, Adjustment, Person, Progress
from mmocap_warp.calibration.adjust.camera_changes import CENTRE, OFFSET, POSITION, RESPECT, changed, groups_of
from mmocap_warp.calibration.adjust.camera_problem import CameraProblem, CameraSolution
from mmocap_warp.calibration.adjust.silhouette_agreement import LandmarkProblem, landmarks
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import intersection_over_union, silhouettes
from mmocap_warp.contour.frame.fitter import WIDE, MatchingConfig
from mmocap_warp.fitting.frame_fit import PRIOR
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.scene.recording import Scene

_ROUNDS = 2
_STAGES = ((WIDE, 4), (MatchingConfig(), 8))  # how contours are matched, and the steps of each stage
STATED = 0.5
"""Share of one frame's standard deviations that is stated for all frames: measured on made people, moving or not."""
CLEAR = 4.0
"""Standard deviations by which parameters that belong together must differ from where they were, in the mean."""
_MAX_LEFT = 0.7  # mean distance, in deviations, of what stays: 0.25 to 0.55 beside one wrong camera, else 0.84 on
_MAX_COST_RATIO = 1.1  # cost of the contours with the chosen changes over that with all of them, at most
_NEGLIGIBLE_COST = 0.5 * CLEAR**2  # cost in a frame that one parameter must explain to be clear
UNDETERMINED = 0.7
"""A parameter known no better than this share of its prior standard deviation is not determined."""


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Intersection over union of masks and the body."""

    together: np.ndarray  # (camera,) means over the frames, with body and poses from all views
    apart: np.ndarray  # (camera,) the same, of each view with body and poses from the other views alone


@dataclass(frozen=True, eq=False, repr=False)
class Refinement:
    """Refined cameras."""

    rig: CameraRig  #: the calibrated cameras at full size, with the changes
    #: (camera, parameter) by which they differ from the calibration, see
    #: :data:`~mmocap_warp.calibration.adjust.camera_changes.KINDS`; pixels are those of the calibrated images
    change: np.ndarray
    sigma: np.ndarray  #: (camera, parameter) standard deviations; for parameters that stayed, what they would be
    moved: np.ndarray  #: (camera, parameter) bool: those that changed; all others are exactly what they were
    undetermined: np.ndarray  #: (camera, parameter) bool: those that the masks do not determine
    fixed: int | None  #: number of the camera that stood still; None where all cameras kept their places
    before: Overlaps  #: how well frames that had no part were explained by the cameras as given
    after: Overlaps  #: how well these are explained with the changes
    settled: bool = True  #: whether the changes explain the outlines about as well as if all parameters had changed

    @property
    def better(self) -> bool:
        """Whether frames that had no part are explained better, all views together and each by the others alone."""
        pairs = (self.before.together, self.after.together), (self.before.apart, self.after.apart)
        better = all(np.nanmean(after) > np.nanmean(before) for before, after in pairs)
        return better and self.settled and bool(self.moved.any())

    def offsets(self, scene: Scene) -> dict[str, float]:
        """The delay of each camera of the refined scene with the changes, as a scene file states it [s]."""
        return {
            source.name: round((source.frame_offset + source.fraction) / (scene.fps * source.rate) + float(change), 6)
            for source, change in zip(scene.cameras, self.change[:, OFFSET], strict=True)
        }

    def __repr__(self) -> str:
        moved = [name for name, kinds in zip(self.rig.names, self.moved, strict=True) if kinds.any()]
        before, after = (float(np.nanmean(each.together)) for each in (self.before, self.after))
        verdict = "better" if self.better else "not better"
        names = ", ".join(moved) or "no camera"
        return f"Refinement: {names} moved, held-out IoU {before:.3f} to {after:.3f}, {verdict}"


def refine(
    scene: Scene, body: BodyModel, config: AdjustConfig | None = None, progress: Progress | None = None
) -> Refinement:
    """Refine a scene's cameras by a person whose body is near to the generic ``body``.

    Raises:
        ValueError: a camera that the scene does not have.
        InputError: masks that show nobody, too few frames in which the person could be tracked.
    """
    adjustment = Adjustment(scene, body, config or AdjustConfig())
    report = progress or (lambda stage, done: None)
    change = adjustment.start()
    report("silhouettes", 0.05)
    subject = adjustment.fit_body(change)
    report("body", 0.3)
    change, person = adjustment.add_whole_lags(change, adjustment.track_person(change, subject))
    # Solve and track in turns.
    stillest = adjustment.stillest_camera(change)
    fixed: int | None = stillest
    sigma = adjustment.sigma if adjustment.world_is_chosen else adjustment.sigma_with_fixed(stillest)
    for number in range(_ROUNDS):
        solution = adjustment.solve(change, person, sigma, again=number > 0)
        # Cameras that need not have moved stay in their places, all of them, and so does the world.
        if number == 0 and adjustment.world_is_chosen:
            in_place = adjustment.solve(change, person, adjustment.sigma_in_place())
            if in_place.cost < solution.cost + _NEGLIGIBLE_COST:
                solution, fixed, sigma = in_place, None, adjustment.sigma_in_place()
        # Otherwise the world is that of a camera that stands still, which is chosen anew each time.
        change, turn, shift = solution.change, np.eye(3), np.zeros(3)
        if fixed is not None:
            fixed = adjustment.stillest_camera(change)
            change, turn, shift = adjustment.relative_to(change, fixed)
            sigma = adjustment.sigma_with_fixed(fixed)
        # The person in that world, from the pose of the first frame if that was solved for.
        subject, rooting = person.subject, person.motion.rooting
        first = rooting.leave(solution.rooted[:1], subject.pose[ROOT_ANGLES])[0]
        pose = (first if person.found[0] == 0 else subject.pose).astype(float)
        pose[:3] = turn @ pose[:3] + shift
        body, root_base = adjustment.space.model(solution.beta), turn @ subject.root_base
        person = adjustment.track_person(change, replace(subject, body=body, root_base=root_base, pose=pose))
        report("cameras", 0.5 + 0.15 * number)
    refinement = _select_and_judge(adjustment, change, person, sigma, fixed)
    report("judged", 1.0)
    return refinement


def _select_and_judge(
    adjustment: Adjustment, change: np.ndarray, person: Person, sigma: np.ndarray, fixed: int | None
) -> Refinement:
    """The refinement in which only those parameters change that have to, judged by held-out frames."""
    solution = adjustment.solve(change, person, sigma, again=True)
    free = solution.free
    moved, determined, deviation = np.zeros(free.shape, bool), ~free, np.zeros(free.shape)
    moved[free], determined[free], deviation[free] = select_parameters(
        solution.change[free], solution.covariance, sigma[free], groups_of(len(free))[free]
    )
    if fixed is None:
        moved = with_all_cameras(moved, solution)
    # Solve once more for these alone.
    change, beta, most = np.where(moved, solution.change, 0.0), solution.beta, _MAX_COST_RATIO * solution.cost
    for attempt in range(2 if moved.any() else 0):
        # The person is tracked once more where it is stuck beside what explains its outlines.
        if attempt:
            person = adjustment.track_person(change, person.subject)
        solution = adjustment.solve(change, person, np.where(moved, sigma, 0.0), again=True)
        change, beta = solution.change, solution.beta
        if solution.cost <= most:
            break
    before, after = (_held_out_overlaps(adjustment, person, beta, each) for each in (np.zeros_like(change), change))
    if fixed is not None and adjustment.world_is_chosen and implausible(moved):
        change = _in_the_mean_world(adjustment, person, change)
        moved[:, POSITION] = True
    # Principal points are given in pixels of the calibrated images.
    full = np.ones(change.shape)
    full[:, CENTRE] = 1.0 / adjustment.footage.scale
    rig = changed(adjustment.scene.calibrated, full * change)
    settled = solution.cost <= most
    return Refinement(rig, full * change, STATED * full * deviation, moved, ~determined, fixed, before, after, settled)


def with_all_cameras(moved: np.ndarray, solution: CameraSolution) -> np.ndarray:
    """What moved (camera, parameter) in any camera, in all of them, where those that stayed are a little off too.

    If one of these stayed, the world would be wrong by as much as that camera is. Each parameter that stayed may be off
    by chance alone; together they may not be.
    """
    stayed = solution.free & ~moved
    own, value = stayed[solution.free], solution.change[stayed]
    squared = float(value @ np.linalg.solve(solution.covariance[np.ix_(own, own)], value))
    if not moved.any() or squared <= _MAX_LEFT**2 * len(value):
        return moved
    # What most cameras changed in is enough.
    respect = max(RESPECT.tolist(), key=lambda each: moved[:, each == RESPECT].any(axis=1).sum())
    return moved | (solution.free & (respect == RESPECT))


def implausible(moved: np.ndarray) -> bool:
    """Whether most cameras but not all moved (camera, parameter): those that stayed may be the wrong ones.

    Somebody who stays in one place does not tell their principal points from the others' rotations.
    """
    return 0.5 < float(moved.any(axis=1).mean()) < 1.0


def _in_the_mean_world(adjustment: Adjustment, person: Person, change: np.ndarray) -> np.ndarray:
    """The same cameras in a world that is shifted so that the person stays, in the mean, where the given ones see it.

    The errors of all cameras average out there.
    """
    given, now = adjustment.given, change.copy()
    now[:, OFFSET] = 0.0  # the observations are in step as they are
    seen = landmarks(given, person.observations)
    problem = LandmarkProblem(given, seen, adjustment.footage.fps, np.zeros(change.shape))
    apart = (problem.points(np.zeros(change.shape)) - problem.points(now)).reshape(-1, 3)
    apart = apart[np.isfinite(apart).all(axis=1)]
    shifted = change.copy()
    if len(apart):
        shifted[:, POSITION] += given.R @ apart.mean(axis=0)
    return shifted


def _held_out_overlaps(adjustment: Adjustment, person: Person, beta: np.ndarray, change: np.ndarray) -> Overlaps:
    """How well changed cameras explain frames that they were not solved from, with the body and poses that fit best."""
    # The frames, with the cameras held.
    config, footage, motion = adjustment.config, adjustment.footage, person.motion
    frames = person.between(config.judges, person.spread(config.frames))
    velocity, held = motion.velocity(frames), np.zeros(change.shape)
    rig, lag = changed(adjustment.given, change), footage.rest(change[:, OFFSET])
    read = footage.observations(change[:, OFFSET])
    observations = [read[frame] for frame in frames]
    problem = CameraProblem(rig, lag, adjustment.space, motion.rooting, PRIOR, held, larger=0)

    def solved(seen: Sequence[Observation]) -> CameraSolution:
        threads = adjustment.threads
        return problem.solved(seen, motion.rooted[frames], velocity, beta, held, _STAGES, adjustment.device, threads)

    # Each view is judged by a body and poses that it had no part in, and by those of all views.
    views = range(len(rig))
    apart = [solved([each.without(view) for each in observations]) for view in np.eye(len(rig), dtype=bool)]
    overlaps = [
        np.array([_mean_overlap(problem, solutions[k], k, velocity, observations) for k in views])
        for solutions in ([solved(observations)] * len(rig), apart)
    ]
    return Overlaps(*overlaps)


def _mean_overlap(
    problem: CameraProblem, solution: CameraSolution, k: int, velocity: np.ndarray, observations: Sequence[Observation]
) -> float:
    """Mean overlap of a view's masks with the body; NaN where it sees nobody."""
    # The body as it was when the view's images were taken.
    body, camera = problem.space.model(solution.beta), problem.rig.select((problem.rig.names[k],))
    rooted = problem.rooting.stepped(solution.rooted, -problem.lag[k] * velocity)
    vertices = Poser(body, problem.rooting.root_base).tracking_vertices(problem.rooting.leave(rooted, np.zeros(3)))
    overlaps = []
    for observation, posed in zip(observations, vertices, strict=True):
        if observation.foreground[k]:
            drawn = silhouettes(camera, posed, body.tracking_face)[0]
            mask = unpack_masks(observation.words[k : k + 1], camera.size)[0]
            overlaps.append(intersection_over_union(drawn, mask))
    return float(np.mean(overlaps)) if overlaps else float("nan")


def select_parameters(
    value: np.ndarray, covariance: np.ndarray, prior: np.ndarray, group: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Choose which parameters have to change.

    Args:
        value: (parameter,) how far each is from where it was.
        covariance: (parameter, parameter) of all.
        prior: (parameter,) standard deviations before anything was seen.
        group: (parameter,) int, the same for those that belong together.

    Returns:
        (parameter,) bool, those that have to change; (parameter,) bool, those that the data determine, each with those
        that change unknown beside it; (parameter,) their standard deviations, likewise.
    """
    information = np.linalg.inv(covariance)
    moved = np.ones(len(value), bool)
    while moved.any():
        # The best values of the parameters that are left, once the others are back at zero.
        at = np.flatnonzero(moved)
        own = np.linalg.inv(information[np.ix_(at, at)])
        best = value[at] - own @ (information[np.ix_(at, np.flatnonzero(~moved))] @ -value[~moved])
        # The group with the shortest mean Mahalanobis distance from zero returns there, unless it is clearly away.
        distance = {}
        for number in np.unique(group[at]):
            together = group[at] == number
            squared = best[together] @ np.linalg.solve(own[np.ix_(together, together)], best[together])
            distance[number] = np.sqrt(squared / together.sum())
        least = min(distance, key=lambda number: distance[number])
        if distance[least] >= CLEAR:
            break
        moved[group == least] = False
    # Each parameter's standard deviation, with those that moved unknown beside it.
    sigma = np.empty(len(value))
    for parameter in range(len(value)):
        unknown = np.flatnonzero(moved | (np.arange(len(value)) == parameter))
        own = np.linalg.inv(information[np.ix_(unknown, unknown)])
        sigma[parameter] = np.sqrt(own[unknown == parameter][:, unknown == parameter][0, 0])
    return moved, sigma <= UNDETERMINED * prior, sigma
