"""Tracking while frames still come: poses are final a few frames after they were seen, and nothing older is kept.

:class:`LiveTracker` also answers at once, and leaves solving to a process beside, so that no frame waits for it.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.masks.observation import Observation
from mmocap_warp.result.result import FrameAnswer
from mmocap_warp.tracking.contour_state import ContourState
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.frame_loop import track_frames
from mmocap_warp.tracking.from_settings import in_own_unit
from mmocap_warp.tracking.live_smoothing import LiveFrame, SmoothingProcess, Window, live_frame, nothing_seen
from mmocap_warp.tracking.loose_clothes import with_hidden
from mmocap_warp.tracking.make_tracker import make_tracker
from mmocap_warp.tracking.track_config import TrackConfig

_SEARCH_INTERVAL = 0.5  # seconds from a search to the next: it takes nearly as long, and frames are dropped meanwhile
_REHEARSAL = 1.2  # seconds that are tracked before the first frame: all that is done now and then has been done once


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
    _check(config, fps)
    window = Window(subject, cameras, config, fps)
    subject, cameras, config = in_own_unit(subject, cameras, config)
    tracker = make_tracker(subject, cameras, config, fps)
    observations: Iterable[Observation] = (_observed(each, cameras) for each in masks)
    observations = with_hidden(observations, subject, cameras, fps, lambda _: tracker.state.pose)
    for answer in track_frames(tracker, observations, keep=window.observe):
        yield from window.add(answer)
    yield from window.rest()


def _check(config: TrackConfig, fps: float) -> None:
    if not config.acceleration:
        raise ValueError(f"smooth must be more than 0 to track live, {config.algorithm} has {config.acceleration}")
    if not fps > 0:
        raise ValueError(f"fps must be above 0, got {fps:g}")


def _observed(masks: Sequence[np.ndarray], rig: CameraRig) -> Observation:
    """A frame's masks; a ValueError unless they are one of each camera, in its size."""
    shapes, sizes = [np.shape(mask) for mask in masks], [(height, width) for width, height in rig.size.tolist()]
    if shapes != sizes:
        raise ValueError(f"masks must be one of each camera, (height, width) {sizes}, got {shapes}")
    return Observation.from_masks([np.asarray(mask, bool) for mask in masks])


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
        smoothed_by: the process that smooths, and which of its people this is; None for an own one.

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
        smoothed_by: tuple[SmoothingProcess, int] | None = None,
    ) -> None:
        _check(config, fps)
        given = subject, cameras, fps, config
        self._subject, self._units = subject, subject.body.skeleton.units(subject.body.unit)
        subject, cameras, config = in_own_unit(subject, cameras, config)
        device, self._rig = resolve_device(config.device), cameras
        self._stream = None if device == "cpu" else wp.Stream(device)  # several trackers' streams run side by side
        with self._own_stream():
            self._tracker = make_tracker(subject, cameras, config, fps)
            self._smoother, self._person = smoothed_by or (SmoothingProcess([given]), 0)
            if isinstance(self._tracker, ContourTracker):
                self._tracker.search_interval = max(2, round(_SEARCH_INTERVAL * fps))
            self._followed_by = partial(with_hidden, subject=subject, rig=cameras, rate=fps)
            self._follow_holes()
            # Rehearse with the body where it is taken to be.
            state, poser = self._tracker.state, Poser(subject.body, subject.root_base)
            masks = silhouettes(cameras, poser.tracking_vertices(subject.pose)[0], subject.body.tracking_face)
            seen = Observation.from_masks(masks, None, masks if hidden else None)
            self._begun, self._unsent = False, list[tuple[int, int, Observation, FrameAnswer]]()
            for number in range(math.ceil(_REHEARSAL * fps)):
                self.step(number, seen)
            for _ in self.rest():
                pass
            self._tracker.state, self._begun = state, False
            if isinstance(self._tracker, ContourTracker):
                self._tracker.next_search = 0
            self._follow_holes()

    def _own_stream(self) -> wp.ScopedStream:
        return wp.ScopedStream(self._stream, sync_enter=False)

    def _follow_holes(self) -> None:
        """From the next frame on, follow the holes that open in masks."""
        self._come: list[Observation] = []
        self._expected = 0
        come = (self._come.pop() for _ in count())
        self._followed = self._followed_by(come, pose=lambda _: self._tracker.state.pose)

    def close(self) -> None:
        """End the process that smooths, the other people's too where it has several."""
        self._smoother.close()

    def step(self, number: int, seen: Observation | Sequence[np.ndarray]) -> LiveFrame:
        """Track a frame, whose number is above the last, by what was seen; no later frame has a say.

        That may be a (height, width) bool mask of each camera.
        """
        self.begin(number, seen)
        return self.finish()

    def begin(self, number: int, seen: Observation | Sequence[np.ndarray]) -> None:
        """Let a GPU begin with a frame; then the frames of others may be begun before this one is finished."""
        self._hand_on()
        observation = seen if isinstance(seen, Observation) else _observed(seen, self._rig)
        if number < self._expected:
            raise ValueError(f"frame {number} comes after frame {self._expected - 1}: numbers must ascend")
        with self._own_stream():
            if number != self._expected:  # what is gone since may have moved
                self._come.append(nothing_seen(observation))
                next(self._followed)
                if isinstance(self._tracker, ContourTracker):
                    self._tracker.skip(number - self._expected)
            self._come.append(observation)
            self._observation, self._expected = next(self._followed), number + 1
            if isinstance(self._tracker, ContourTracker):
                self._tracker.begin(self._observation)

    def finish(self) -> LiveFrame:
        """What is found of the frame that was begun."""
        number, observation = self._expected - 1, self._observation
        with self._own_stream():
            answer = self._tracker.step(observation)
            if not self._begun and isinstance(state := self._tracker.state, ContourState):
                self._tracker.state = state.settled()  # else the next frames would be searched for too: slow
        self._unsent.append((self._person, number, observation, answer))
        self._begun = True
        return live_frame(self._subject, self._units, number, answer.pose, answer, answer.status)

    def _hand_on(self) -> None:
        """Let the last frame be smoothed. A thread sends it, and would delay the answer at once if that came later."""
        while self._unsent:
            self._smoother.hand_on(*self._unsent.pop())

    def smoothed(self) -> Iterator[LiveFrame]:
        """The frames whose smoothed answers have come since."""
        self._hand_on()
        yield from self._smoother.solved(self._person)

    def rest(self) -> Iterator[LiveFrame]:
        """The smoothed answers that are missing, once no frame will come."""
        self._hand_on()
        yield from self._smoother.rest(self._person)
