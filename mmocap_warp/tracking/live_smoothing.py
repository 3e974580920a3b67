"""A process that smooths people's frames, so that no frame that has just come waits for it."""

import multiprocessing
import os
import queue
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from threading import Timer
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject, joint_transforms
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.contour.clip.clip_problem import LAG, ClipProblem, FixedLag
from mmocap_warp.contour.clip.device_band import DeviceBand
from mmocap_warp.contour.clip.motion_points import MotionPoints
from mmocap_warp.contour.frame.normal_equations import NormalEquations
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting
from mmocap_warp.device.resolve import resolve_device, start_quietly
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.tracking.from_settings import in_own_unit, make_fitter, search_limits
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import lost_frame

_LOST, _INTERPOLATED = STATUS.index("lost"), STATUS.index("interpolated")

_MOST_BEHIND = 32  # of a person's frames that wait to be smoothed; then the next waits too, so that memory is bounded
_NICENESS = 19  # where cores are few, the frame that has just come goes first
_GRACE = 10.0  # seconds that such a process has after SIGTERM
_PATIENCE = 1.0  # seconds between looks at whether the process lives


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A frame's final answer.

    A frame that was lost is ``interpolated`` if the body is seen both before and within the lag, and stays ``lost``
    otherwise: its pose is where the motion led.
    """

    number: int  # of the frame, from 0
    pose: np.ndarray  # (run, coordinate) float64, smoothed with the frames around it [m, rad]
    raw_pose: np.ndarray  # (run, coordinate), as it was tracked
    world: np.ndarray  # (run, joint, 4, 4) float64, the joints' transforms in ``pose``, for column vectors [m]
    iou: np.ndarray  # (run, camera) float64, overlap of ``raw_pose`` with the masks; NaN for a lost view
    status: tuple[str, ...]  # a name of ``STATUS`` for each run

    @property
    def joints(self) -> np.ndarray:
        """(run, joint, 3) float64, joint centres in the world [m]."""
        return self.world[:, :, :3, 3]


class Window:
    """The frames that are not final yet; ``first`` is the number of the first frame."""

    def __init__(self, subject: Subject, cameras: CameraRig, config: TrackConfig, fps: float, first: int = 0) -> None:
        skeleton = subject.body.skeleton
        self._subject, self._units = subject, skeleton.units(subject.body.unit)
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
            yield live_frame(self._subject, self._units, self._first, poses[:, i], answer, status)
            self._first += 1


def live_frame(
    subject: Subject, units: np.ndarray, number: int, pose: np.ndarray, answer: FrameAnswer, status: int | np.ndarray
) -> LiveFrame:
    """A frame of poses (run, coordinate) in ``units`` (coordinate,)."""
    pose = pose * units
    _, world = joint_transforms(subject, pose)
    names = tuple(STATUS[each] for each in np.broadcast_to(status, len(pose)))
    return LiveFrame(number, pose, answer.pose * units, world, answer.iou, names)


class SmoothingProcess:
    """Smooths people's frames, so that no frame that has just come waits for it; it is to be closed.

    Args:
        people: of each, the first four arguments of a :class:`LiveTracker`.
    """

    def __init__(self, people: Sequence[tuple[Any, ...]]) -> None:
        context = multiprocessing.get_context("spawn")  # a fork would not survive CUDA
        self._frames = context.Queue(_MOST_BEHIND * len(people))
        self._frames.cancel_join_thread()  # else what nobody takes any more would keep this process from ending
        self._solved = [context.Queue() for _ in people]
        self._process = context.Process(target=_smooth, args=(self._frames, self._solved), daemon=True)
        self._process.start()
        self._frames.put(people)  # to start with them would wait without an end for a process that cannot start

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()

    def hand_on(self, person: int, number: int, observation: Observation, answer: FrameAnswer) -> None:
        """Let a frame be smoothed: what was seen, and what was found at once."""
        self._patiently(partial(self._frames.put, (person, number, observation, answer)))

    def solved(self, person: int) -> Iterator[LiveFrame]:
        """The frames whose smoothed answers have come since."""
        with suppress(queue.Empty):
            while True:
                yield self._solved[person].get_nowait()

    def rest(self, person: int) -> Iterator[LiveFrame]:
        """The smoothed answers that are missing, once no frame will come."""
        self._patiently(partial(self._frames.put, (person,)))
        yield from iter(partial(self._patiently, self._solved[person].get), None)

    def _patiently(self, act: Callable[..., Any]) -> Any:
        """Do what may have to wait for the process; a RuntimeError if that is dead."""
        while True:
            with suppress(queue.Empty, queue.Full):
                return act(timeout=_PATIENCE)
            if not self._process.is_alive():
                raise RuntimeError(f"the process that smooths ended with exit code {self._process.exitcode}")


def start_beside() -> None:
    """Start Warp in a process that outlives Ctrl-C, and SIGTERM for a while: its parent still wants what is missing."""
    end = Timer(_GRACE, os._exit, (1,))
    end.daemon = True  # a process that is done by then does not wait
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: None if end.is_alive() else end.start())
    start_quietly()


def _smooth(frames: Any, solved: Any) -> None:
    """Smooth people's frames as they are handed on, until the parent is gone; after a last frame comes a None."""
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    start_beside()
    smoothers: list[_Smoother] = []
    while (parent := multiprocessing.parent_process()) and parent.is_alive():
        with suppress(queue.Empty):
            if not smoothers:
                smoothers = [_Smoother(*about) for about in frames.get(timeout=_PATIENCE)]
                continue
            person, *frame = frames.get(timeout=_PATIENCE)
            for each in smoothers[person].add(*frame) if frame else smoothers[person].rest():
                solved[person].put(each)
    os._exit(1)


class _Smoother:
    """Smooths a person's frames."""

    def __init__(self, subject: Subject, cameras: CameraRig, fps: float, config: TrackConfig, *_: Any) -> None:
        self._begin = partial(Window, subject, cameras, replace(config, threads=1), fps)
        self._window: Window | None = None
        self._expected, self._last_pose = 0, np.empty(0)

    def add(self, number: int, observation: Observation, answer: FrameAnswer) -> Iterator[LiveFrame]:
        """Take a frame; those that are final now."""
        if self._window is None or number - self._expected > LAG:
            yield from self._window.rest() if self._window else ()
            self._window, self._expected = self._begin(number), number
        for _ in range(self._expected, number):
            nothing = nothing_seen(observation)
            self._window.observe(nothing)
            yield from self._window.add(lost_frame(self._last_pose, len(nothing.foreground)))
        self._window.observe(observation)
        yield from self._window.add(answer)
        self._expected, self._last_pose = number + 1, answer.pose

    def rest(self) -> Iterator[LiveFrame | None]:
        """The last frames, and a None."""
        yield from self._window.rest() if self._window else ()
        self._window = None
        yield None


def nothing_seen(observation: Observation) -> Observation:
    """A frame in which nobody is seen."""
    return observation.without(np.ones(len(observation.foreground), bool))
