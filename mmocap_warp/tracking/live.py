"""Tracking while frames still come: poses are final a few frames after they were seen, and nothing older is kept.

:class:`LiveTracker` also answers at once, and leaves solving to a process beside, so that no frame waits for it.
"""

import math
import multiprocessing
import os
import queue
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.contour.clip.clip_problem import LAG, ClipProblem, FixedLag
from mmocap_warp.contour.clip.device_band import DeviceBand
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.normal_equations import NormalEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting
from mmocap_warp.device.resolve import resolve_device, start_quietly
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.tracking.body_masks import body_silhouettes
from mmocap_warp.tracking.contour_state import ContourState
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.frame_loop import track_frames
from mmocap_warp.tracking.from_settings import in_own_unit, make_fitter, search_limits
from mmocap_warp.tracking.holes import with_holes
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import lost_frame

_LOST, _INTERPOLATED = STATUS.index("lost"), STATUS.index("interpolated")

_MOST_BEHIND = 32  # frames that may wait to be smoothed; then the next frame waits too, so that memory stays the same
_SMOOTHING_THREADS = 4  # of the process that smooths, where a GPU tracks several people
_NICENESS = 19  # of the process that smooths: where cores are few, the frame that has just come goes first
_PATIENCE = 1.0  # seconds between looks at whether that process lives
_SEARCH_INTERVAL = 0.5  # seconds from a search to the next: it takes nearly as long, and frames are dropped meanwhile
_REHEARSAL = 1.2  # seconds that are tracked before the first frame: all that is done now and then has been done once


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A frame's final answer.

    A frame that was lost is ``interpolated`` if the body is seen both before and within the lag, and stays ``lost``
    otherwise: its pose is where the motion led.
    """

    number: int  # of the frame, from 0
    pose: np.ndarray  # (run, coordinate) float64, smoothed with the frames around it [m, rad]
    raw_pose: np.ndarray  # (run, coordinate), as it was tracked
    joints: np.ndarray  # (run, joint, 3) float64, joint centres of ``pose`` in the world [m]
    iou: np.ndarray  # (run, camera) float64, overlap of ``raw_pose`` with the masks; NaN for a lost view
    status: tuple[str, ...]  # a name of ``STATUS`` for each run


def track_live(
    subject: Subject,
    cameras: CameraRig,
    masks: Iterable[Sequence[np.ndarray]],
    fps: float,
    config: TrackConfig | None = None,
    **settings: Any,
) -> Iterator[LiveFrame]:
    """Track frames as they come, and give each as soon as it is final: at most nine frames after it was taken in.

    Ten frames are solved together whenever they are there, and the first four of them are final. No more than these
    are held, however long it runs. When ``masks`` ends, the frames that are left follow.

    Args:
        subject: the body, and the pose to start from.
        cameras: undistorted, at the masks' size: ``scene.rig(scale)``.
        masks: of each frame, a (height, width) bool mask of each camera.
        fps: frames a second.
        config: settings; None for the defaults.
        settings: fields of :class:`TrackConfig` to replace those of ``config``.

    Raises:
        ValueError, TypeError: a setting that cannot be, or is none; or ``smooth`` is 0.
        InputError: more than fits into the device's memory, or the tracking mesh is not closed.
    """
    config = replace(config or TrackConfig(), **settings)
    if not config.acceleration:
        raise ValueError(f"smooth must be more than 0 to track live, {config.algorithm} has {config.acceleration}")
    window = _Window(subject, cameras, config, fps)
    subject, cameras, config = in_own_unit(subject, cameras, config)
    tracker = make_tracker(subject, cameras, config, fps)
    silhouettes_of = body_silhouettes(subject, cameras)
    observations: Iterable[Observation] = (Observation.from_masks(list(each)) for each in masks)
    observations = with_holes(observations, fps, lambda _: silhouettes_of(tracker.state.pose))
    for answer in track_frames(tracker, observations, keep=window.observe):
        yield from window.add(answer)
    yield from window.rest()


class _Window:
    """The frames that are not final yet; ``first`` is the number of the first frame."""

    def __init__(self, subject: Subject, cameras: CameraRig, config: TrackConfig, fps: float, first: int = 0) -> None:
        skeleton = subject.body.skeleton
        self._poser, self._units = Poser(subject.body, subject.root_base), skeleton.units(subject.body.unit)
        subject, cameras, config = in_own_unit(subject, cameras, config)
        searched, limits = skeleton.searched(config.dof), search_limits(subject, config)
        self._rooting = rooting = Rooting(skeleton, subject.root_base, searched, limits)
        points = MotionPoints(skeleton, subject.body.joint_rest, searched)
        self._fitter = make_fitter(subject, cameras, config, LAG, frames=LAG)
        self._answers: list[FrameAnswer] = []
        self._first = first  # number of the first of these
        self._tracked_before = np.zeros(config.runs, bool)
        self._last_angles = np.tile(subject.pose[ROOT_ANGLES], (config.runs, 1))
        device = resolve_device(config.device)
        band = None if device == "cpu" else DeviceBand(points, LAG, device)
        clips = (ClipProblem(partial(self._linearise, n), rooting, points, fps, band=band) for n in range(config.runs))
        self._lags = [FixedLag(clip, config.acceleration, first) for clip in clips]

    def observe(self, observation: Observation) -> None:
        """Take the next frame's masks."""
        self._fitter.observe((self._first + len(self._answers)) % LAG, observation)

    def add(self, answer: FrameAnswer) -> Iterator[LiveFrame]:
        """Take the answer of the frame that was observed last; the frames that are final now."""
        self._answers.append(answer)
        solved = [lag.add(self._rooting.enter(pose[None])) for lag, pose in zip(self._lags, answer.pose, strict=True)]
        yield from self._final([each for each in solved if each is not None])

    def rest(self) -> Iterator[LiveFrame]:
        """The last frames."""
        yield from self._final([each for each in (lag.rest() for lag in self._lags) if each is not None])

    def _linearise(self, run: int, frames: np.ndarray, rooted: RootedPoses) -> NormalEquations:
        """What the contours say; nothing about frames that were lost."""
        contour = self._fitter.linearise(frames % LAG, rooted)
        return contour.of_seen(np.array([self._is_tracked(self._answers[f - self._first])[run] for f in frames]))

    def _is_tracked(self, answer: FrameAnswer) -> np.ndarray:
        """(run,) bool: the runs that are not lost."""
        return np.asarray(np.broadcast_to(answer.status, len(self._lags)) != _LOST)

    def _final(self, solved: list[RootedPoses]) -> Iterator[LiveFrame]:
        """The oldest frames, with the poses that were solved for each run."""
        if not solved:
            return
        poses = np.stack([self._rooting.leave(*each) for each in zip(solved, self._last_angles, strict=True)])
        self._last_angles = poses[:, -1, ROOT_ANGLES]
        tracked = np.array([self._is_tracked(answer) for answer in self._answers])
        final, self._answers = self._answers[: poses.shape[1]], self._answers[poses.shape[1] :]
        for i, answer in enumerate(final):
            between = ~tracked[i] & self._tracked_before & tracked[i:].any(axis=0)
            self._tracked_before |= tracked[i]
            status = np.where(between, _INTERPOLATED, answer.status)
            yield _live_frame(self._poser, self._units, self._first, poses[:, i], answer, status)
            self._first += 1


