"""Which camera disagrees with the others, and why.

Gross mistakes, such as a mirrored picture or the masks of another camera, show in the silhouettes' hull. Where cameras
are somewhat off besides, they show in two landmarks of each silhouette: of all ways to put one thing right, the check
names the one after which the views agree. Smaller errors show in contours: cameras, times, body and poses are adjusted
together, and the check names the changes of one camera in one respect that explain what the adjustment gained.
"""

import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.calibration.adjust import camera_changes
from mmocap_warp.calibration.adjust.adjustment import AdjustConfig, Adjustment, CameraSolution, Person, Progress
from mmocap_warp.calibration.adjust.silhouette_agreement import LandmarkProblem, coherence, landmarks
from mmocap_warp.calibration.first_look import few_views, look
from mmocap_warp.calibration.gross_mistake import IMAGE_SIZE, MIRRORED, SWAPPED, Mistake, repairs
from mmocap_warp.calibration.refine.refinement import CLEAR, STATED
from mmocap_warp.calibration.sync.lag_course import lag_course, peak
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import intersection_over_union, silhouettes
from mmocap_warp.masks.observation import unpack_masks
from mmocap_warp.result.pose_errors import nanmean
from mmocap_warp.scene.recording import Scene

_MOVED, _DISTORTION = "rotation and position", "distortion"
CAUSES: dict[str, slice] = {
    "rotation": camera_changes.ROTATION,
    "position": camera_changes.POSITION,
    _MOVED: slice(camera_changes.ROTATION.start, camera_changes.POSITION.stop),
    "focal length": slice(camera_changes.FOCAL, camera_changes.FOCAL + 1),
    "principal point": camera_changes.CENTRE,
    _DISTORTION: slice(camera_changes.RADIAL, camera_changes.RADIAL + 1),
    "time offset": slice(camera_changes.OFFSET, camera_changes.OFFSET + 1),
}
"""What may be somewhat wrong with one camera, and the parameters that put it right."""

_SOUND_MISS = 0.045  # metres: root mean square by which rays of a sound rig miss each other at most
_GROSS_RATIO = 0.6  # one gross mistake put right must bring the rays' misses below this share
_MAX_MISS = 0.3  # metres: misses beyond this count as this
_MIN_DISTANCE = CLEAR * STATED  # a frame's standard deviations, in the mean of a change's parameters
_PARAMETER_COST = 0.5  # cost in a frame that each parameter of a change explains by chance alone
_TIE_RATIO = 0.85  # causes that explain this share of what the best one explains are as likely
_LAG_FRAMES, _LAG_STRETCH = 48, 6  # frames whose lags are compared, and those of each stretch of the recording
_LEAST_CONTRAST = 0.2  # a stretch that tells lags apart by less than this share of the median does not count
_MIN_COMMON = 0.7  # share of what distortions explain that a common one explains where all lenses lack it
_MAX_RADIAL = 0.2  # standard deviation of the radial distortion k1 that a calibration lacks
_FRAMES = 8  # frames in which silhouettes are compared with the hull of the others


@dataclass(frozen=True, eq=False)
class Finding:
    """A camera that disagrees."""

    camera: str  # its name
    cause: str  # one of ``CAUSES``, that of the gross mistake, ``dropped frames`` or ``frame rate``
    # (camera, parameter) that puts it right; None where no change of the parameters does
    change: np.ndarray | None = None
    explained: float = 1.0  # share of all error that this explains, in 0 to 1
    others: tuple[str, ...] = ()  # causes that explain nearly as much
    mistake: Mistake | None = None  # the gross mistake, where it is one
    words: str = ""  # what is wrong, in words, where it is no change of the parameters

    @classmethod
    def of(cls, mistake: Mistake) -> Self:
        """A gross mistake as a finding."""
        return cls((mistake.cameras or ("all cameras",))[0], mistake.cause, mistake=mistake, words=str(mistake))


@dataclass(frozen=True, eq=False)
class BodyInView:
    """A frame of a camera that disagrees; the images are (height, width) bool."""

    camera: str  # its name
    mask: np.ndarray  # what it saw
    before: np.ndarray  # the body as the camera was calibrated
    after: np.ndarray  # and as it would be put right


