"""Which frames of a scene's cameras were taken at the same time, from the silhouettes alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mmocap_warp.calibration.sync.hull_agreement import HullOffsets, offsets_by_hull
from mmocap_warp.calibration.sync.lag_course import LagCourse, lag_course
from mmocap_warp.calibration.sync.shared_motion import PairScores, common_offsets, pair_scores
from mmocap_warp.calibration.sync.silhouette_motion import LIKE, SilhouetteMotion
from mmocap_warp.errors import InputError
from mmocap_warp.scene.recording import Scene

_LENGTH = 320  # [px] of the masks' longer side
WITHIN = 1.0
"""Of a lag that is looked for [s], unless somebody knows better."""

_SHARE = 1 / 3  # of a clip, at most
_SHORT = 0.25  # [s], within which a lag is believed more than a longer one
_CLEARLY = 3.0  # times as high must a score be to take a longer lag
_HALF = 0.5  # of the other views must say the same
_HULL_REACH = 0.4  # [s] by which the hull may correct what motion found
_HULL_CORRECTS = 3  # [frames], what motion is sure of, at most
_HULL_SPREAD = 1  # [frames] between the ends of several starts, of a hull that can be trusted
_HULL_SIGMA = 0.5  # [frames], standard deviation of an offset, of such a hull
_STRETCHES, _OF_A_STRETCH = 6, 80  # of a recording, and frames of one at least, that motion tells changes by
_CHANGE = 0.2  # [s] of a lag that changes, at most
_RIVAL = 0.75  # of the best score: another lag that scores more makes a view's offset unsure
_ALIKE = 2  # [frames] within which a pair alone agrees with what all pairs say

Progress = Callable[[int, int], None]
"""Called with the frames that have been looked at, and all of them."""


@dataclass(frozen=True)
class ViewOffset:
    """What was found of one camera.

    Attributes:
        frames: its offset [the scene's frames]: it lags by so many.
        rival: score of the best other lag over that of this one; below ``0.75`` the offset is sure.
        other: that other lag [frames].
        agreeing: share of the other views that, compared with this one alone, say the same within two frames.
        sure: whether the offset can be relied on.
        course: how it changes.
    """

    frames: int
    rival: float
    other: int
    agreeing: float
    sure: bool
    course: LagCourse = field(default_factory=LagCourse)


@dataclass(frozen=True)
class Synchronisation:
    """What was found of all cameras.

    Attributes:
        fps: of the scene's frames.
        views: by camera name.
        hull: whether calibrated views decided by the hull; None without a calibration, False where it could not tell.
    """

    fps: float
    views: dict[str, ViewOffset]
    hull: bool | None

    @property
    def sure(self) -> bool:
        """Whether all offsets can be relied on, all along."""
        return all(view.sure and not view.course.changes for view in self.views.values())


def synchronise(scene: Scene, progress: Progress | None = None, within: float = WITHIN) -> Synchronisation:
    """Find the offsets of a scene's cameras; what the scene says about them is not looked at.

    Args:
        scene: its ``calibration`` is used where there is one that says where cameras stand.
        progress: called while masks are read.
        within: by how much one camera lags another at most [s].

    Raises:
        InputError: a single camera, or one that shows nobody.
        ValueError: a ``within`` that is no time.
    """
    if not 0 < within < 1000:
        raise ValueError(f"within must be a time in seconds, got {within:g}")
    if len(scene.cameras) < 2:
        raise InputError(scene.path, "one camera has nothing to be in step with", "name at least two cameras")
    recorded = scene.as_recorded()
    scale = min(1.0, _LENGTH / int(scene.calibrated.size.max()))
    motions = [SilhouetteMotion() for _ in scene.cameras]
    masks = [_Masks(source.rate) for source in scene.cameras]
    for number, views in enumerate(recorded.masks(scale)):
        for motion, kept, mask in zip(motions, masks, views, strict=True):
            motion.add(mask)
            kept.add(mask)
        if progress:
            progress(number + 1, recorded.frame_count)
    signals = [_in_scene_frames(_signals(motion, scene, k), scene.cameras[k].rate) for k, motion in enumerate(motions)]
    scores, offsets = _offsets_by_motion(signals, scene.fps, within)
    courses, hull = _courses_by_motion(signals, offsets, scene.fps), None
    if scene.calibration is not None and scene.calibrated.placed:
        told = all(_judged(scores, k, offsets, False).sure for k in range(len(masks)))
        about, reach = (offsets, 0) if told else (np.zeros_like(offsets), round(min(_HULL_REACH, within) * scene.fps))
        by_hull = offsets_by_hull(scene.rig(scale), masks, about, reach)
        hull = by_hull is not None and _trusted(by_hull, offsets if told else None)
        if by_hull and hull:
            offsets = by_hull.offsets
            courses = [one if one.changes else other for one, other in zip(by_hull.courses, courses, strict=True)]
    found = {
        source.name: replace(_judged(scores, k, offsets, hull is True), course=courses[k])
        for k, source in enumerate(scene.cameras)
    }
    return Synchronisation(scene.fps, found, hull)


def _trusted(hull: HullOffsets, motion: np.ndarray | None) -> bool:
    """Whether hulls tell the offsets, given those that motion is sure of, if it is."""
    if hull.spread > _HULL_SPREAD or hull.sigma.max() > _HULL_SIGMA:
        return False
    if motion is None:
        return True
    apart = hull.offsets - motion
    return bool(np.abs(apart - np.median(apart)).max() <= _HULL_CORRECTS)


class _Masks:
    """A camera's masks as bits, by the scene's frames."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._bits: list[np.ndarray] = []
        self._width = 0

    def add(self, mask: np.ndarray) -> None:
        self._width = mask.shape[1]
        self._bits.append(np.packbits(mask, axis=1))

    def __len__(self) -> int:
        return int(len(self._bits) / self._rate)

    def at(self, frames: np.ndarray) -> np.ndarray:
        numbers = np.minimum(np.rint(frames * self._rate).astype(int), len(self._bits) - 1)
        bits = np.stack([self._bits[number] for number in numbers])
        return np.unpackbits(bits, axis=2, count=self._width).astype(bool)


def _signals(motion: SilhouetteMotion, scene: Scene, k: int) -> np.ndarray:
    try:
        return motion.signals(scene.fps * scene.cameras[k].rate)
    except ValueError:
        raise InputError(
            f"{scene.path}: [cameras.{scene.cameras[k].name}]",
            "its masks show nobody in two frames",
            "look at them, or leave the camera out",
        ) from None


def _in_scene_frames(signals: np.ndarray, rate: float) -> np.ndarray:
    """A camera's signals between its frames as between the scene's, of which it has ``rate`` to one."""
    if rate == 1.0:
        return signals
    frames = np.arange(int(len(signals) / rate))
    at = (frames + 0.5) * rate - 0.5
    return np.stack([np.interp(at, np.arange(len(signals)), column) for column in signals.T], axis=1)


def _offsets_by_motion(signals: list[np.ndarray], fps: float, within: float) -> tuple[PairScores, np.ndarray]:
    """Scores of all lags, and the offsets; of two that score much alike the shorter ones."""
    most = max(1, min(round(within * fps), int(_SHARE * min(map(len, signals)))))
    scores = pair_scores(signals, LIKE, fps, most)
    near = scores.within(min(most, round(_SHORT * fps)))
    short, long = common_offsets(near), common_offsets(scores)
    return scores, long if scores.total(long) > _CLEARLY * scores.total(short) else short


def _courses_by_motion(signals: list[np.ndarray], offsets: np.ndarray, fps: float) -> list[LagCourse]:
    """How the views' lags change from a stretch of the recording to the next."""
    begin = offsets - offsets.min()
    length = min(len(each) - first for each, first in zip(signals, begin, strict=True))
    reach = round(_CHANGE * fps)
    middles, lags = [], []
    for part in np.array_split(np.arange(length), max(1, min(_STRETCHES, length // _OF_A_STRETCH))):
        there = [each[first + part] for each, first in zip(signals, begin, strict=True)]
        scores = pair_scores(there, LIKE, fps, reach)
        none = np.zeros(len(signals), int)
        lags.append([int(np.argmax(scores.of_view(view, none))) - reach for view in range(len(signals))])
        middles.append(part.mean())
    return [lag_course(np.array(middles), lag) for lag in np.array(lags, float).T]


def _most_common(offsets: np.ndarray) -> int:
    """The offset that most views have, of several the first: their frames are the scene's."""
    values = offsets.tolist()
    return int(max(values, key=lambda value: (values.count(value), -values.index(value))))


def _judged(scores: PairScores, view: int, offsets: np.ndarray, by_hull: bool) -> ViewOffset:
    found = offsets - _most_common(offsets)
    curve, at = scores.of_view(view, offsets - offsets[view]), scores.reach
    elsewhere = np.abs(np.arange(len(curve)) - at) > scores.near
    other = int(np.argmax(np.where(elsewhere, curve, -np.inf)))
    best = float(curve[at - 1 : at + 2].max())
    rival = float(max(curve[other], 0.0)) / best if best > 0 else float("inf")
    others = [each for each in range(len(offsets)) if each != view]
    same = [abs(scores.best_lag(each, view) - (offsets[view] - offsets[each])) <= _ALIKE for each in others]
    agreeing = float(np.mean(same))
    sure = by_hull or (rival < _RIVAL and agreeing > _HALF)
    return ViewOffset(int(found[view]), rival, int(found[view]) + other - at, agreeing, sure)
