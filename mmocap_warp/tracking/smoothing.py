"""A track and its masks to the clip's poses: all frames as one problem, from masks that are read once.

The way of a frame: its masks become distance fields (``_MaskWindow``). Its pose is solved together with the window of
frames around it (:class:`ClipProblem`), where a second opinion from following the window backwards may replace it
(:class:`BackwardPass`). Then its standard deviations and its overlap with the masks are computed.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mmocap_warp.body.skeleton import ROOT_ANGLES, TRANSLATION
from mmocap_warp.contour import ACCELERATION
from mmocap_warp.contour.clip import uncertainty
from mmocap_warp.contour.clip.backward_pass import AHEAD, STARTS, BackwardPass
from mmocap_warp.contour.clip.clip_problem import ClipProblem, SolvedWindow, coarse_then_fine, window_frames
from mmocap_warp.contour.clip.device_band import DeviceBand
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.fitter import WIDE
from mmocap_warp.contour.frame.normal_equations import NormalEquations, ViewEquations
from mmocap_warp.contour.frame.rooted import Neighbours, RootedPoses, Rooting
from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.rigging.shipped import deviation_factors
from mmocap_warp.tracking.contour_state import LEVEL_FRAMES
from mmocap_warp.tracking.evidence import ViewShifts
from mmocap_warp.tracking.from_settings import make_fitter, make_objective, search_limits
from mmocap_warp.tracking.holes import LEAST_WHOLE
from mmocap_warp.tracking.limb_pairs import limb_pairs, limbs, mirrored
from mmocap_warp.tracking.pins import Pins
from mmocap_warp.tracking.recovery_starts import RecoveryStarts
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import CROWDED_OVERLAP, others_in, overlap
from mmocap_warp.tracking.uncovered import LASTING_AREA, Uncovered, UncoveredArea, look_interval, parts_in_doubt

SmoothReport = Callable[[int], None]  # called with the number of frames that are final

_TRACKED, _PARTIAL, _LOST, _INTERPOLATED, _REPEATED = (
    STATUS.index(name) for name in ("tracked", "partial", "lost", "interpolated", "repeated")
)
CANDIDATES = 32  # poses that are linearised at a time
WIDE_SIGMA = 0.15  # least standard deviation of a joint of a part in doubt, along each axis [m]
_OBSERVED = 8  # frames whose masks a GPU makes fields of at a time
RECALLED = 8  # recalled limbs that are fitted at a time
_STEPS = 5  # descent steps of a pose while a window is followed backwards
_HELD_INFORMATION = 1e10  # about each coordinate of a frame that is held [1/m^2, 1/rad^2]
_UNSURE = 0.05  # deviation of a joint from which on holes in most masks may hide it [m], in a body like a person
_CROWDED_VIEWS = 0.5  # share of the views that show others from which on what a body leaves uncovered is theirs
_DRIFT = 0.2  # seconds in which limbs drift off before a clip's end is lost, which no later frame tells of
_FALL = 0.03  # overlap below that of the frames before from which a limb may be elsewhere for a moment


def frames_held(rate: float) -> int:
    """Number of frames whose masks are held: a window, and the frames beyond it that it is followed back from."""
    return window_frames(rate) + round(AHEAD * rate)


@dataclass(frozen=True, eq=False)
class Mending:
    """What is added to the problem of a clip in which a span is solved anew."""

    held: np.ndarray  # (frame,) bool, the frames that stay as they are
    pins: Pins  # joints that were clicked


def smoothed(
    raw: Result,
    config: TrackConfig,
    observations: Iterable[Observation],
    progress: SmoothReport | None = None,
    mending: Mending | None = None,
) -> Result:
    """The clip's poses as one problem, with their standard deviations.

    A lost frame has no contours: the frames around it fill it in, and it is then ``interpolated``. It stays ``lost``
    before a run's first and after its last frame with a pose. A repeated frame's masks are not looked at either.

    A window of masks is held at a time, after each of which ``progress`` is called. ``mending`` says which frames are
    held, and what was clicked in the others; there is no second opinion then. A frame of ``raw`` is looked at when its
    masks, or those of the frame before, have been read: the track may still grow.
    """
    started = time.perf_counter()
    masks = _MaskWindow(raw, config, observations)
    runs = [_RunSmoother(raw, config, masks, run, mending) for run in range(len(raw.pose))]
    done, cost, iou, shift = 0, np.empty_like(raw.cost), np.empty_like(raw.iou), np.empty_like(raw.iou)
    # All runs go from window to window together, because the masks are read once.
    for windows in zip(*(run.windows for run in runs), strict=True):
        for run, window, of_run in zip(runs, windows, shift, strict=True):
            of_run[done : done + window.final] = run.finish(window)
        # A repeated mask is of another time: what its frame had before stays.
        final = np.arange(done, done + windows[0].final)
        cost[:, final], iou[:, final] = raw.cost[:, final], raw.iou[:, final]
        for frame in final[raw.status[0, final] != _REPEATED].tolist():
            cost[:, frame], iou[:, frame] = masks.judged(frame, np.stack([run.pose[frame] for run in runs]))
            for run, overlaps in zip(runs, iou, strict=True):
                run.look(frame, overlaps)
        done += windows[0].final
        if progress:
            progress(done)
    # Which limbs are in doubt is judged anew: the clip may have found what its frames had lost.
    doubt = np.stack([run.parts_in_doubt() for run in runs])
    tracked = raw.status != _LOST
    before = np.logical_or.accumulate(tracked, axis=1)
    after = np.logical_or.accumulate(tracked[:, ::-1], axis=1)[:, ::-1]
    status = np.where(~tracked & before & after, _INTERPOLATED, raw.status)
    in_all_views = np.isfinite(raw.iou).all(axis=2)
    status = np.where((status == _PARTIAL) & in_all_views, _TRACKED, status)
    doubtful = doubt.any(axis=2) & np.isin(status, (_TRACKED, STATUS.index("rescued")))
    status = np.where(doubtful, _PARTIAL, status).astype(np.int8)
    seconds = time.perf_counter() - started - masks.reading
    return replace(
        raw,
        pose=np.stack([run.pose for run in runs]),
        cost=cost,
        iou=iou,
        status=status,
        seconds=raw.seconds + seconds,
        raw_pose=raw.pose,
        angle_sigma=np.stack([run.sigma.pose for run in runs]),
        joint_sigma=np.stack([run.sigma.joint for run in runs]),
        view_shift=masks.shifts.limited(shift, iou, status),
    )


class _MaskWindow:
    """The masks of a window of frames, as distance fields, and what they say about poses; read as they are asked for.

    Attributes:
        pairs: coordinates (coordinate,) of each pair of limbs.
        holed: (frame,) bool, frames that were read of which too few views have whole masks.
        points: what is kept from accelerating.
        band: what solves the clip's steps on a GPU; None on the CPU.
        recalls_beside: whether limbs are recalled in a thread of their own.
        reading: how long reading took so far [s].
    """

    def __init__(self, raw: Result, config: TrackConfig, observations: Iterable[Observation]) -> None:
        subject = raw.subject
        self.searched, self.limits = subject.body.skeleton.searched(config.dof), search_limits(subject, config)
        self._places = min(frames_held(raw.rate), len(raw.frame_numbers))
        self.pairs = [np.concatenate([limb.coordinates for limb in pair]) for pair in limb_pairs(subject.body.skeleton)]
        # Fitters for the poses of all frames held, for limbs recalled meanwhile, for the body too, for what is far from
        # the masks, and for views that lie beside the body.
        candidates = max(STARTS, len(self.pairs), min(CANDIDATES, self._places))
        self._fitter = fitter = make_fitter(subject, raw.cameras, config, candidates, frames=self._places)
        self.body_changes = uncertainty.body_changes(subject.body)
        parameters, pairs = len(self.body_changes.sigma), max(1, len(self.pairs))
        self._body_fitter = make_fitter(subject, raw.cameras, config, 1, parameters=parameters, like=fitter)
        self._wide_fitter = make_fitter(subject, raw.cameras, config, pairs, matching=WIDE, like=fitter)
        self.shifts = ViewShifts(subject, raw.cameras, config, like=fitter)
        self._body_fitter.set_change(self.body_changes.vertex, self.body_changes.joint)
        # A GPU solves the clip's steps as well; all runs share it.
        self.points = MotionPoints(subject.body.skeleton, subject.body.joint_rest, self.searched)
        device = resolve_device(config.device)
        self.recalls_beside = device == "cpu" and (config.threads or available_threads()) > 1
        recalling = self.recalls_beside and make_fitter(subject, raw.cameras, config, RECALLED, like=fitter)
        self._recall_fitter = recalling or fitter
        self.band = None if device == "cpu" else DeviceBand(self.points, self._places, device)
        self._objective = make_objective(subject, raw.cameras, config, max(candidates, len(raw.pose)))
        self._uncovered = UncoveredArea(subject, raw.cameras, resolve_device(config.device))
        self.starts = RecoveryStarts(subject, raw.cameras, config)
        self._judged: int | None = None  # the frame that the objective observes
        self._unread: Iterator[Observation] = iter(observations)
        self._held: list[Observation] = []
        self._read = 0
        self.holed = np.zeros(len(raw.frame_numbers), bool)
        self.reading = 0.0

    def linearise(
        self, frames: np.ndarray, rooted: RootedPoses, seen: np.ndarray, neighbours: Neighbours
    ) -> NormalEquations:
        """What the contours say about frames of the window; nothing about those not ``seen``."""
        return self._fitter.linearise(frames % self._places, rooted, neighbours).of_seen(seen)

    def read_until(self, end: int) -> None:
        """Read the frames up to one, each into the place of the oldest."""
        while self._read < end:
            self._observe(min(_OBSERVED, self._places - self._read % self._places, end - self._read))

    def descend(
        self, frames: np.ndarray, begin: RootedPoses, neighbours: Neighbours, beside: bool = False
    ) -> tuple[RootedPoses, np.ndarray]:
        """Poses that the contours of frames of the window lead to from some, and what they cost (pose,).

        Two threads may do so at the same time, one of them ``beside`` the other.
        """
        fitter = self._recall_fitter if beside else self._fitter
        return fitter.descended(frames % self._places, begin, neighbours, _STEPS)

    def pairs_from_rest(self, frame: int, there: RootedPoses) -> RootedPoses:
        """Poses (pair,) that the contours lead to from one (1,) with each pair of limbs at rest."""
        count, fitter = len(self.pairs), self._wide_fitter
        base, pose = np.repeat(there.base, count, axis=0), np.repeat(there.pose, count, axis=0)
        for changed, pair in zip(pose, self.pairs, strict=True):
            changed[np.intersect1d(pair, self.searched)] = 0.0
        fitter.start_at(pose, base, np.full(count, frame % self._places))
        fitter.descend(count, _STEPS)
        return RootedPoses(base, fitter.descent.best.numpy()[:count].astype(float))

    def linearise_body(self, frames: np.ndarray, rooted: RootedPoses) -> ViewEquations:
        """What each view's contours say about single frames of the window and about the body's parameters."""
        return self._body_fitter.linearise_views(frames % self._places, rooted)

    def shift(self, frames: np.ndarray, rooted: RootedPoses, root: np.ndarray, neighbours: Neighbours) -> np.ndarray:
        """(frame, camera) by how far views of frames of the window lie beside bodies, with roots at (frame, 3) [m]."""
        return self.shifts.of(frames % self._places, rooted, root, neighbours)

    def others(self, frame: int, pose: np.ndarray) -> np.ndarray:
        """Pixels (camera,) of a frame's masks that show others than who has a pose (coordinate,)."""
        self._objective.observe(self._held[frame % self._places])
        self._judged = frame
        return others_in(self._objective.judged(pose[None])[1][0], self._held[frame % self._places].foreground)

    def judged(
        self, frame: int, pose: np.ndarray, moving: np.ndarray | None = None, others: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Costs (pose,) by areas and overlaps (pose, camera) of poses (pose, coordinate); NaN where nothing is seen.

        Of the masks, pixels that show ``others`` (camera,) do not count.
        """
        observation, objective = self._held[frame % self._places], self._objective
        if others is not None:
            observation = replace(observation, foreground=observation.foreground - others)
        cost, iou = np.full(len(pose), np.nan), np.full((len(pose), len(observation.foreground)), np.nan)
        if not observation.foreground.any():
            return cost, iou
        if frame != self._judged or others is not None:  # poses of one frame are judged in a row
            objective.observe(observation)
            self._judged = frame if others is None else None
        for first in range(0, len(pose), objective.candidates):
            part = slice(first, min(first + objective.candidates, len(pose)))
            cost[part], count = objective.judged(pose[part], moving)
            iou[part] = overlap(count, observation)
        return cost, iou

    def uncovered(self, frame: int, poses: np.ndarray, *, shadows: bool = True) -> list[Uncovered]:
        """What poses (pose, coordinate) leave uncovered of a frame's masks; see :meth:`UncoveredArea.of`."""
        return self._uncovered.of(poses, self._held[frame % self._places], shadows=shadows)

    def _observe(self, count: int) -> None:
        """Read so many frames into the places of the oldest ones, which follow each other."""
        started, place = time.perf_counter(), self._read % self._places
        observations = [next(self._unread) for _ in range(count)]
        self.reading += time.perf_counter() - started
        for frame, each in enumerate(observations, self._read):
            if each.holed is not None:
                self.holed[frame] = np.sum((each.foreground > 0) & ~each.holed) < LEAST_WHOLE
        self._held[place : place + count] = observations
        self._fitter.observe_all(observations, place)
        self._read += count


class _RunSmoother:
    """Solves a run's clip, window by window; all runs share the masks.

    Attributes:
        windows: solved when they are asked for.
        pose: (frame, coordinate) float64, as far as windows were finished.
        sigma: standard deviations of the same frames.
    """

    def __init__(
        self, raw: Result, config: TrackConfig, masks: _MaskWindow, run: int, mending: Mending | None = None
    ) -> None:
        subject, track = raw.subject, raw.pose[run]
        skeleton = subject.body.skeleton
        self._masks, self._rate = masks, raw.rate
        self._rooting = Rooting(skeleton, subject.root_base, masks.searched, masks.limits)
        # What is known of frames that were taken in: poses as they were tracked, and as they were linearised last.
        self._raw, self._run, self._taken = raw, run, 0
        self._course, self._known = (self._rooting.enter(np.zeros_like(track)) for _ in range(2))
        self._tracked, self._shows = (np.zeros(len(track), bool) for _ in range(2))
        self._skeleton, self._size = skeleton, subject.body.relative_size

        # The clip's problem. A window ends after a frame that has masks: all runs want the same masks then.
        self._mending = mending
        coordinates = [limb.coordinates for limb in limbs(skeleton)]
        from_rest = masks.pairs_from_rest if masks.pairs else None
        backward = None if mending else BackwardPass(
            self._descend, self._linearise, self._rooting, masks.points,
            raw.rate, self._area_costs, coordinates, from_rest, lambda pose: mirrored(skeleton, pose), self,
            partial(self._descend, beside=True) if masks.recalls_beside else None,
        )  # fmt: skip
        problem = ClipProblem(self._linearise, self._rooting, masks.points, raw.rate, backward, masks.band)
        acceleration = config.acceleration or ACCELERATION
        self.windows = problem.windows(self._course, coarse_then_fine(acceleration), self._shows, self._take)

        # How sure the poses are: noise from frame to frame, and a body that is not quite the right one.
        far = uncertainty.departure(subject.provenance)
        self._factors = deviation_factors(subject.body, far)
        axes = uncertainty.stretched(self._factors.joint) if self._factors else None
        self._noise = uncertainty.Deviations(problem, acceleration, axes)
        self._body = uncertainty.BodyDeviations(problem, masks.linearise_body, masks.body_changes, axes, far)
        self._widest = np.full(track.shape[1], np.inf)
        self._widest[masks.searched] = self._rooting.anywhere
        self._usual_misfit = uncertainty.USUAL_MISFIT * subject.body.relative_size

        self._looks: dict[int, np.ndarray] = {}
        self._others: dict[int, np.ndarray | None] = {}  # pixels (camera,) of a frame's masks that show others
        self._look_interval = look_interval(raw.rate, final=True)

        self._finished = 0
        self.pose = np.zeros_like(track)
        self.sigma = uncertainty.Uncertainty(np.zeros_like(track), np.zeros((len(track), len(skeleton.joints), 3)))

    def _take(self, end: int) -> None:
        """Read the masks of frames up to one, and take in what was tracked, in the next frame too."""
        self._masks.read_until(end)
        new, status = slice(self._taken, min(end + 1, len(self.pose))), self._raw.status[:, self._taken : end + 1]
        self._tracked[new] = ~np.isin(status[self._run], (_LOST, _REPEATED))
        self._shows[new] = np.isfinite(self._raw.iou[:, new]).any(axis=(0, 2)) & (status[0] != _REPEATED)
        course = self._rooting.enter(self._raw.pose[self._run, new])
        for known, poses in ((self._course, course), (self._known, self._rooting.refold(course))):
            known.base[new], known.pose[new] = poses.base, poses.pose
        self._taken = new.stop

    def finish(self, window: SolvedWindow) -> np.ndarray:
        """Take over the next window's final frames; (frame, camera) by how far views lie beside them [m]."""
        frames = slice(self._finished, self._finished + window.final)
        before = self.pose[frames.start - 1] if frames.start else self._raw.pose[self._run, 0]
        self.pose[frames] = self._rooting.leave(window.rooted[: window.final], before[ROOT_ANGLES])
        contour = window.contour
        if self._mending:  # what holds frames is no contour
            shown = self._finished + np.arange(len(window.rooted))
            contour = self._masks.linearise(shown, window.rooted, self._tracked[shown], self._neighbours(shown))
        error = uncertainty.misfit(contour, self._rooting.searched, self._usual_misfit)
        noise, body = self._noise.of(window), self._body.of(window)
        sigma = uncertainty.combine(noise, body, error, self._widest, self._usual_misfit)
        if self._factors:
            sigma.pose[:] = np.minimum(sigma.pose * self._factors.coordinate, self._widest)
            sigma.pose[:, :TRANSLATION] = sigma.joint[:, 0]  # the root's place
        self.sigma.pose[frames], self.sigma.joint[frames] = sigma.pose, sigma.joint
        final, self._finished = np.arange(frames.start, frames.stop), frames.stop
        rooted = self._rooting.refold(self._rooting.enter(self.pose[final]))
        return self._masks.shift(final, rooted, self.pose[final, :TRANSLATION], self._neighbours(final))

    def look(self, frame: int, overlap: np.ndarray) -> None:
        """Look for uncovered mask area: now and then, at the end, and where the overlap (frame, camera) falls."""
        if not self._tracked[frame]:
            return
        before = np.arange(max(0, frame - LEVEL_FRAMES), frame + 1)
        level = np.nanmean(overlap[before[self._tracked[before]]], axis=1)
        falls = level[-1] < np.median(level) - _FALL
        if frame % self._look_interval == 0 or falls or frame == len(self.pose) - 1:
            (look,) = self._masks.uncovered(frame, self.pose[frame : frame + 1], shadows=False)
            self._looks[frame] = look.area

    def parts_in_doubt(self) -> np.ndarray:
        """(frame, part) bool, once all windows are finished: parts that may be elsewhere; their deviations grow."""
        doubt = np.zeros((len(self.pose), len(self._skeleton.parts)), bool)
        if self._looks:
            looked, area = np.array(list(self._looks)), np.stack(list(self._looks.values()))
            doubt = parts_in_doubt(self._size, self._rate, looked, area, len(doubt))
        unsure = (self.sigma.joint.max(axis=2) > _UNSURE * self._size) & self._masks.holed[:, None]
        for joint, part in enumerate(self._skeleton.part):
            doubt[:, part] |= unsure[:, joint]
        # A clip's end that is lost though it shows somebody: the frames before drifted off.
        end = int(np.flatnonzero(self._tracked).max(initial=-1)) + 1
        lost = (self._raw.status[self._run, end:] == _LOST) & np.isfinite(self._raw.iou[self._run, end:]).any(axis=1)
        doubt[max(0, end - round(_DRIFT * self._rate)) if lost.any() else end : end] = True
        wide = doubt[:, np.array(self._skeleton.part)]  # (frame, joint)
        self.sigma.joint[:] = np.maximum(self.sigma.joint, np.where(wide, WIDE_SIGMA * self._size, 0.0)[:, :, None])
        return doubt

    def _linearise(self, frames: np.ndarray, rooted: RootedPoses) -> NormalEquations:
        """What contours and pins say about frames around poses; of lost frames nothing, of held ones that they are."""
        self._known.base[frames], self._known.pose[frames] = rooted.base, rooted.pose
        contour = self._masks.linearise(frames, rooted, self._tracked[frames], self._neighbours(frames))
        if not self._mending:
            return contour
        contour = contour.plus(self._mending.pins.of(frames, rooted, self._masks.points))
        held = NormalEquations(*map(np.zeros_like, vars(contour).values()))
        held.matrix[:] = _HELD_INFORMATION * np.eye(contour.matrix.shape[1])
        return held.where(self._mending.held[frames], contour)

    def _descend(self, frames: np.ndarray, starts: RootedPoses, beside: bool = False) -> tuple[RootedPoses, np.ndarray]:
        """Poses that the contours of frames lead to from some, and what they cost (pose,); see ``_MaskWindow``."""
        return self._masks.descend(frames, starts, self._neighbours(frames), beside)

    def _neighbours(self, frames: np.ndarray) -> Neighbours:
        """The poses before and after frames, from which late views know how the body moves."""
        return Neighbours.of(self._known, frames, self._rate)

    def area(self, frame: int, rooted: RootedPoses) -> np.ndarray:
        """See :class:`~mmocap_warp.contour.clip.backward_pass.UncoveredMask`."""
        poses = self._rooting.leave(rooted, np.zeros(3))
        others = self._others_in(frame)
        # In a crowd a limb that is moved onto somebody else leaves less uncovered.
        if others is not None and np.mean(others > 0) > _CROWDED_VIEWS:
            return np.zeros(len(poses))
        areas = np.array([look.area.sum() for look in self._masks.uncovered(frame, poses)])
        return areas / (LASTING_AREA * self._size**2)

    def limbs_reaching(self, frame: int, there: RootedPoses) -> RootedPoses:
        """See :class:`~mmocap_warp.contour.clip.backward_pass.UncoveredMask`."""
        pose = self._rooting.leave(there, np.zeros(3))
        place = self._masks.uncovered(frame, pose)[0].place
        starts = self._masks.starts.reaching(pose.astype(np.float32), np.array([frame]), [place])[0]
        return self._rooting.refold(self._rooting.enter(starts))

    def _area_costs(self, frames: np.ndarray, rooted: RootedPoses, moving: np.ndarray | None = None) -> np.ndarray:
        """See :class:`~mmocap_warp.contour.clip.backward_pass.AreaCost`."""
        poses, cost = self._rooting.leave(rooted, np.zeros(3)), np.zeros(len(frames))
        for same in np.split(np.arange(len(frames)), np.flatnonzero(np.diff(frames)) + 1):
            frame = int(frames[same[0]])
            cost[same] = self._masks.judged(frame, poses[same], moving, self._others_in(frame))[0]
        return cost

    def _others_in(self, frame: int) -> np.ndarray | None:
        """Pixels (camera,) of a frame's masks that show others; None where nobody else is seen."""
        if frame not in self._others:
            self._others[frame] = None
            if (self._raw.iou[self._run, frame] < CROWDED_OVERLAP).any():
                others = self._masks.others(frame, self._raw.pose[self._run, frame])
                self._others[frame] = others if others.any() else None
        return self._others[frame]
