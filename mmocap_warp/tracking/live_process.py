"""A person who is tracked live by a process of their own, so that several are tracked at a time."""

import multiprocessing
import signal
from collections.abc import Iterator
from contextlib import closing, suppress
from threading import Lock
from typing import Any

from mmocap_warp.device.resolve import start_quietly
from mmocap_warp.masks.observation import Observation
from mmocap_warp.tracking.live import LiveFrame, LiveTracker


class LiveProcess:
    """A :class:`LiveTracker` in another process, and as that, it is to be closed; its arguments are the same.

    The tracker is made while other work is done: :meth:`wait` before the first frame. Arguments that cannot be, and
    wrong input, are raised here, and a RuntimeError if the process ends.
    """

    def __init__(self, *about: Any) -> None:
        context = multiprocessing.get_context("spawn")  # a fork would not survive CUDA
        self._line, other_end = context.Pipe()
        self._process = context.Process(target=_serve, args=(other_end, *about))
        self._process.start()
        other_end.close()
        self._smoothed: list[LiveFrame] = []
        self._turn = Lock()  # Ctrl-C asks for the rest while another thread waits for a step

    def wait(self) -> None:
        """Wait until the tracker is made."""
        self._receive()

    def close(self) -> None:
        """End the process."""
        self._line.close()
        self._process.join()

    def step(self, number: int, observation: Observation) -> LiveFrame:
        """See :meth:`LiveTracker.step`; other threads run while this one waits."""
        with self._turn:
            self._line.send((number, observation))
            frame, smoothed = self._receive()
            self._smoothed += smoothed
        return frame  # type: ignore[no-any-return]

    def smoothed(self) -> Iterator[LiveFrame]:
        """The frames whose smoothed answers had come by the last step."""
        smoothed, self._smoothed = self._smoothed, []
        return iter(smoothed)

    def rest(self) -> Iterator[LiveFrame]:
        """The smoothed answers that are missing, once no frame will come."""
        with self._turn:
            self._line.send(None)
            yield from self._smoothed + self._receive()

    def _receive(self) -> Any:
        try:
            answer = self._line.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            raise RuntimeError(f"a process that tracks ended with exit code {self._process.exitcode}") from None
        if isinstance(answer, Exception):
            raise answer
        return answer


def _serve(line: Any, *about: Any) -> None:
    """Track the frames that come on a line, up to a None, until its other end is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    start_quietly()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        try:
            with closing(LiveTracker(*about, alone=False)) as tracker:
                line.send(None)
                for number, observation in iter(line.recv, None):
                    frame = tracker.step(number, observation)
                    line.send((frame, list(tracker.smoothed())))
                line.send(list(tracker.rest()))
        except (TypeError, ValueError) as error:
            line.send(error)
