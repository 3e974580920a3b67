"""Tracking by contours: the search finds the basin, the contour fit its bottom.

A frame is fitted from the last pose and from where its motion would lead. Where that overlaps the masks as well as the
frames before did, and no limb is where nobody is seen, it is the answer. Where not, a ladder of recovery is climbed
until an answer is good, and the best one is kept. At rates over 30 frames a second the frame after a climb in vain does
without, unless the body is lost:

1. search: a short search from the last pose, then contours;
2. scatter: contours from many poses around the best so far, each of which differs in one part of the body; after three
   steps the most promising ones go on. That finds an arm that a search of five times the budget does not;
3. restart: after some frames in a row that stayed lost, contours from poses in the visual hull that are turned or bent
   any way; see :mod:`mmocap_warp.tracking.recovery_starts`.

A view that was taken a fraction of a frame off the others sees, for the contours, the body on its way from the last
pose. The search and the overlaps that judge an answer do without that.
"""

import time
from dataclasses import replace

import numpy as np
import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.device.transfers import Download, Replays
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.tracking.algorithms import CONTOUR_TRACKERS, PRESETS
from mmocap_warp.tracking.contour_state import Candidates, ContourState
from mmocap_warp.tracking.from_settings import make_fitter, make_objective, search_limits
from mmocap_warp.tracking.pose_search import PoseSearch, RootFrame
from mmocap_warp.tracking.recovery_starts import SCATTERED_POSES, RecoveryStarts
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import lost_frame, others_in, overlap, without_stranger
from mmocap_warp.tracking.uncovered import LARGEST_USUAL_AREA, LASTING_AREA, UncoveredArea, look_interval, stands_out

_STEPS = 5  # descent steps from the last pose
_STEPS_FAR = 10  # descent steps from a start that is further away
_STEPS_SCATTERED = 3  # descent steps of scattered poses, of which the cheapest then go on
_LEAST_RESTED_RATE = 30.0  # frames a second from which on a frame may do without the ladder; boxing at 15 loses 2.6 mm
_PROMISING = 16  # how many of a run's scattered poses go on
_STARTS = 2  # starts of an ordinary frame: the last pose, and where its motion leads
_MOTION_KEPT = 0.8  # share of the last motion that is taken to go on
_SHORT_OVERLAP, _SHORT_EXPOSED = 0.012, 0.12  # overlap below the usual, and exposed outline [m], that call for recovery
_LOST_OVERLAP, _LOST_EXPOSED = 0.06, 0.5  # the same, where the frame is lost
_LOST_FRAMES = 3  # frames in a row that are lost before the tracker starts anew
_MOST_SKIPPED = 3  # missing frames across which a motion is known well enough to go on
_LOST_LIVE = 2  # the same live, where a search delays the frames after it, before the body is searched for
_CLEAR_FALL = 0.025  # overlap below the usual that calls for recovery by itself; a fault of one mask costs less
_SHORT_UNCOVERED = 0.001  # uncovered area above the usual that calls for it too [m^2], in a body as large as a person
_LEAST_VIEWS = 5  # with fewer views too little is uncovered or exposed to tell a lost limb from a fault
_LEAST_GAIN = 0.001  # overlap by which a later answer must be better
_STILL_UNCOVERED = 0.5  # a limb is found where less than this share of the area above the usual is left
_COMPARED = 6  # poses with such limbs whose uncovered area is compared
_AREA_WORTH = 2.0  # overlap that a square metre of uncovered area is worth in a body as large as a person
_LARGEST_LOSS = 0.008  # overlap that a pose which covers a limb may cost
_MATCHED = 0.5  # share of the body's outline that a mask must show to be of it and others, and not of everything


def starts_per_run(config: TrackConfig) -> int:
    """The most poses of a run that are fitted at a time."""
    return _STARTS if config.algorithm == "contour" else SCATTERED_POSES


