"""Two answers for each frame as it comes: at once, and smoothed by a process beside, whose solving delays no frame."""

from __future__ import annotations

import math
import multiprocessing
import os
import queue
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
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
        self._frames, self._solved = context.Queue(_MOST_BEHIND), context.Queue()
        given = self._frames, self._solved, subject, cameras, replace(config, threads=1), fps
        self._process = context.Process(target=_smooth, args=given, daemon=True)
        self._process.start()
        # Rehearse with the body where it is taken to be.
        state, (vertices,) = self._tracker.state, self._poser.tracking_vertices(subject.pose)
        seen = silhouettes(cameras, vertices, subject.body.tracking_face)
        self._begun = False
        for number in range(math.ceil(_REHEARSAL * fps)):
            self.step(number, seen)
        for _ in self.rest():
            pass
        self._tracker.state, self._begun = state, False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.join()

    def step(self, number: int, masks: Sequence[np.ndarray]) -> LiveFrame:
        """Track frame ``number``, greater than that before, at once: no later frame has a say in the answer.

        ``masks`` are (height, width) bool of each camera, empty where one shows nothing.
        """
        observation = Observation.from_masks(list(masks))
        answer = self._tracker.step(observation)
        if not self._begun and isinstance(state := self._tracker.state, ContourState):
            self._tracker.state = state.settled()  # else the next frames would be searched for too, which takes long
        self._begun = True
        self._patiently(partial(self._frames.put, (number, observation, answer)))
        pose = answer.pose.astype(float)
        joints = self._poser.joint_transforms(pose)[:, :, :3, 3].astype(float)
        status = tuple(STATUS[each] for each in np.broadcast_to(answer.status, len(pose)))
        return LiveFrame(number, pose, pose, joints, answer.iou, status)

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
        """Do what may have to wait for the process that smooths.

        Raises:
            RuntimeError: it is dead.
        """
        while True:
            with suppress(queue.Empty, queue.Full):
                return act(timeout=_PATIENCE)
            if not self._process.is_alive():
                raise RuntimeError(f"the process that smooths ended with exit code {self._process.exitcode}")


def _smooth(frames: Any, solved: Any, *given: Any) -> None:
    """Smooth frames as they are handed on, up to a None, which is handed back after them; and again, without end."""
    follow_parent()
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    start_quietly()
    while True:
        for frame in _smoothed(iter(frames.get, None), *given):
            solved.put(frame)
        solved.put(None)


def _smoothed(frames: Iterable[tuple[int, Observation, FrameAnswer]], *about: Any) -> Iterator[LiveFrame]:
    """The smoothed answers to frames, each a number, what was seen and what was found at once."""
    window, expected, before = None, 0, None
    for number, observation, answer in frames:
        if window is None or number - expected > LAG:
            yield from window.rest() if window else ()
            window, expected = Window(*about, first=number), number
        for _ in range(expected, number):
            nothing = observation.without(np.ones(len(observation.foreground), bool))
            window.observe(nothing)
            yield from window.add(lost_frame(before, nothing))
        window.observe(observation)
        yield from window.add(answer)
        expected, before = number + 1, answer.pose
    yield from window.rest() if window else ()
