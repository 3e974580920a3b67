"""Which frames of a scene's cameras were taken at the same time, from the silhouettes alone."""

from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import mode

import numpy as np

from mmocap_warp.calibration.sync.hull_agreement import HullOffsets, PackedMasks, offsets_by_hull
from mmocap_warp.calibration.sync.lag_course import MIN_STRETCHES, LagCourse, lag_course, margin, peak
from mmocap_warp.calibration.sync.shared_motion import PairScores, common_offsets, pair_scores
from mmocap_warp.calibration.sync.silhouette_motion import LIKE, SilhouetteMotion
from mmocap_warp.errors import InputError, UsageError, input_errors
from mmocap_warp.scene.recording import Scene

_MAX_PIXELS = 320  # pixels of the masks' longer side
_WITHIN = 1.0  # seconds: the largest lag that is looked for by default
_MAX_SHARE = 1 / 3  # share of a clip that a lag may be
_SHORT = 0.25  # seconds: shorter lags are more plausible than longer ones
_LONG_SCORE_RATIO = 3.0  # score of a long lag over that of a short one, at least
_MIN_AGREEING = 0.5  # share of the other views that must agree alone
_HULL_REACH = 0.4  # seconds to either side in which the hull looks for offsets that motion is not sure of
_MAX_HULL_CORRECTION = 3  # frames by which the hull may correct offsets that motion is sure of
_MAX_HULL_SPREAD = 1  # frames between the ends of several starts of a hull that can be trusted
_MAX_MARGIN, _MAX_HULL_MARGIN = 2.0, 1.0  # frames: half a confidence interval of offsets by motion, and by hulls
_IN_STEP = 2  # frames: lags that are within this interval are none, where none is longer than that
_STRETCHES, _MIN_STRETCH = 6, 80  # stretches of a recording, and frames of one at least
_MIN_PART, _NEAR = 8, 6  # frames of a part that is left out of a recording at least; lags to either side without it
_MAX_CHANGE = 0.2  # seconds by which a lag may change
_MAX_RIVAL = 0.5  # score of another lag over the best, from which on a view's offset is unsure
_ALIKE = 0.75  # the same, from which on the hull looks for the offset afresh
_PAIR_TOLERANCE = 2  # frames within which a pair alone agrees with all pairs

Progress = Callable[[int, int], None]
"""Called with the number of frames that have been read, and of all."""


@dataclass(frozen=True)
class ViewOffset:
    """The time offset of one camera."""

    frames: int  # by how many of the scene's frames it lags
    rival: float  # score of the best other lag over that of this one; from ``0.5`` on the offset is not sure
    other: int  # that other lag [frames]
    agreeing: float  # share of the other views that, compared with this one alone, agree within two frames
    sure: bool  # whether the offset is reliable
    course: LagCourse = field(default_factory=LagCourse)  # how it changes
    # half the width of its confidence interval, that of the least certain view [frames]. A lag within it counts as
    # none where no view lags by more than two frames
    margin: float = 0.0

    def doubt(self, name: str, fps: float | None) -> str | None:
        """Why the offset of the camera ``name``, which runs at ``fps``, is not reliable; None where it is."""
        if self.sure:
            return self.course.fault(name, fps or 0.0) if self.course.changes else None
        if self.rival == float("inf"):
            why = "the person stands still, or it is another recording"
            return f"{name} shows no motion that the other views share: {why}"
        if self.rival >= _MAX_RIVAL:
            lag = self.other - self.frames
            when = f"{abs(lag)} frames {'later' if lag > 0 else 'earlier'}"
            return (
                f"{name} fits {100 * self.rival:.0f} % as well {when}: the motion repeats itself every {abs(lag)} "
                "frames, as steps do, or there is too little of it; record a clap, a jump or a turn too"
            )
        if self.agreeing > _MIN_AGREEING:
            known = f"only to {self.margin:.1f} frames" if np.isfinite(self.margin) else "to no precision"
            return (
                f"{name}: parts of the recording give its offset {known}: it is too short, has too little motion, or a "
                "camera has another frame rate than it says"
            )
        return f"{name} agrees with {100 * self.agreeing:.0f} % of the other views: too little motion, or poor masks"