def _live_frame(
    poser: Poser, units: np.ndarray, number: int, pose: np.ndarray, answer: FrameAnswer, status: int | np.ndarray
) -> LiveFrame:
    """A frame of poses (run, coordinate) in ``units`` (coordinate,)."""
    pose = pose * units
    joints = poser.joint_transforms(pose)[:, :, :3, 3].astype(float)
    names = tuple(STATUS[each] for each in np.broadcast_to(status, len(pose)))
    return LiveFrame(number, pose, answer.pose * units, joints, answer.iou, names)


class LiveTracker:
    """Tracks a subject while frames come, until it is closed.

    Frames that are left out count as frames in which nobody is seen. After more than ten of them smoothing begins
    anew. The same frames get the same answers, however fast they come. A script that makes a tracker does so below
    ``if __name__ == "__main__"``: the process that smooths imports it.

    Args:
        subject: the body, and the pose to start from.
        cameras: undistorted, at the masks' size: ``scene.rig(scale)``.
        fps: frames a second.
        config: settings.
        hidden: whether observations say what may be in front of the subject.
        alone: whether nobody else is tracked at the same time.

    Raises:
        ValueError: ``smooth`` is 0.
        InputError: more than fits into the device's memory, or the tracking mesh is not closed.
    """

    def __init__(
        self,
        subject: Subject,
        cameras: CameraRig,
        fps: float,
        config: TrackConfig,
        hidden: bool = False,
        *,
        alone: bool = True,
    ) -> None:
        if not config.acceleration:
            raise ValueError(f"smooth must be more than 0 to track live, {config.algorithm} has {config.acceleration}")
        smoothing = replace(config, threads=1)
        if not alone and resolve_device(config.device) != "cpu":
            # The GPU would let frames that have just come wait while it smooths everybody's others.
            smoothing = replace(config, device="cpu", threads=_SMOOTHING_THREADS)
        body, given = subject.body, (subject, cameras, smoothing, fps)
        self._poser, self._units = Poser(body, subject.root_base), body.skeleton.units(body.unit)
        subject, cameras, config = in_own_unit(subject, cameras, config)
        self._tracker = make_tracker(subject, cameras, config, fps)
        if isinstance(self._tracker, ContourTracker):
            self._tracker.search_interval = max(2, round(_SEARCH_INTERVAL * fps))
        self._silhouettes_of, self._fps = body_silhouettes(subject, cameras), fps
        self._follow_holes()
        context = multiprocessing.get_context("spawn")  # a fork would not survive CUDA
        self._frames, self._solved = context.Queue(_MOST_BEHIND), context.Queue()
        self._frames.cancel_join_thread()  # else what nobody takes any more would keep this process from ending
        self._process = context.Process(target=_smooth, args=(self._frames, self._solved, *given), daemon=True)
        self._process.start()
        # Rehearse with the body where it is taken to be.
        state, (vertices,) = self._tracker.state, Poser(subject.body, subject.root_base).tracking_vertices(subject.pose)
        masks = silhouettes(cameras, vertices, subject.body.tracking_face)
        seen = Observation.from_masks(masks, None, masks if hidden else None)
        self._begun = False
        for number in range(math.ceil(_REHEARSAL * fps)):
            self.step(number, seen)
        for _ in self.rest():
            pass
        self._tracker.state, self._begun = state, False
        self._follow_holes()

    def _follow_holes(self) -> None:
        """From the next frame on, follow the holes that open in masks."""
        self._come: list[Observation] = []
        self._expected = 0
        come = (self._come.pop() for _ in count())
        self._followed = with_holes(come, self._fps, lambda _: self._silhouettes_of(self._tracker.state.pose))

    def close(self) -> None:
        """End the process that smooths."""
        self._process.terminate()
        self._process.join()

    def step(self, number: int, seen: Observation | Sequence[np.ndarray]) -> LiveFrame:
        """Track a frame, whose number is above the last, by what was seen; no later frame has a say.

        That may be a (height, width) bool mask of each camera.
        """
        observation = seen if isinstance(seen, Observation) else Observation.from_masks(list(seen))
        if number != self._expected:  # what is gone since may have moved
            self._come.append(_nothing(observation))
            next(self._followed)
        self._come.append(observation)
        observation, self._expected = next(self._followed), number + 1
        answer = self._tracker.step(observation)
        if not self._begun and isinstance(state := self._tracker.state, ContourState):
            self._tracker.state = state.settled()  # else the next frames would be searched for too, which takes long
        self._begun = True
        self._patiently(partial(self._frames.put, (number, observation, answer)))
        return _live_frame(self._poser, self._units, number, answer.pose, answer, answer.status)

    def smoothed(self) -> Iterator[LiveFrame]:
        """The frames whose smoothed answers have come since."""
        with suppress(queue.Empty):
            while True:
                yield self._solved.get_nowait()

    def rest(self) -> Iterator[LiveFrame]:
        """The smoothed answers that are missing, once no frame will come."""
        self._patiently(partial(self._frames.put, None))
        yield from iter(partial(self._patiently, self._solved.get), None)

    def _patiently(self, act: Callable[..., Any]) -> Any:
        """Do what may have to wait for the process that smooths; a RuntimeError if that is dead."""
        while True:
            with suppress(queue.Empty, queue.Full):
                return act(timeout=_PATIENCE)
            if not self._process.is_alive():
                raise RuntimeError(f"the process that smooths ended with exit code {self._process.exitcode}")


