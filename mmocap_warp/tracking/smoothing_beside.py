"""A clip is smoothed by a thread while it is still tracked: each keeps cores busy that the other one leaves idle."""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from queue import SimpleQueue
from threading import Condition
from time import perf_counter
from typing import Self

from mmocap_warp.masks.observation import KeptObservations, Observation
from mmocap_warp.result.result import FrameAnswer, Result
from mmocap_warp.tracking.body_masks import body_silhouettes
from mmocap_warp.tracking.holes import with_holes
from mmocap_warp.tracking.smoothing import ClipSmoother, SmoothReport
from mmocap_warp.tracking.track_config import TrackConfig

_SMOOTHED = ("pose", "cost", "iou", "status", "raw_pose", "angle_sigma", "joint_sigma")


class SmoothingBeside:
    """Smooths a track that grows, with the bits of one that is complete; to be used in a ``with``.

    ``room`` is a result of as many frames, which this fills, and ``kept`` has the masks of all frames that were added.
    """

    def __init__(self, room: Result, config: TrackConfig, kept: KeptObservations) -> None:
        self._room, self._kept = room, kept
        self._count, self._stopped, self._changed = 0, False, Condition()
        self._final: SimpleQueue[int | None] = SimpleQueue()
        silhouettes_of = body_silhouettes(room.subject, room.cameras)
        seen = with_holes(self._masks(), room.rate, lambda place: silhouettes_of(room.pose[:, place - 1]))
        self._smoother = ClipSmoother(room, config, seen)
        self._thread = ThreadPoolExecutor(1)

    def __enter__(self) -> Self:
        self._smoothed: Future[Result] = self._thread.submit(self._run)
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._thread.shutdown()

    def add(self, answer: FrameAnswer) -> None:
        """The next frame was tracked."""
        room, frame = self._room, self._count
        room.pose[:, frame], room.cost[:, frame], room.iou[:, frame] = answer.pose, answer.cost, answer.iou
        room.status[:, frame] = answer.status
        with self._changed:
            self._count += 1
            self._changed.notify()

    def of(self, tracked: Result, progress: SmoothReport | None) -> Result:
        """The whole track, whose frames were all added, smoothed."""
        started = perf_counter()
        for done in iter(self._final.get, None):
            if progress:
                progress(done)
        smoothed = {name: getattr(self._smoothed.result(), name) for name in _SMOOTHED}
        return replace(tracked, seconds=tracked.seconds + perf_counter() - started, **smoothed)

    def _run(self) -> Result:
        try:
            return self._smoother.run(self._report)
        finally:
            self._final.put(None)

    def _report(self, done: int) -> None:
        if self._stopped:
            raise InterruptedError
        self._final.put(done)

    def _masks(self) -> Iterator[Observation]:
        """The masks of each frame, once the frame after it is tracked too: late views ask where the body goes."""
        frames, total = iter(self._kept), len(self._room.frame_numbers)
        for known in (*range(2, total + 1), total):
            with self._changed:
                self._changed.wait_for(partial(self._reaches, known))
            if self._stopped:
                raise InterruptedError
            yield next(frames)

    def _reaches(self, count: int) -> bool:
        """Whether so many frames are tracked, or no more will be."""
        return self._stopped or self._count >= count
