"""Common time from calibrated views: silhouettes of one moment fit into one visual hull.

At each judged frame random points are drawn about the person. Of a view at some lag and the hull of the others, the
points that both contain are counted against all that either contains. A silhouette of another moment then loses by what
it lacks and by what it has too much, and one with a hole is not taken for a late one.

This ranks the lags of one view, because the others' hull is the same at all of them. ``coherence`` judges how well a
camera agrees with the others; it counts pixels that the hull leaves uncovered.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mmocap_warp.calibration.sync.lag_course import MIN_STRETCHES, LagCourse, lag_course, margin, peak
from mmocap_warp.calibration.sync.shared_motion import move_in_turn
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.masks.visual_hull import meeting_point


class Sampling(NamedTuple):
    """How many frames are judged, with how many random points at each, and how often the search for offsets starts."""

    frames: int
    points: int
    starts: int


class PackedMasks:
    """A camera's masks as bits, indexed by the recording's frames, of which the camera has ``rate`` to one."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._bits: list[np.ndarray] = []
        self._width = 0

    def add(self, mask: np.ndarray) -> None:
        """Add the next mask, (height, width) bool."""
        self._width = mask.shape[1]
        self._bits.append(np.packbits(mask, axis=1))

    def __len__(self) -> int:
        return int(len(self._bits) / self._rate)

    def at(self, frames: np.ndarray) -> np.ndarray:
        """(frame, height, width) bool."""
        numbers = np.minimum(np.rint(frames * self._rate).astype(int), len(self._bits) - 1)
        bits = np.stack([self._bits[number] for number in numbers])
        return np.unpackbits(bits, axis=2, count=self._width).astype(bool)


_REACH = 1.1  # metres that points reach to each side of the person
_ROUNDS = 10  # rounds of a search, at most
_FAR = Sampling(frames=30, points=8_000, starts=12)
_NEAR = Sampling(frames=120, points=25_000, starts=3)
_NEAR_REACH = 6  # frames to either side in the second search
_LEAST_FRAMES = 4  # of a recording for a lag of one frame to either side
_MAX_FAR_SPREAD = 2  # frames between the ends of far starts, where hulls determine the offsets alone
_STRETCHES, _MIN_STRETCH = 6, 15  # stretches of a recording, and frames judged in one at least


@dataclass(frozen=True, eq=False)
class HullOffsets:
    """Offsets of views from their hulls."""

    offsets: np.ndarray  # (view,) [frames] at which they fit best
    spread: int  # distance of the ends of other starts from these [frames]
    courses: list[LagCourse]  # (view,) of their lags
    margin: float  # by how much they may be wrong, by the scatter of the recording's stretches [frames]