@dataclass(frozen=True, repr=False)
class Synchronisation:
    """The time offsets of all cameras."""

    fps: float  #: of the scene's frames
    views: dict[str, ViewOffset]  #: by camera name
    hull: bool | None  #: whether the visual hull decided; None without a calibration, False where hulls could not

    @property
    def sure(self) -> bool:
        """Whether all offsets are reliable throughout the recording."""
        return all(view.sure and not view.course.changes for view in self.views.values())

    def timing(self, scene: Scene) -> dict[str, dict[str, float]]:
        """What each camera's table in the scene file has to say: ``offset`` [s], and ``fps`` where the rate differs."""
        timing = {}
        for source in scene.cameras:
            view = self.views[source.name]
            timing[source.name] = {"offset": round((view.frames + view.course.start) / self.fps, 6)}
            if view.course.slope:
                timing[source.name]["fps"] = round(self.fps * source.rate * (1 + view.course.slope), 4)
        return timing

    def faults(self, scene: Scene) -> list[str]:
        """Why offsets are not reliable, a line for each camera that is in doubt."""
        timing = self.timing(scene)
        doubts = (view.doubt(name, timing[name].get("fps")) for name, view in self.views.items())
        return [doubt for doubt in doubts if doubt is not None]

    def __repr__(self) -> str:
        lags = ", ".join(f"{name} {view.frames:+d}{'' if view.sure else '?'}" for name, view in self.views.items())
        by = "the visual hull" if self.hull else "motion"
        return f"Synchronisation by {by}, {self.fps:g} frames/s: {lags}"


def synchronise(scene: Scene, progress: Progress | None = None, within: float = _WITHIN) -> Synchronisation:
    """Find the offsets of a scene's cameras, which lag one another by ``within`` [s] at most.

    The offsets that the scene states are not used; its calibration is, where it has the cameras' places.

    Raises:
        InputError: a single camera, or one that shows nobody.
        UsageError: ``within`` is not in (0, 1000).
    """
    if not 0 < within < 1000:
        raise UsageError(f"--within must be a time in seconds, got {within:g}")
    if len(scene.cameras) < 2:
        raise InputError(scene.path, "names one camera, and synchronising needs two", "name another camera")
    # Read all masks once, each camera's in its own frames.
    recorded = scene.as_recorded()
    scale = min(1.0, _MAX_PIXELS / int(scene.calibrated.size.max()))
    motions = [SilhouetteMotion() for _ in scene.cameras]
    masks = [PackedMasks(source.rate) for source in scene.cameras]
    for number, views in enumerate(recorded.masks(scale)):
        for motion, kept, mask in zip(motions, masks, views, strict=True):
            motion.add(mask)
            kept.add(mask)
        if progress:
            progress(number + 1, recorded.frame_count)
    signals = [_signals(motion, scene, k) for k, motion in enumerate(motions)]
    scores, offsets = _offsets_by_motion(signals, scene.fps, within)
    courses, hull, by_hull = _courses_by_motion(signals, offsets, scene.fps), None, None
    # With a calibration the visual hull decides where it can be trusted.
    if scene.calibration is not None and scene.calibrated.placed:
        found = (_judge(scores, k, offsets, 0.0, course) for k, course in enumerate(courses))
        sure = all(view.rival < _ALIKE and view.agreeing > _MIN_AGREEING for view in found)
        about, reach = (offsets, 0) if sure else (np.zeros_like(offsets), round(min(_HULL_REACH, within) * scene.fps))
        by_hull = offsets_by_hull(scene.rig(scale), masks, about, reach)
        hull = by_hull is not None and _can_trust(by_hull, offsets if sure else None)
        if by_hull and hull:
            offsets = by_hull.offsets
            courses = [one if one.changes else other for one, other in zip(by_hull.courses, courses, strict=True)]
    # Whether the motion of all parts of the recording gives these offsets counts where hulls do not decide.
    margin = by_hull.margin if by_hull and hull else margin_by_motion(signals, offsets, scene.fps)
    judged = [_judge(scores, k, offsets, margin, course, hull is True) for k, course in enumerate(courses)]
    return Synchronisation(scene.fps, dict(zip((source.name for source in scene.cameras), judged, strict=True)), hull)


def _can_trust(hull: HullOffsets, motion: np.ndarray | None) -> bool:
    """Whether hulls determine the offsets; ``motion`` are those that motion is sure of, if any."""
    apart = np.zeros(1) if motion is None else hull.offsets - motion
    small = bool(np.abs(apart - np.median(apart)).max() <= _MAX_HULL_CORRECTION)
    return small and hull.spread <= _MAX_HULL_SPREAD and hull.margin < _MAX_HULL_MARGIN


def _signals(motion: SilhouetteMotion, scene: Scene, k: int) -> np.ndarray:
    """The signals of camera ``k`` at the scene's frames; an InputError where it shows nobody."""
    name, rate = scene.cameras[k].name, scene.cameras[k].rate
    where, remedy = f"{scene.path}: [cameras.{name}]", "make better masks, or leave the camera out"
    with input_errors(where, "its masks show somebody in fewer than two frames", remedy, ValueError):
        signals = motion.signals(scene.fps * rate)
    at = (np.arange(int(len(signals) / rate)) + 0.5) * rate - 0.5
    return np.stack([np.interp(at, np.arange(len(signals)), column) for column in signals.T], axis=1)


