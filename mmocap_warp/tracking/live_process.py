"""People who are tracked live together: one in this process, several in others, which work at a time."""

import gc
import multiprocessing
import queue
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from typing import Any

from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.masks.observation import Observation
from mmocap_warp.tracking.live import LiveTracker
from mmocap_warp.tracking.live_smoothing import LiveFrame, SmoothingProcess, start_beside

_MOST_TOGETHER = 3  # people that a process tracks by a GPU, on which their frames overlap

Answers = tuple[Sequence[LiveFrame], Sequence[Iterable[LiveFrame]]]
"""Of each person, the answer at once, and the smoothed ones that have come since the last time."""


class LiveHere:
    """One person's :class:`LiveTracker`, with what :class:`LiveProcess` has."""

    count = 1

    def __init__(self, *about: Any) -> None:
        self._tracker = LiveTracker(*about)
        self.close = self._tracker.close

    def wait(self) -> None:
        """There is nothing to wait for."""

    def step(self, number: int, seen: Sequence[Observation]) -> Future[Answers]:
        """What was found."""
        found: Future[Answers] = Future()
        found.set_result(([self._tracker.step(number, seen[0])], [self._tracker.smoothed()]))
        return found

    def rest(self) -> list[Iterable[LiveFrame]]:
        """The smoothed answers that are missing, once no frame will come."""
        return [self._tracker.rest()]


class LiveProcess:
    """A :class:`LiveTracker` of each of several people, in another process; it is to be closed.

    The trackers are made while other work is done: :meth:`wait` before the first frame. Arguments that cannot be, and
    wrong input, are raised there, and a RuntimeError wherever the process ends.

    Attributes:
        count: of the people.
    """

    def __init__(self, people: Sequence[tuple[Any, ...]]) -> None:
        self.count = len(people)
        context = multiprocessing.get_context("spawn")  # a fork would not survive CUDA
        self._line, other_end = context.Pipe()
        self._process = context.Process(target=_serve, args=(other_end,))
        self._process.start()
        other_end.close()
        # Threads, since Ctrl-C could interrupt a message. What is sent is answered in turn.
        self._sending, self._receiving = ThreadPoolExecutor(1), ThreadPoolExecutor(1)
        self._sending.submit(self._line.send, people)

    def wait(self) -> None:
        """Wait until the trackers are made."""
        self._receiving.submit(self._receive).result()

    def close(self) -> None:
        """End the process."""
        self._line.close()
        self._process.join()
        for each in (self._sending, self._receiving):
            each.shutdown()

    def step(self, number: int, seen: Sequence[Observation]) -> Future[Answers]:
        """What is going to be found of each person; see :meth:`LiveTracker.step`."""
        return self._ask((number, seen))

    def rest(self) -> list[Iterable[LiveFrame]]:
        """Of each person, the smoothed answers that are missing, once no frame will come."""
        return self._ask(None).result()  # type: ignore[no-any-return]

    def _ask(self, question: Any) -> Future[Any]:
        self._sending.submit(self._line.send, question)
        return self._receiving.submit(self._receive)

    def _receive(self) -> Any:
        try:
            answer = self._line.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            raise RuntimeError(f"a process that tracks ended with exit code {self._process.exitcode}") from None
        if isinstance(answer, Exception):
            raise answer
        return answer


def _serve(line: Any) -> None:
    """Track the people and then the frames that come on a line, up to a None, until its other end is gone."""
    start_beside()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError), ExitStack() as stack:
        try:
            smoother = stack.enter_context(closing(SmoothingProcess(people := line.recv())))
            trackers = [LiveTracker(*about, smoothed_by=(smoother, n)) for n, about in enumerate(people)]
            gc.collect()
            gc.freeze()  # looking through all that is there by now takes 80 ms, and finds nothing
            line.send(None)
            for number, seen in _read_ahead(line):
                for tracker, each in zip(trackers, seen, strict=True):
                    tracker.begin(number, each)
                frames = [tracker.finish() for tracker in trackers]
                line.send((frames, [list(tracker.smoothed()) for tracker in trackers]))
            line.send([list(tracker.rest()) for tracker in trackers])
        except (TypeError, ValueError) as error:
            line.send(error)


def _read_ahead(line: Any) -> Iterator[Any]:
    """What comes on a line, up to a None or its end; the next is read while one is worked on."""
    come: queue.Queue[Any] = queue.Queue(1)

    def read() -> None:
        with suppress(EOFError, ConnectionResetError):
            for each in iter(line.recv, None):
                come.put(each)
        come.put(None)

    threading.Thread(target=read, daemon=True).start()  # a process that fails does not wait for it
    return iter(come.get, None)


Trackers = Sequence[LiveHere | LiveProcess]


def make_live(device: str, people: Sequence[tuple[Any, ...]]) -> Iterator[LiveHere | LiveProcess]:
    """Trackers of all people, on a GPU of up to three each; a person is the first five arguments of a LiveTracker."""
    most = 1 if resolve_device(device) == "cpu" else _MOST_TOGETHER
    for first in range(0, len(people), most):
        yield LiveProcess(people[first : first + most]) if len(people) > 1 else LiveHere(*people[0])
