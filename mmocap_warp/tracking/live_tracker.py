"""Two answers for each frame as it comes: at once, and smoothed by a process beside, whose solving delays no frame."""

from __future__ import annotations

import math
import multiprocessing
import os
import queue
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Self

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.contour.clip.clip_problem import LAG
from mmocap_warp.device.child_process import follow_parent
from mmocap_warp.device.resolve import start_quietly
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import STATUS, FrameAnswer
from mmocap_warp.tracking.contour_state import ContourState
from mmocap_warp.tracking.live import LiveFrame, Window
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import lost_frame

_MOST_BEHIND = 32  # frames that may wait to be smoothed; then the next frame waits too, so that memory stays the same
_NICENESS = 5  # of the process that smooths: where cores are few, the frame that has just come goes first
_PATIENCE = 1.0  # seconds between looks at whether that process lives
_REHEARSAL = 1.2  # seconds that are tracked before the first frame: all that is done now and then has been done once


class LiveTracker:
    """Tracks a subject while frames come; to be used in a ``with``.

    Frames that are left out count as frames in which nobody is seen. After more than ten of them smoothing begins
    anew. The same frames get the same answers, however fast they come.

    Args:
        subject: the body, and the pose to start from.
        cameras: undistorted, at the masks' size: ``scene.rig(scale)``.
        fps: frames a second.
        config: settings.

    Raises:
        ValueError: ``smooth`` is 0.
        InputError: more than fits into the device's memory, or the tracking mesh is not closed.
    """

    def __init__(self, subject: Subject, cameras: CameraRig, fps: float, config: TrackConfig) -> None:
        if not config.acceleration:
            raise ValueError(f"smooth must be more than 0 to track live, {config.algorithm} has {config.acceleration}")
        self._tracker = make_tracker(subject, cameras, config, fps)
        self._poser = Poser(subject.body, subject.root_base)
        context = multiprocessing.get_context("spawn")  # a fork would not survive CUDA
        self._frames, self._smoothed = context.Queue(_MOST_BEHIND), context.Queue()
        own = (subject, cameras, replace(config, threads=1), fps)
        self._process = context.Process(target=_smooth, args=(self._frames, self._smoothed, *own), daemon=True)
        self._process.start()
        # Meanwhile, rehearse with the body where it is taken to be: kernels are loaded, and graphs captured.
        first, state = _seen_at_start(subject, cameras, self._poser), self._tracker.state
        for number in range(math.ceil(_REHEARSAL * fps)):
            self._frame(number, self._tracked(first, number == 0))
        self._tracker.state = state
        self._begun = False
        self._next()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.join()

    def step(self, number: int, masks: Sequence[np.ndarray]) -> LiveFrame:
        """Track frame ``number``, at once: no later frame has a say in the answer.

        Args:
            number: of the frame, greater than that of the frame before.
            masks: (height, width) bool of each camera; nothing of one that shows nothing.
        """
        observation = Observation.from_masks(list(masks))
        answer = self._tracked(observation, not self._begun)
        self._begun = True
        self._hand_on((number, observation, answer))
        return self._frame(number, answer)

    def smoothed(self) -> Iterator[LiveFrame]:
        """The frames whose smoothed answers have come since."""
        with suppress(queue.Empty):
            while True:
                yield self._checked(self._smoothed.get_nowait())

    def rest(self) -> Iterator[LiveFrame]:
        """The smoothed answers that are missing, once no frame will come."""
        self._hand_on(None)
        while (frame := self._next()) is not None:
            yield frame

    def _tracked(self, observation: Observation, is_first: bool) -> FrameAnswer:
        answer = self._tracker.step(observation)
        if is_first and isinstance(state := self._tracker.state, ContourState):
            self._tracker.state = state.settled()  # else the next frames would be searched for too, which takes long
        return answer

    def _frame(self, number: int, answer: FrameAnswer) -> LiveFrame:
        """What is known at once."""
        pose = answer.pose.astype(float)
        joints = self._poser.joint_transforms(pose)[:, :, :3, 3].astype(float)
        status = tuple(STATUS[each] for each in np.broadcast_to(answer.status, len(pose)))
        return LiveFrame(number, pose, pose, joints, answer.iou, status)

    def _hand_on(self, frame: Any) -> None:
        while True:
            with suppress(queue.Full):
                return self._frames.put(frame, timeout=_PATIENCE)
            self._check_alive()

    def _next(self) -> LiveFrame | None:
        """What the process says next."""
        while True:
            with suppress(queue.Empty):
                return self._checked(self._smoothed.get(timeout=_PATIENCE))
            self._check_alive()

    def _checked(self, said: Any) -> Any:
        if isinstance(said, Exception):
            raise said
        return said

    def _check_alive(self) -> None:
        if not self._process.is_alive():
            raise RuntimeError(f"the process that smooths ended with exit code {self._process.exitcode}")


def _seen_at_start(subject: Subject, cameras: CameraRig, poser: Poser) -> Observation:
    """The body in its first pose."""
    (vertices,) = poser.tracking_vertices(subject.pose)
    return Observation.from_masks(silhouettes(cameras, vertices, subject.body.tracking_face))


def _smooth(frames: Any, smoothed: Any, subject: Subject, cameras: CameraRig, config: TrackConfig, fps: float) -> None:
    """Smooth frames as they are handed on, up to a None; say None when ready, and in the end."""
    follow_parent()
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    start_quietly()
    try:
        seen = _seen_at_start(subject, cameras, Poser(subject.body, subject.root_base))
        at_start = np.tile(subject.pose.astype(np.float32), (config.runs, 1))
        known = replace(lost_frame(at_start, seen), status=STATUS.index("tracked"))
        for _ in _smoothed(((number, seen, known) for number in range(LAG)), subject, cameras, config, fps):
            pass  # a rehearsal
        smoothed.put(None)
        for frame in _smoothed(iter(frames.get, None), subject, cameras, config, fps):
            smoothed.put(frame)
        smoothed.put(None)
    except Exception as error:
        smoothed.put(RuntimeError(f"{type(error).__name__}: {error}"))  # every kind of error may not survive the way


def _smoothed(
    frames: Any, subject: Subject, cameras: CameraRig, config: TrackConfig, fps: float
) -> Iterator[LiveFrame]:
    """The smoothed answers to frames, each a number, what was seen and what was found at once."""
    window, expected, before = None, 0, None
    for number, observation, answer in frames:
        if window is None or number - expected > LAG:
            if window is not None:
                yield from window.rest()
            window, expected = Window(subject, cameras, config, fps, number), number
        nothing = observation.without(np.ones(len(cameras), bool))
        for _ in range(expected, number):
            window.observe(nothing)
            yield from window.add(lost_frame(before, nothing))
        window.observe(observation)
        yield from window.add(answer)
        expected, before = number + 1, answer.pose
    if window is not None:
        yield from window.rest()