def _offsets_by_motion(signals: list[np.ndarray], fps: float, within: float) -> tuple[PairScores, np.ndarray]:
    """Scores of all lags, and the offsets; short ones unless long ones score much higher."""
    most = max(1, min(round(within * fps), int(_MAX_SHARE * min(map(len, signals)))))
    scores = pair_scores(signals, LIKE, fps, most)
    short, long = common_offsets(scores.within(min(most, round(_SHORT * fps)))), common_offsets(scores)
    return scores, long if scores.total(long) > _LONG_SCORE_RATIO * scores.total(short) else short


def _aligned(signals: list[np.ndarray], offsets: np.ndarray) -> list[np.ndarray]:
    """The signals at these offsets, in the frames that all views have there."""
    begin = offsets - offsets.min()
    length = min(len(each) - first for each, first in zip(signals, begin, strict=True))
    return [each[first : first + length] for each, first in zip(signals, begin, strict=True)]


def _courses_by_motion(signals: list[np.ndarray], offsets: np.ndarray, fps: float) -> list[LagCourse]:
    """The courses of the views' lags, from their best lags in stretches of the recording."""
    aligned, none = _aligned(signals, offsets), np.zeros(len(signals), int)
    length, reach = len(aligned[0]), round(_MAX_CHANGE * fps)
    parts = np.array_split(np.arange(length), max(1, min(_STRETCHES, length // _MIN_STRETCH)))
    scores = [pair_scores([each[part] for each in aligned], LIKE, fps, reach) for part in parts]
    lags = [[np.argmax(score.of_view(view, none)) - reach for score in scores] for view in range(len(signals))]
    middles = np.array([part.mean() for part in parts])
    return [lag_course(middles, lag) for lag in np.array(lags, float)]


def margin_by_motion(signals: list[np.ndarray], offsets: np.ndarray, fps: float) -> float:
    """By how much the offsets may be wrong [frames]: see :func:`margin`; infinite for a short recording.

    The offsets' standard deviations are those of the delete-one jackknife over parts of the recording, and over views.
    """
    aligned = _aligned(signals, offsets)
    length = len(aligned[0])
    parts = np.array_split(np.arange(length), max(1, min(_STRETCHES, length // _MIN_PART)))
    if len(parts) < MIN_STRETCHES:
        return float("inf")

    def lags(scores: PairScores) -> np.ndarray:
        none = np.zeros(len(scores.score), int)
        return np.array([peak(scores.of_view(view, none)) for view in range(len(none))])

    # Without each part of the recording, then without each view.
    fewer = [np.delete(np.arange(length), part) for part in parts]
    by_part = [lags(pair_scores([each[kept] for each in aligned], LIKE, fps, _NEAR)) for kept in fewer]
    sigma = np.std(by_part, axis=0) * np.sqrt(len(parts) - 1)
    views = range(len(aligned))
    if len(views) > 2:
        scores = pair_scores(aligned, LIKE, fps, _NEAR)
        by_view = [np.insert(lags(scores.without(view)), view, np.nan) for view in views]
        sigma = np.hypot(sigma, np.nanstd(by_view, axis=0) * np.sqrt(len(views) - 2))
    return margin(sigma, len(parts))


def _judge(
    scores: PairScores, view: int, offsets: np.ndarray, margin: float, course: LagCourse, by_hull: bool = False
) -> ViewOffset:
    """A view's offset and whether it is reliable.

    It always is if found by the hull. Else its rival, the pairs and the recording's parts decide; that the parts
    disagree tells nothing of an offset that changes.
    """
    frames = offsets - mode(offsets.tolist())  # the frames of most views are the scene's
    # The best lag elsewhere, if lags reach so far, and its score over that of the chosen one.
    curve, at = scores.of_view(view, offsets - offsets[view]), scores.reach
    elsewhere = np.abs(np.arange(len(curve)) - at) > scores.near
    other = int(np.argmax(np.where(elsewhere, curve, -np.inf)))
    best = float(curve[at - 1 : at + 2].max())
    rival = float(max(curve[other], 0.0) * elsewhere[other]) / best if best > 0 else float("inf")
    # The pairs that alone agree with the chosen lag.
    others = [each for each in range(len(offsets)) if each != view]
    same = [abs(scores.best_lag(each, view) - (offsets[view] - offsets[each])) <= _PAIR_TOLERANCE for each in others]
    agreeing = float(np.mean(same))
    clear = rival < _MAX_RIVAL and agreeing > _MIN_AGREEING
    sure = by_hull or (clear and (margin < _MAX_MARGIN or course.changes))
    # Cameras are in step where nothing speaks against it, such as one that clearly is not.
    in_step = sure and not course.changes and abs(frames[view]) <= margin and np.abs(frames).max() <= _IN_STEP
    own = 0 if in_step else int(frames[view])
    return ViewOffset(own, rival, int(frames[view]) + other - at, agreeing, sure, course, margin)
