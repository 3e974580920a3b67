"""Which camera disagrees with the others, and why.

What is wrong at large, such as a mirrored picture or the masks of another camera, is told by two points of each
silhouette: of all ways to put one thing right, that is named after which the points meet. What is left is told by
contours: cameras, times, body and poses are adjusted together, and of all changes of one camera in one respect that is
named which alone explains most of what the adjustment gained.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.calibration.adjust.adjustment import AdjustConfig, Adjusted, Adjustment, Person, Progress
from mmocap_warp.calibration.adjust.camera_changes import CENTRE, FOCAL, KINDS, OFFSET, POSITION, ROTATION, changed
from mmocap_warp.calibration.adjust.coherence import coherence
from mmocap_warp.calibration.adjust.landmarks import LandmarkProblem, landmarks
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import intersection_over_union, silhouettes
from mmocap_warp.masks.observation import unpack_masks
from mmocap_warp.scene.recording import Scene

CAUSES: dict[str, slice] = {
    "rotation": ROTATION,
    "position": POSITION,
    "focal length": slice(FOCAL, FOCAL + 1),
    "principal point": CENTRE,
    "time offset": slice(OFFSET, OFFSET + 1),
}
"""What may be wrong with one camera by degrees, and the parameters that put it right."""

_SIZES = (0.5, 2 / 3, 0.75, 4 / 3, 1.5, 2.0)  # of images to those that a camera was calibrated for
_MEET = 0.045  # [m], root mean square by which points of a sound rig miss each other at most
_CLEARLY = 0.6  # of the points' misses, to which one mistake put right must bring them
_FAR = 0.3  # [m]: how far points miss each other beyond this says nothing
_WORTH = 0.12  # of the contours' cost, which a change must explain; on a real recording .08 are explained by chance
_COST_OF_A_PARAMETER = 0.5  # of the contours' cost in a frame: more parameters explain more, by chance alone
_AS_GOOD = 0.85  # of what the best cause explains: others that do are named too
_FRAMES = 8  # in which silhouettes are compared with the hull of the others


@dataclass(frozen=True, eq=False)
class Finding:
    """A camera that disagrees.

    Attributes:
        camera: its name.
        cause: one of ``CAUSES``, or ``mirrored``, ``image size`` or ``wrong file``.
        other: the camera whose masks or calibration it has, where the cause is a wrong file.
        by: (camera, parameter) the change that puts it right; None where no change of the parameters does.
        worth: how much of what is wrong that explains, in 0 to 1.
        size: of the images to those that were calibrated, where that is the cause.
        others: causes that explain nearly as much of it.
    """

    camera: str
    cause: str
    other: str | None = None
    by: np.ndarray | None = None
    worth: float = 1.0
    size: float | None = None
    others: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class View:
    """A frame of a camera that disagrees.

    Attributes:
        camera: its name.
        mask: (height, width) bool, what it saw.
        before, after: (height, width) bool, the body as the camera was calibrated, and as it would be put right.
    """

    camera: str
    mask: np.ndarray
    before: np.ndarray
    after: np.ndarray


@dataclass(frozen=True, eq=False)
class Check:
    """What a check found.

    Attributes:
        covered: (camera,) share of each camera's silhouettes that the hull of the others covers.
        overlap: (camera,) intersection over union of its masks and the tracked body; None where none was tracked.
        findings: what is wrong, the worst first.
        scale: of the images whose pixels the changes count.
        views: of the cameras that disagree by degrees.
    """

    covered: np.ndarray
    overlap: np.ndarray | None
    findings: tuple[Finding, ...]
    scale: float
    views: tuple[View, ...] = ()


def check(scene: Scene, body: BodyModel, config: AdjustConfig | None = None, progress: Progress | None = None) -> Check:
    """Say which camera of a scene disagrees with the others.

    Args:
        scene: the recording.
        body: the generic body that the person's is expected to be near to.
        config: settings.
        progress: told after every stage.

    Raises:
        InputError: masks that show nobody, too few frames in which the person could be followed.
    """
    adjustment = Adjustment(scene, body, config or AdjustConfig())
    told = progress or (lambda stage, done: None)
    none = np.zeros(adjustment.sigma.shape)
    observations = adjustment.footage.observations(none[:, OFFSET])
    some = observations[:: max(1, len(observations) // _FRAMES)]
    covered = coherence(adjustment.given, some)
    told("silhouettes", 0.1)
    seen = landmarks(adjustment.given, observations)
    gross = at_large(adjustment.given, seen, adjustment.footage.fps)
    if gross is not None:
        return Check(covered, None, (gross,), adjustment.footage.scale)
    change = adjustment.started()
    subject = adjustment.fitted(change)
    told("body", 0.5)
    change, person = adjustment.with_lags(change, adjustment.followed(change, subject))
    adjusted = adjustment.solved(change, person, adjustment.sigma)
    told("cameras", 0.9)
    findings = by_degrees(adjustment.given, adjusted, adjustment.sigma)
    overlap, views = _drawn(adjustment, person, adjusted, findings)
    told("compared", 1.0)
    return Check(covered, overlap, findings, adjustment.footage.scale, views)


def _drawn(
    adjustment: Adjustment, person: Person, adjusted: Adjusted, findings: tuple[Finding, ...]
) -> tuple[np.ndarray, tuple[View, ...]]:
    """Overlaps (camera,) of masks and the body that was followed, and views of those that disagree."""
    rig, right = adjustment.given, changed(adjustment.given, adjusted.change)
    frames = person.spread(_FRAMES)
    poser = Poser(person.subject.body, person.subject.root_base)
    faces = person.subject.body.tracking_face
    rooted = person.motion.rooted[frames]
    vertices = poser.tracking_vertices(person.motion.rooting.leave(rooted, np.zeros(3)))
    overlap = np.full((len(frames), len(rig)), np.nan)
    views: list[View] = []
    for number, (frame, posed) in enumerate(zip(frames, vertices, strict=True)):
        masks = unpack_masks(person.observations[frame].words, rig.size)
        before, after = silhouettes(rig, posed, faces), silhouettes(right, posed, faces)
        for k, mask in enumerate(masks):
            if mask.any():
                overlap[number, k] = intersection_over_union(mask, before[k])
        if number == len(frames) // 2:
            at = [rig.names.index(finding.camera) for finding in findings]
            views = [View(rig.names[k], masks[k], before[k], after[k]) for k in at]
    known = np.isfinite(overlap)
    mean = np.where(known, overlap, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.where(known.any(axis=0), mean, np.nan), tuple(views)


def at_large(rig: CameraRig, seen: np.ndarray, fps: float) -> Finding | None:
    """A mistake that puts one camera, or two of which each has the other's masks, out of all agreement.

    Args:
        rig: the cameras.
        seen: (frame, camera, point, 2), see :func:`~mmocap_warp.calibration.adjust.landmarks.landmarks`.
        fps: of the frames.
    """
    cameras = range(len(rig))
    as_it_is = _missed(rig, seen, fps)
    if as_it_is < _MEET:
        return None
    tried: list[tuple[float, Finding]] = []
    for k in cameras:
        flipped = seen.copy()
        flipped[:, k, :, 0] = rig.size[k, 0] - 1 - flipped[:, k, :, 0]
        tried.append((_missed(rig, flipped, fps), Finding(rig.names[k], "mirrored")))
        for size in _SIZES:
            K = rig.K.copy()
            K[k, :2] *= size
            tried.append((_missed(replace(rig, K=K), seen, fps), Finding(rig.names[k], "image size", size=size)))
    for one, other in combinations(cameras, 2):
        order = list(cameras)
        order[one], order[other] = other, one
        finding = Finding(rig.names[one], "wrong file", other=rig.names[other])
        tried.append((_missed(rig, seen[:, order], fps), finding))
    missed, finding = min(tried, key=lambda each: each[0])
    turned = min(_missed_turned(rig, seen, fps, k) for k in cameras)
    return finding if missed < min(_CLEARLY * as_it_is, turned) else None


def _missed(rig: CameraRig, seen: np.ndarray, fps: float) -> float:
    """Root mean square of how far points are seen from where they meet [m]."""
    none = np.zeros((len(rig), len(KINDS)))
    return _size(LandmarkProblem(rig, seen, fps, none).errors(none))


def _missed_turned(rig: CameraRig, seen: np.ndarray, fps: float, k: int) -> float:
    """The same once one camera is turned as is best."""
    sigma = np.zeros((len(rig), len(KINDS)))
    sigma[k, ROTATION] = np.radians(15.0)
    problem = LandmarkProblem(rig, seen, fps, sigma)
    return _size(problem.errors(problem.solved()))


def _size(error: np.ndarray) -> float:
    length = np.minimum(np.linalg.norm(error, axis=-1), _FAR)
    return float(np.sqrt(np.nanmean(length**2))) if np.isfinite(length).any() else float("inf")


def by_degrees(rig: CameraRig, adjusted: Adjusted, sigma: np.ndarray) -> tuple[Finding, ...]:
    """Changes of one camera in one respect that are worth it, those first that explain most.

    Around the adjusted cameras the contours' cost is quadratic, and so is what any change alone would gain. One is
    found after the other, each beside those before it, and each camera is named once.

    Args:
        rig: the cameras.
        adjusted: all of them adjusted.
        sigma: (camera, parameter) how far they may be from their calibration.
    """
    value, information = adjusted.change[adjusted.free], np.linalg.inv(adjusted.covariance)
    toward = information @ value  # the way in which the cost falls from where cameras were
    number = np.full(adjusted.free.shape, -1)
    number[adjusted.free] = np.arange(len(value))

    def gained(parameters: list[int]) -> float:
        step = np.linalg.solve(information[np.ix_(parameters, parameters)], toward[parameters])
        return 0.5 * float(toward[parameters] @ step)

    named: dict[int, _Option] = {}
    held: list[int] = []
    before = 0.0
    while options := [
        _Option(gained(held + own) - before, k, cause, own)
        for k in range(len(rig))
        for cause, columns in CAUSES.items()
        if k not in named and (own := [int(each) for each in number[k, columns] if each >= 0])
    ]:
        best = max(options, key=lambda option: option.gain - _COST_OF_A_PARAMETER * len(option.parameters))
        if best.gain < _WORTH * adjusted.cost:
            break
        as_good = [each for each in options if each.camera == best.camera and each.gain > _AS_GOOD * best.gain]
        others = tuple(each.cause for each in as_good if each.cause != best.cause)
        named[best.camera] = replace(best, others=others)
        held += best.parameters
        before = gained(held)
    change = np.zeros(len(value))
    change[held] = np.linalg.solve(information[np.ix_(held, held)], toward[held])
    whole = np.zeros(adjusted.free.shape)
    whole[adjusted.free] = change
    total = 0.5 * float(value @ toward)
    return tuple(
        Finding(
            rig.names[k],
            found.cause,
            by=np.where(np.arange(len(rig))[:, None] == k, whole, 0.0),
            worth=found.gain / total,
            others=found.others,
        )
        for k, found in named.items()
    )


@dataclass(frozen=True)
class _Option:
    """A change of one camera in one respect: what it gains beside others, and its parameters' numbers."""

    gain: float
    camera: int
    cause: str
    parameters: list[int]
    others: tuple[str, ...] = ()