class ContourTracker:
    """Tracks a subject frame by frame by contours; keeps what the next frame depends on.

    The algorithm is one of ``CONTOUR_TRACKERS``, or one of the paper's to be polished. ``fps`` is for the preset's
    radii, and for views that are late; negative where frames are tracked from the last to the first.

    Attributes:
        device: the Warp device.
        search: what finds starts for the contours; None where there is no search.
        search_interval: frames from one that may be searched for to the next. If it is more than one, only a body that
            stays lost is searched for, not frames that merely fall short.
        next_search: the first frame that may be searched for then, counted from the first one.

    Raises:
        ValueError: the body has no model with so many degrees of freedom, or its tracking mesh is not closed.
    """

    def __init__(self, subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> None:
        self.config = config
        self._subject, self._fps, self._runs = subject, fps, config.runs
        self.device = resolve_device(config.device)
        searched_by = config.algorithm if config.polish else CONTOUR_TRACKERS[config.algorithm]
        search = PRESETS[config.preset].algorithm(searched_by) if searched_by else None
        self.search = PoseSearch(subject, rig, config, search, abs(fps)) if search else None
        self._starts, candidates = RecoveryStarts(subject, rig, config), config.runs * starts_per_run(config)
        self._fitter = make_fitter(subject, rig, config, candidates)
        self._judge = make_objective(subject, rig, config, candidates)
        self.search_interval, self.next_search = 1, 0
        self._may_rest = abs(fps) > _LEAST_RESTED_RATE
        self._root_frame = RootFrame(subject, search_limits(subject, config), candidates, self.device)
        descent, judge = self._fitter.descent, self._judge
        self._answers = Download([descent.best, descent.tally, judge.cost, judge.count])
        self._replays, self._uncovered = Replays(self.device), UncoveredArea(subject, rig, self.device)
        self._look_interval = look_interval(abs(fps))
        first = np.repeat(subject.pose[None].astype(np.float32), config.runs, axis=0)
        self._state, self._has_searched = ContourState.at(first, len(subject.body.skeleton.parts)), True
        self._begun: Observation | None = None
        self._skipped = 0  # frames that are missing before the next one

    @property
    def state(self) -> ContourState:
        """All that the next frame depends on."""
        if self.search and self._has_searched:  # else what the search keeps is what it was
            memory = tuple(array.numpy().copy() for array in self.search.memory)
            counter = self.search.counter.numpy().copy()
            self._state = replace(self._state, counter=counter, search_memory=memory)
            self._has_searched = False
        return self._state

    @state.setter
    def state(self, state: ContourState) -> None:
        self._state, self._has_searched = state, True
        if self.search:
            self.search.counter.assign(state.counter)
            self.search.remember(state.search_memory)

    def begin(self, observation: Observation) -> None:
        """Let a GPU begin with the frame of the next :meth:`step`, which need not wait for it."""
        self._begun = observation
        if not observation.foreground.any():
            return
        self._fitter.observe(0, observation)
        self._judge.observe(observation)
        if not self.config.polish:
            last, before = self._state.pose, self._state.previous_pose
            moved_on = self._starts.within_limits(last + np.float32(_MOTION_KEPT) * (last - before))
            self._descend(np.stack([last, moved_on], axis=1), _STEPS)
            if self._state.is_looking(self._look_interval).any():
                self._uncovered.observe(observation)  # while a GPU descends

    def step(self, observation: Observation) -> FrameAnswer:
        """Find the pose of the next frame. Without any foreground the frame is lost and keeps the last pose."""
        started = time.perf_counter()
        if self._begun is not observation:
            self.begin(observation)
        self._begun = None
        if not observation.foreground.any():
            return lost_frame(self._state.pose.copy(), len(observation.foreground))

        # Find the best pose of each run.
        evaluations, rescued = 0, np.zeros(self._runs, bool)
        if self.search and self.config.polish:
            starts = self._searched(self.search, np.ones(self._runs, bool), observation)
            answer, evaluations = self._best_fit(starts, observation), self.search.evaluations
        else:
            answer = self._best(_STARTS, observation)
            if self.search_interval == 1:
                climbing = self._falls_short(answer) & (~self._state.climbed_in_vain | self._is_lost(answer))
                climbing &= self._shows_where(answer, climbing, observation)
            else:  # live, where a climb delays the frames after it
                state, place = self._state, int(self._state.frame_count.min())
                climbing = (~state.level_known | (state.lost_count >= _LOST_LIVE)) & (place >= self.next_search)
                if climbing.any():
                    climbing &= self._falls_short(answer, _LOST_OVERLAP, _LOST_EXPOSED)
                if climbing.any():
                    self.next_search = place + self.search_interval
            if self.search and climbing.any():
                answer, rescued = self._recovered(self.search, answer, climbing, observation)
                evaluations = self.search.evaluations
                climbing &= self._falls_short(answer)
            self._state = replace(self._state, climbed_in_vain=climbing & self._may_rest)

        # Now and then, and where the ladder led elsewhere, look for limbs that the body does not cover.
        looking = self._state.is_looking(self._look_interval) | rescued
        if looking.any():
            answer, limb_found = self._with_limbs_found(answer, looking, observation)
            rescued |= limb_found

        # Judge the answer by the frames before, then let it teach the frames after.
        lost = self._is_lost(answer)
        partial = self._state.doubt | (np.logical_not(observation.foreground.all()) & ~rescued)
        kinds = [STATUS.index(name) for name in ("lost", "partial", "rescued")]
        status = np.select([lost, partial, rescued], kinds, STATUS.index("tracked"))
        self._state = self._state.followed_by(answer, lost)
        if self._skipped:  # of what it moved since, a frame's share
            motion = (self._state.pose - self._state.previous_pose) / np.float32(1 + self._skipped)
            self._state, self._skipped = replace(self._state, previous_pose=self._state.pose - motion), 0
        return FrameAnswer(answer.pose, answer.cost, answer.iou, evaluations, status, time.perf_counter() - started)

    def skip(self, frames: int) -> None:
        """So many frames before the next are missing: the motion goes on across a few of them."""
        if 0 < frames <= _MOST_SKIPPED and not self._skipped:  # else nobody was seen since the last gap
            motion = self._state.pose - self._state.previous_pose
            self._state = replace(self._state, previous_pose=self._state.pose - np.float32(1 + frames) * motion)
            self._skipped = frames

    def _falls_short(
        self, answer: Candidates, fall: float = _SHORT_OVERLAP, exposed: float = _SHORT_EXPOSED
    ) -> np.ndarray:
        """(run,) bool: see :meth:`ContourState.falls_short`; ``exposed`` is at a body as large as a person [m]."""
        return self._state.falls_short(answer, fall, exposed * self._subject.body.relative_size)

    def _shows_where(self, answer: Candidates, short: np.ndarray, observation: Observation) -> np.ndarray:
        """(run,) bool: whether the runs that are ``short`` (run,) have more than the small fall of a mask's fault.

        That is a clear fall, an outline where nobody is seen, or mask area that the body does not cover.
        """
        state, few_views = self._state, len(observation.foreground) < _LEAST_VIEWS
        clear = np.asarray(self._falls_short(answer, _CLEAR_FALL) | ~state.level_known | few_views)
        size = self._subject.body.relative_size**2
        for run in np.flatnonzero(short & ~clear):
            (look,) = self._uncovered.of(answer.pose[run : run + 1], observation)
            clear[run] = state.excess(look.area, LARGEST_USUAL_AREA * size)[run].sum() > _SHORT_UNCOVERED * size
        return clear

    def _is_lost(self, answer: Candidates) -> np.ndarray:
        """(run,) bool: whether an answer is too far from the masks to be a pose of the body, whoever else is seen."""
        own = replace(answer, overlap=np.fmax(answer.overlap, answer.own_overlap))
        return np.asarray(self._state.level_known & self._falls_short(own, _LOST_OVERLAP, _LOST_EXPOSED))

    def _recovered(
        self, search: PoseSearch, answer: Candidates, short: np.ndarray, observation: Observation
    ) -> tuple[Candidates, np.ndarray]:
        """The best answer that the ladder of recovery leads to, and which runs (run,) were rescued by it.

        Runs that are not ``short`` (run,) keep their answer.
        """
        # Search from the last pose. What that finds is no rescue: it is what the paper does in every frame.
        climbing, rescued = short, np.zeros(self._runs, bool)
        answer, _ = self._improved(answer, short, self._searched(search, short, observation), observation)

        # Scatter around the best. It rescues where it gains as much as a frame may fall short by.
        short = climbing & self._falls_short(answer)
        if not short.any():
            return answer, rescued
        before, counter = answer.overlap, search.counter.numpy()
        starts = self._promising(self._starts.scattered(answer.pose, counter))
        answer, better = self._improved(answer, short, starts, observation)
        rescued |= better & self._state.level_known & (answer.overlap > before + _SHORT_OVERLAP)

        # Look for a body that stayed lost anywhere, then scatter around where it was found.
        wanted = climbing & self._falls_short(answer) & (self._state.lost_count >= _LOST_FRAMES)
        if wanted.any():
            starts = self._starts.anywhere(self._state.pose, counter, observation)
            answer, moved = self._improved(answer, wanted, starts, observation)
            starts = self._promising(self._starts.scattered(answer.pose, counter))
            answer, refined = self._improved(answer, moved, starts, observation)
            rescued |= moved | refined
        return answer, rescued

    def _with_limbs_found(
        self, answer: Candidates, looking: np.ndarray, observation: Observation
    ) -> tuple[Candidates, np.ndarray]:
        """The answer with limbs where masks were uncovered, for runs that are ``looking`` (run,), and which have some.

        What stays uncovered is in doubt from now on.
        """
        size, looks = self._subject.body.relative_size**2, self._uncovered.of(answer.pose, observation)
        excess = self._state.excess(np.stack([look.area for look in looks]), LARGEST_USUAL_AREA * size)

        # Fit limbs that reach to what stays uncovered. What one look alone shows may be a fault of its masks.
        lasts = np.minimum(excess.sum(axis=1), self._state.last_excess) > LASTING_AREA * size
        wanted, found = looking & lasts, np.zeros(self._runs, bool)
        if self.search and wanted.any():
            places = [look.place if want else look.place[:0] for look, want in zip(looks, wanted, strict=True)]
            starts = self._starts.reaching(answer.pose, self.search.counter.numpy(), places)
            self._descend(starts, _STEPS_FAR)
            other = self._most_covering(starts.shape[1], observation)
            # A limb is found where most of the area is covered then, and the overlap is as good.
            again = self._uncovered.of(other.pose, observation)
            left = self._state.excess(np.stack([look.area for look in again]), LARGEST_USUAL_AREA * size)
            found = wanted & (left.sum(axis=1) < _STILL_UNCOVERED * excess.sum(axis=1))
            found &= other.overlap > answer.overlap - _LARGEST_LOSS
            answer = other.where(found, answer)
            looks = [new if better else old for new, old, better in zip(again, looks, found, strict=True)]
            excess = np.where(found[:, None], left, excess)
        total = excess.sum(axis=1)
        repeated = np.minimum(total, self._state.last_excess)
        standing_out = stands_out(self._subject.body.relative_size, total, repeated, repeated)
        self._state = self._state.looked_at(looking, np.stack([look.area for look in looks]), excess, standing_out)
        return answer, found

    def _improved(
        self, answer: Candidates, wanted: np.ndarray, starts: np.ndarray, observation: Observation
    ) -> tuple[Candidates, np.ndarray]:
        """Fit starts (run, start, coordinate); where they are wanted (run,) and better, take them: which (run,)."""
        other = self._best_fit(starts, observation)
        better = wanted & (other.overlap > answer.overlap + _LEAST_GAIN)
        return other.where(better, answer), better

    def _searched(self, search: PoseSearch, wanted: np.ndarray, observation: Observation) -> np.ndarray:
        """What searches from the last poses find, (run, 1, coordinate).

        Runs (run,) that want nothing keep their random numbers, so that each is as it would be alone.
        """
        search.objective.observe(observation)
        counter = search.counter.numpy().copy()
        search.best_pose.assign(self._state.pose)
        search.run()
        self._has_searched = True
        search.counter.assign(np.where(wanted, search.counter.numpy(), counter).astype(np.int32))
        return np.asarray(search.best_pose.numpy()[:, None].copy())

    def _most_covering(self, count: int, observation: Observation) -> Candidates:
        """As :meth:`_best`, by what a pose leaves uncovered, too, among those that overlap most."""
        fitted, best = self._read(self._runs * count, observation), []
        for of_run in np.arange(len(fitted.pose)).reshape(self._runs, -1):
            likely = of_run[np.argsort(-fitted.overlap[of_run], kind="stable")[:_COMPARED]]
            left = np.array([look.area.sum() for look in self._uncovered.of(fitted.pose[likely], observation)])
            worth = fitted.overlap[likely] - _AREA_WORTH / self._subject.body.relative_size**2 * left
            best.append(likely[np.argmax(worth)])
        return fitted[np.array(best)]

    def _best_fit(self, starts: np.ndarray, observation: Observation) -> Candidates:
        """Fit starts (run, start, coordinate) by their contours: each run's best."""
        self._descend(starts, _STEPS_FAR)
        return self._best(starts.shape[1], observation)

    def _best(self, count: int, observation: Observation) -> Candidates:
        """Of so many poses of each run that contours led to, each run's best."""
        fitted = self._read(self._runs * count, observation)
        best = np.argmax(fitted.overlap.reshape(self._runs, count), axis=1)
        return fitted[best + count * np.arange(self._runs)]

    def _promising(self, starts: np.ndarray) -> np.ndarray:
        """Of starts (run, start, coordinate), where a few steps lead those of each run that then cost least."""
        self._descend(starts, _STEPS_SCATTERED, judged=False)
        pose, tally, *_ = self._answers.read(starts.shape[0] * starts.shape[1])
        cost = tally[:, :, 0].sum(axis=1).reshape(starts.shape[:2])
        best = np.argsort(cost, axis=1, kind="stable")[:, :_PROMISING]
        return np.asarray(np.take_along_axis(pose.reshape(starts.shape), best[:, :, None], axis=1))

    def _read(self, total: int, observation: Observation) -> Candidates:
        """The first poses that contours led to."""
        pose, tally, cost, pixels = self._answers.read(total)
        # Of the lengths of exposed outline in the views, the second longest.
        exposed = np.sort(tally[:, :, 3], axis=1)[:, -2:].min(axis=1)
        iou, matched = overlap(pixels, observation), tally[..., 2] > _MATCHED * tally[..., 1]
        own = overlap(pixels, observation, others_in(pixels, observation.foreground) * matched)
        return Candidates(pose, iou, exposed, cost, np.nanmean(iou, axis=1), without_stranger(own))

    def _descend(self, starts: np.ndarray, steps: int, *, judged: bool = True) -> None:
        """Let contours lead on from starts (run, start, coordinate), and judge where they lead unless that can wait."""
        runs, count, coordinates = starts.shape
        fitter, total = self._fitter, runs * count
        home = np.repeat(self._subject.root_base[None], total, axis=0)
        if fitter.late:
            fitter.follow(np.repeat(self._state.pose, count, axis=0), home, self._fps)
        fitter.set_starts(starts.reshape(total, coordinates), home, np.zeros(total, int))
        kind = (total, steps, judged, fitter.fields.addresses, self._judge.addresses, fitter.follows)
        self._replays.run(kind, lambda: self._launch_fit(total, steps, judged))

    def _launch_fit(self, total: int, steps: int, judged: bool) -> None:
        """Fit the first poses, judge them where that is wanted, and have the answers on their way to the host."""
        fitter, judge = self._fitter, self._judge
        fitter.send_starts(total)
        self._root_frame.enter(fitter.descent.pose, fitter.body.root_base)
        fitter.descend(total, steps)
        self._root_frame.leave(fitter.descent.best, fitter.body.root_base)
        if judged:
            wp.copy(judge.pose, fitter.descent.best, count=judge.pose.shape[1] * total)
            judge.evaluate(total)
        self._answers.fetch(total)
