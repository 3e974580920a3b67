"""A track that is smoothed while it grows: a long one in another process, a short one in a thread."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from threading import Semaphore, Thread
from typing import Any

from mmocap_warp.device.cores import available_threads
from mmocap_warp.device.resolve import resolve_device, start_quietly
from mmocap_warp.masks.observation import KeptObservations, Observation
from mmocap_warp.result.result import FrameAnswer, Result
from mmocap_warp.tracking.loose_clothes import with_hidden
from mmocap_warp.tracking.smoothing import SmoothReport, smoothed
from mmocap_warp.tracking.track_config import TrackConfig

_LEAST_FRAMES = 240  # fewer are tracked before another process has begun


@contextmanager
def smoothing_beside(
    frames: int, config: TrackConfig, kept: KeptObservations, report: SmoothReport | None
) -> Iterator[SmoothingBeside | SmoothingElsewhere | None]:
    """What smooths a track of so many frames while it grows, whose masks are ``kept``; None where that does not pay."""
    beside: SmoothingBeside | SmoothingElsewhere | None = None
    if frames and config.acceleration and (config.threads or available_threads()) > 1:
        if frames >= _LEAST_FRAMES and multiprocessing.parent_process() is None:  # a worker has others beside it
            with suppress(OSError):  # it is smoothed later where no process can be started
                beside = SmoothingElsewhere(kept, report)
        elif resolve_device(config.device) == "cpu":
            beside = SmoothingBeside(kept, report)
    with closing(beside) if beside else nullcontext():
        yield beside


class SmoothingBeside:
    """Smooths a track in a thread while it grows, with the bits of one that is complete; to be closed.

    ``kept`` has the masks of all frames that were added.
    """

    def __init__(self, kept: KeptObservations, report: SmoothReport | None) -> None:
        self._kept, self._report, self._complete, self._closed = kept, report, False, False
        self._added, self._pool = Semaphore(0), ThreadPoolExecutor(1)

    def begin(self, room: Result, config: TrackConfig) -> None:
        """Begin with a result of as many frames as the track will have, which is filled."""
        self._room = room
        subject, rig = room.subject, room.cameras
        seen = with_hidden(self._masks(), subject, rig, room.rate, lambda place: room.pose[:, place - 1])

        def progress(done: int) -> None:
            if self._report and self._complete:
                self._report(done)

        self._smoothed = self._pool.submit(smoothed, room, config, seen, progress)

    def add(self, frame: int, answer: FrameAnswer) -> None:
        """A frame, by its position, was tracked. An error of the thread, which needs this frame, is raised here."""
        if self._smoothed.done():
            with suppress(InterruptedError):  # no masks are kept any more: it is smoothed later
                self._smoothed.result()
        for name in ("pose", "cost", "iou", "status"):
            getattr(self._room, name)[:, frame] = getattr(answer, name)
        self._added.release()

    def of(self, tracked: Result) -> Result:
        """The whole track, whose frames were all added, smoothed."""
        self._complete = True
        return _as_of(tracked, self._smoothed.result())

    def close(self) -> None:
        """Let the thread end, before it reads another frame's masks."""
        self._closed = True
        self._added.release(2)  # the most that it may wait for
        self._pool.shutdown()

    def _masks(self) -> Iterator[Observation]:
        """The masks of each frame, once the frame after it is tracked too: late views ask where the body goes."""
        known, count, kept = 0, len(self._room.frame_numbers), iter(self._kept)
        for frame in range(count):
            while known < min(frame + 2, count):
                self._added.acquire()
                known += 1
            seen = next(kept, None)
            if self._closed or seen is None:
                raise InterruptedError
            yield seen


class SmoothingElsewhere:
    """What :class:`SmoothingBeside` does, but in another process, which may fail without harm; to be closed.

    Processes of multiprocessing would run a caller's script again.
    """

    def __init__(self, kept: KeptObservations, report: SmoothReport | None) -> None:
        program = f"import sys; sys.path[:] = sys.argv[1:]; from {__name__} import serve; serve()"
        pipe, nowhere, command = subprocess.PIPE, subprocess.DEVNULL, [sys.executable, "-c", program, *sys.path]
        self._process: Any = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=nowhere)
        self._kept, self._report, self._sending = iter(kept), report, ThreadPoolExecutor(1)

    def begin(self, room: Result, config: TrackConfig) -> None:
        """Begin with a result of as many frames as the track will have."""
        self._sending.submit(self._send, lambda: (room, config))

    def add(self, _: int, answer: FrameAnswer) -> None:
        """The next frame was tracked."""
        self._sending.submit(self._send, lambda: (next(self._kept), answer))

    def of(self, tracked: Result) -> Result | None:
        """The whole track, whose frames were all added, smoothed; None where the process failed."""
        self._sending.submit(self._send, lambda: None)
        with suppress(EOFError, pickle.UnpicklingError):
            while isinstance(come := pickle.load(self._process.stdout), int):
                if self._report:
                    self._report(come)
            return _as_of(tracked, come)
        return None

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._sending.shutdown(cancel_futures=True)
        self._process.communicate()

    def _send(self, what: Callable[[], Any]) -> None:
        with ExitStack() as failing:
            failing.callback(self._process.kill)  # else it waits for what is missing, and the track for it
            pickle.dump(what(), self._process.stdin)
            self._process.stdin.flush()
            failing.pop_all()


def serve() -> None:
    """Smooth the track that comes on stdin, and tell its progress and the smoothed one on stdout."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    come, out = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what else is printed does not go there
    start_quietly()

    def tell(what: int | Result) -> None:
        pickle.dump(what, out)
        out.flush()

    room, config = pickle.load(come)
    with KeptObservations() as kept, closing(SmoothingBeside(kept, tell)) as beside:
        beside.begin(room, config)
        for frame, (observation, answer) in enumerate(iter(partial(pickle.load, come), None)):
            kept.add(observation)
            beside.add(frame, answer)
        Thread(target=lambda: (come.read(), os._exit(1)), daemon=True).start()  # once the parent is gone
        tell(beside.of(room))


def _as_of(tracked: Result, done: Result) -> Result:
    """A smoothed track, with what the process or thread that smoothed it did not know."""
    seconds = tracked.seconds + done.seconds
    return replace(done, evaluations=tracked.evaluations, config=tracked.config, seconds=seconds)