@dataclass(frozen=True, eq=False, repr=False)
class CameraCheck:
    """The result of a check."""

    names: tuple[str, ...]  #: of the cameras
    covered: np.ndarray  #: (camera,) share of each camera's silhouettes that the hull of the others covers
    overlap: np.ndarray | None  #: (camera,) IoU of its masks and the tracked body; None where none was tracked
    findings: tuple[Finding, ...]  #: what is wrong, the worst first
    scale: float  #: of the images whose pixels the changes count
    views: tuple[BodyInView, ...] = ()  #: of the cameras with small errors
    pictures: tuple[Path, ...] = ()  #: the files into which these views were drawn

    def __repr__(self) -> str:
        wrong = ", ".join(f"{finding.camera} ({finding.cause})" for finding in self.findings)
        verb = "disagrees" if len({finding.camera for finding in self.findings} & {*self.names}) == 1 else "disagree"
        return f"CameraCheck: {f'{wrong} {verb}' if wrong else f'all {len(self.names)} cameras agree'}"


def check(
    scene: Scene, body: BodyModel, config: AdjustConfig | None = None, progress: Progress | None = None
) -> CameraCheck:
    """Say which camera of a scene disagrees with the others.

    The body is the generic one that the person's is expected to be near to; ``progress`` is called after every stage.
    Raises an InputError for masks that show nobody, or too few frames in which the person could be tracked.
    """
    adjustment = Adjustment(scene, body, config or AdjustConfig())
    report = progress or (lambda stage, done: None)
    rig, footage = adjustment.given, adjustment.footage
    observations = footage.observations(np.zeros(len(rig)))
    covered = coherence(rig, observations[:: max(1, len(observations) // _FRAMES)])
    report("silhouettes", 0.1)
    # A gross mistake ends the check, because no body can be tracked with it.
    views = few_views(scene)
    mistake = views.mistake()[1] if views.large_enough else None
    mistake = mistake or gross_mistake(rig, landmarks(rig, observations), footage.fps)
    if mistake is not None:
        return CameraCheck(rig.names, covered, None, (Finding.of(mistake),), footage.scale)
    # Otherwise the person is tracked, and the cameras are adjusted.
    change = adjustment.start()
    subject = adjustment.fit_body(change)
    report("body", 0.5)
    change, person = adjustment.add_whole_lags(change, adjustment.track_person(change, subject))
    # A lag that changes midway is no change of the parameters, and would look like other errors.
    findings = changing_lags(adjustment, change, person)
    if findings:
        return CameraCheck(rig.names, covered, None, findings, footage.scale)
    # Outlines are compared as pinholes see them, so that distortions are solved for in a step of their own.
    sigma = adjustment.sigma.copy()
    solution = adjustment.solve(change, person, sigma)
    sigma[:, camera_changes.RADIAL] = _MAX_RADIAL
    solution = adjustment.solve(change, person, sigma, beside=solution)
    report("cameras", 0.9)
    findings = tuple(with_words(finding, adjustment) for finding in small_errors(rig, solution))
    overlap, pictures = _compare_views(rig, person, solution, findings)
    # A view that shows nothing of the body adds nothing to the errors.
    if not findings and not scene.has_others and (problem := look(scene, None, views=views).problem) is not None:
        findings = (Finding("all cameras", "masks", words=problem),)
    report("compared", 1.0)
    return CameraCheck(rig.names, covered, overlap, findings, footage.scale, pictures)


def with_words(finding: Finding, adjustment: Adjustment) -> Finding:
    """A finding with what to do where the lens is not as it was calibrated."""
    if finding.cause != _DISTORTION or finding.change is None:
        return finding
    # How far the distortion moves the middle of the image's shorter edge, in pixels of the calibrated images.
    camera = adjustment.scene.calibrated.select((finding.camera,))
    radial = float(finding.change[adjustment.given.names.index(finding.camera), camera_changes.RADIAL])
    focal, edge = camera.K[0, 0, 0], 0.5 * float(camera.size.max())
    what = "wrong" if camera.distortion.any() else "ignored"
    words = (
        f"{finding.camera}: distortion {what}, by {abs(radial) * edge**3 / focal**2:.0f} px at the image's edge; "
        f"calibrate its lens, or add {radial:+.2f} to the first of its distortions in the calibration, then run: "
        f"mmocap calib check {shlex.quote(str(adjustment.scene.path))}"
    )
    return replace(finding, words=words)


def changing_lags(adjustment: Adjustment, change: np.ndarray, person: Person) -> tuple[Finding, ...]:
    """The cameras that dropped frames or run at another rate, by the lags of their views behind the tracked body."""
    frames, scene = person.spread(_LAG_FRAMES), adjustment.scene
    costs = adjustment.lag_costs(change, person, frames)
    stretches = np.array_split(np.arange(len(frames)), max(1, len(frames) // _LAG_STRETCH))
    numbers = scene.first_frame + frames * scene.fps / adjustment.footage.fps
    middles = np.array([numbers[part].mean() for part in stretches])
    costs = np.stack([costs[:, part].sum(axis=1) for part in stretches], axis=1)
    contrast = (costs.mean(axis=0) - costs.min(axis=0)).sum(axis=1)  # little where the person stands still
    moving = contrast >= _LEAST_CONTRAST * np.median(contrast)
    findings = []
    for k, source in enumerate(scene.cameras):
        lags = np.array([peak(-each) for each in costs[:, moving, k].T]) - len(costs) // 2
        course = lag_course(middles[moving], lags)
        if course.changes:
            fault = course.fault(source.name, scene.fps * source.rate * (1 + course.slope))
            findings.append(Finding(source.name, "dropped frames" if course.jump else "frame rate", words=fault))
    return tuple(findings)


def _compare_views(
    rig: CameraRig, person: Person, solution: CameraSolution, findings: tuple[Finding, ...]
) -> tuple[np.ndarray, tuple[BodyInView, ...]]:
    """Overlaps (camera,) of masks and the tracked body, and views of the cameras that disagree."""
    # The tracked body in some frames, seen by the cameras as calibrated and as solved.
    solved_rig = camera_changes.changed(rig, solution.change)
    frames = person.spread(_FRAMES)
    body, rooting = person.subject.body, person.motion.rooting
    poses = rooting.leave(person.motion.rooted[frames], np.zeros(3))
    vertices = Poser(body, person.subject.root_base).tracking_vertices(poses)
    overlap = np.full((len(frames), len(rig)), np.nan)
    views: list[BodyInView] = []
    for number, (frame, posed) in enumerate(zip(frames, vertices, strict=True)):
        masks = unpack_masks(person.observations[frame].words, rig.size)
        before, after = silhouettes(rig, posed, body.tracking_face), silhouettes(solved_rig, posed, body.tracking_face)
        pairs = zip(masks, before, strict=True)
        overlap[number] = [intersection_over_union(*pair) if pair[0].any() else np.nan for pair in pairs]
        # The middle frame is kept for pictures.
        if number == len(frames) // 2:
            at = [rig.names.index(finding.camera) for finding in findings]
            views = [BodyInView(rig.names[k], masks[k], before[k], after[k]) for k in at]
    return nanmean(overlap, axis=0), tuple(views)


def gross_mistake(rig: CameraRig, seen: np.ndarray, fps: float) -> Mistake | None:
    """A mistake that puts one camera, or two that have each other's masks, out of all agreement.

    ``seen`` is (frame, camera, point, 2), see :func:`~mmocap_warp.calibration.adjust.silhouette_agreement.landmarks`.
    """
    miss = _landmark_miss(rig, seen, fps)
    if miss < _SOUND_MISS:
        return None
    # Try every mistake of one camera, its pictures mirrored or of another size, and every exchange of two cameras.
    trials = [
        (_landmark_miss(repaired, seen, fps), mistake)
        for mistake, repaired in repairs(rig)
        if mistake.cameras is not None and mistake.cause in (MIRRORED, IMAGE_SIZE, SWAPPED)
    ]
    # The best must be clearly better than the rig as it is, and better than turning a camera.
    best, mistake = min(trials, key=lambda trial: trial[0])
    turned = min(_landmark_miss(rig, seen, fps, turned=k) for k in range(len(rig)))
    return mistake if best < min(_GROSS_RATIO * miss, turned) else None


def _landmark_miss(rig: CameraRig, seen: np.ndarray, fps: float, turned: int | None = None) -> float:
    """Root mean square of the landmarks' errors [m], once the camera ``turned`` is turned as is best."""
    sigma = np.zeros((len(rig), len(camera_changes.KINDS)))
    if turned is not None:
        sigma[turned, camera_changes.ROTATION] = np.radians(15.0)
    problem = LandmarkProblem(rig, seen, fps, sigma)
    error = problem.errors(np.zeros(sigma.shape) if turned is None else problem.solve())
    length = np.minimum(np.linalg.norm(error, axis=-1), _MAX_MISS)
    return float(np.sqrt(np.nanmean(length**2))) if np.isfinite(length).any() else float("inf")


class _Change(NamedTuple):
    """A change of one camera in one respect: what it gains beside others, and its parameters' numbers."""

    gain: float
    camera: int
    cause: str
    parameters: list[int]
    others: tuple[str, ...] = ()


def _likelihood(change: _Change) -> float:
    """What a change gains beyond chance; one that holds others as special cases must gain more than they do."""
    handicap = _TIE_RATIO if change.cause in (_MOVED, _DISTORTION) else 1.0  # one camera's distortion looks like others
    return change.gain * handicap - _PARAMETER_COST * len(change.parameters)


def _common_distortion(solution: CameraSolution) -> tuple[float, float]:
    """The radial distortion that all cameras lack alike, and its standard deviations from zero beside all else.

    These are 0 where most of what distortion explains is different from camera to camera.
    """
    own = np.argwhere(solution.free)[:, 1] == camera_changes.RADIAL
    if not own.any():
        return 0.0, 0.0
    values, weight = solution.change[solution.free][own], np.linalg.inv(solution.covariance[np.ix_(own, own)])
    radial = float((weight @ values).sum() / weight.sum())
    common = radial**2 * float(weight.sum())
    return radial, float(np.sqrt(common)) if common > _MIN_COMMON * float(values @ weight @ values) else 0.0


def small_errors(rig: CameraRig, solution: CameraSolution) -> tuple[Finding, ...]:
    """Changes of one camera in one respect that are significant, those that explain most first.

    Around the adjusted cameras the contours' cost is quadratic, and so is what any change alone would gain: half the
    squared Mahalanobis distance of its parameters. Changes are chosen one after the other, each beside those before it,
    and each camera is named once. That a camera was both turned and moved counts where neither alone does as much. A
    distortion that was ignored in all cameras looks like many other errors, so it comes first and alone.
    """
    value, information = solution.change[solution.free], np.linalg.inv(solution.covariance)
    gradient = information @ value  # of the cost where the cameras were
    total = 0.5 * float(value @ gradient)
    radial, distance = _common_distortion(solution)
    if distance >= _MIN_DISTANCE:
        changes = np.zeros((len(rig), *solution.free.shape))
        changes[np.arange(len(rig)), np.arange(len(rig)), camera_changes.RADIAL] = radial
        explained = 0.5 * distance**2 / total
        return tuple(Finding(name, _DISTORTION, each, explained) for name, each in zip(rig.names, changes, strict=True))
    number = np.full(solution.free.shape, -1)  # of each parameter among those that are free
    number[solution.free] = np.arange(len(value))

    def best_step(parameters: list[int]) -> np.ndarray:
        return np.linalg.solve(information[np.ix_(parameters, parameters)], gradient[parameters])

    def gain_of(parameters: list[int]) -> float:
        return 0.5 * float(gradient[parameters] @ best_step(parameters))

    # Choose the change that gains most, until none gains enough.
    chosen: dict[int, _Change] = {}
    held: list[int] = []
    before = 0.0
    while options := [
        _Change(gain_of(held + own) - before, k, cause, own)
        for k in range(len(rig))
        for cause, columns in CAUSES.items()
        if k not in chosen and (own := [int(each) for each in number[k, columns] if each >= 0])
    ]:
        best = max(options, key=_likelihood)
        if 2 * best.gain < _MIN_DISTANCE**2 * len(best.parameters):
            break
        as_likely = [each for each in options if each.camera == best.camera and each.gain > _TIE_RATIO * best.gain]
        others = tuple(each.cause for each in as_likely if each.cause not in (_MOVED, best.cause))
        chosen[best.camera] = best._replace(others=others)
        held += best.parameters
        before = gain_of(held)
    # The chosen changes together.
    change, camera = np.zeros(solution.free.shape), np.arange(len(rig))[:, None]
    change[tuple(np.argwhere(solution.free)[held].T)] = best_step(held)
    return tuple(
        Finding(rig.names[k], best.cause, np.where(camera == k, change, 0.0), best.gain / total, best.others)
        for k, best in chosen.items()
    )