def _nothing(observation: Observation) -> Observation:
    """A frame in which nobody is seen."""
    return observation.without(np.ones(len(observation.foreground), bool))


def _smooth(frames: Any, solved: Any, *about: Any) -> None:
    """Smooth frames as they are handed on, up to a None, which is handed back after them; until the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    start_quietly()

    def next_frame() -> Any:
        while (parent := multiprocessing.parent_process()) and parent.is_alive():
            with suppress(queue.Empty):
                return frames.get(timeout=_PATIENCE)
        os._exit(1)

    while True:
        for frame in _smoothed(iter(next_frame, None), *about):
            solved.put(frame)
        solved.put(None)


def _smoothed(frames: Iterable[tuple[int, Observation, FrameAnswer]], *about: Any) -> Iterator[LiveFrame]:
    """The smoothed answers to frames, each a number, what was seen and what was found at once."""
    window, expected, before = None, 0, np.empty(0)
    for number, observation, answer in frames:
        if window is None or number - expected > LAG:
            yield from window.rest() if window else ()
            window, expected = _Window(*(*about, number)), number
        for _ in range(expected, number):
            nothing = _nothing(observation)
            window.observe(nothing)
            yield from window.add(lost_frame(before, nothing))
        window.observe(observation)
        yield from window.add(answer)
        expected, before = number + 1, answer.pose
    yield from window.rest() if window else ()