def offsets_by_hull(rig: CameraRig, views: Sequence[PackedMasks], about: np.ndarray, reach: int) -> HullOffsets | None:
    """Search for offsets by the hulls of a recording.

    They are looked for up to ``reach`` frames about those given (view,); 0 where these are nearly right. The cameras
    are undistorted pinholes, as the masks.

    Returns:
        None where there is no frame in which all views see somebody, where hulls fit about as well elsewhere, or where
        a recording is too short for any lag.
    """
    length, offsets = min(len(view) for view in views), about
    if length < _LEAST_FRAMES:
        return None
    # A coarse search where offsets are not known, and a fine one about its result.
    for most, sampling in ([(reach, _FAR)] if reach else []) + [(_NEAR_REACH, _NEAR)]:
        hulls = HullAgreement(rig, views, offsets, min(most, length // _LEAST_FRAMES), sampling)
        if not hulls.judged:
            return None
        offsets, spread = hulls.offsets()
        if sampling is _FAR and spread > _MAX_FAR_SPREAD:
            return None
    # The lags of each view in stretches of the recording.
    stretches = max(1, min(_STRETCHES, hulls.judged // _MIN_STRETCH))
    courses = [hulls.course(view, offsets, stretches) for view in range(len(views))]
    if stretches < MIN_STRETCHES:
        return HullOffsets(offsets, spread, courses, float("inf"))
    sigma = np.array([course.scatter for course in courses]) / np.sqrt(stretches - 1)
    return HullOffsets(offsets, spread, courses, margin(sigma, stretches))


class HullAgreement:
    """Hulls of views that may be shifted against one another.

    Lags are tried up to ``reach`` frames about the ``offsets`` (view,): a view's frame ``f + offset`` belongs to frame
    ``f``. The cameras are undistorted pinholes, as the masks.
    """

    def __init__(
        self, rig: CameraRig, views: Sequence[PackedMasks], offsets: np.ndarray, reach: int, sampling: Sampling
    ) -> None:
        self._about, self._reach, self._starts = np.asarray(offsets), reach, sampling.starts
        # Frames that all views have at all lags, evenly spread.
        first = int(max(0, (reach - self._about).max()))
        end = int(min(len(view) - offset for view, offset in zip(views, self._about, strict=True))) - reach
        frames = np.unique(np.linspace(first, max(first, end - 1), sampling.frames).round().astype(int))
        frames = frames[frames < end]
        lags = np.arange(-reach, reach + 1)
        # Of each frame in which all views see somebody: which points each view contains at each lag, as bits.
        offsets_of_points = np.random.default_rng(0).uniform(-_REACH, _REACH, (sampling.points, 3))
        inside, seen, judged = [], [], []
        for frame in frames:
            some = [view.at(frame + offset + lags) for view, offset in zip(views, self._about, strict=True)]
            at = [masks[reach] for masks in some]
            if all(mask.any() for mask in at):
                pixels = project(rig, offsets_of_points + meeting_point(rig, at))
                inside.append([np.packbits(_inside(*each), axis=1) for each in zip(some, pixels, strict=True)])
                seen.append([masks.any(axis=(1, 2)) for masks in some])
                judged.append(frame)
        # By frame, view and lag; the points are bits of bytes.
        self._inside = np.array(inside, np.uint8).reshape(len(inside), len(rig), len(lags), -(-sampling.points // 8))
        self._seen = np.array(seen, bool).reshape(len(inside), len(rig), len(lags))
        self._own = _count(self._inside)  # (frame, view, lag)
        self._frame = np.array(judged, int)
        self.judged = len(judged)  # how many frames could be judged: those in which all views see somebody

    def of_view(self, view: int, offsets: np.ndarray) -> np.ndarray:
        """(lag,) overlap of a view with the hull of the others, which are at ``offsets``."""
        return _smooth_mean(self._shares(view, offsets))

    def course(self, view: int, offsets: np.ndarray, stretches: int) -> LagCourse:
        """The course of a view's lag beyond its offset, from its best lags in stretches of the recording."""
        shares = self._shares(view, offsets)
        parts = np.array_split(np.arange(self.judged), min(stretches, self.judged))
        lags = self._about[view] - self._reach + np.array([peak(_smooth_mean(shares[part])) for part in parts])
        return lag_course(np.array([self._frame[part].mean() for part in parts]), lags - offsets[view])

    def _shares(self, view: int, offsets: np.ndarray) -> np.ndarray:
        """(frame, lag), NaN where the view or the others' hull shows nobody."""
        others = [other for other in range(len(offsets)) if other != view]
        # The points that the hull of the others contains, and those that the view contains too.
        place = offsets - self._about + self._reach
        hull = np.bitwise_and.reduce([self._inside[:, other, place[other]] for other in others])
        both, alone, own = _count(self._inside[:, view] & hull[:, None]), _count(hull), self._own[:, view]
        # A view alone contains a whole cone of points, so it is scaled to weigh as much as the others' hull.
        scaled = own * (np.median(alone) / max(np.median(own), 1.0))
        usable = self._seen[:, view] & (alone > 0)[:, None]
        return np.where(usable, 2.0 * both / np.maximum(alone[:, None] + scaled, 1.0), np.nan)

    def fit(self, offsets: np.ndarray) -> float:
        """How well all views fit at offsets (view,): the mean of their overlaps."""
        place = offsets - self._about + self._reach
        return float(np.mean([self.of_view(view, offsets)[place[view]] for view in range(len(offsets))]))

    def offsets(self) -> tuple[np.ndarray, int]:
        """The offsets (view,) at which the views fit best, and the distance of other starts' ends from them [frames].

        Where motion is slow or the calibration poor, the end depends on the start.
        """
        random, views, reach = np.random.default_rng(0), len(self._about), self._reach // 2
        starts = random.integers(-reach, reach + 1, (self._starts, views))
        starts[0] = 0
        ends = [self._settle(self._about + start) for start in starts]
        best = max(ends, key=self.fit)
        centred = [end - int(np.median(end)) for end in (best, *ends)]
        return best, max(int(np.abs(end - centred[0]).max()) for end in centred)

    def _settle(self, offsets: np.ndarray) -> np.ndarray:
        """The end of a start, shifted so that all ends lie alike: the frames that judge depend on that."""
        for _ in range(2):
            end = move_in_turn(offsets, self._best_offset, _ROUNDS)
            common = int(np.median(end - self._about))
            offsets = np.clip(end - common, self._about - self._reach, self._about + self._reach)
        return move_in_turn(offsets, self._best_offset, _ROUNDS)

    def _best_offset(self, view: int, offsets: np.ndarray) -> int:
        """Where a view fits best beside the others; where it is if it fits nowhere."""
        fit = self.of_view(view, offsets)
        return int(self._about[view] - self._reach + np.argmax(fit) if fit.max() > 0 else offsets[view])


def _inside(masks: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(frame, point) bool: the points whose pixels are foreground in a view's frames."""
    _, height, width = masks.shape
    in_image = np.all((pixels > -0.5) & (pixels < (width - 0.5, height - 0.5)), axis=1)
    column, row = np.rint(np.where(in_image[:, None], pixels, 0.0)).astype(int).T
    return masks.reshape(len(masks), -1)[:, row * width + column] & in_image


def _count(bits: np.ndarray) -> np.ndarray:
    return np.bitwise_count(bits).sum(axis=-1, dtype=np.int64).astype(float)


def _smooth_mean(shares: np.ndarray) -> np.ndarray:
    """(lag,) the smoothed mean of shares (frame, lag); 0 where none is known."""
    known = np.isfinite(shares)
    mean = np.where(known, shares, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.convolve(np.pad(mean, 1, mode="edge"), (0.25, 0.5, 0.25), "valid")
