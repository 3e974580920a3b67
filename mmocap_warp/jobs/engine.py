"""An engine: workers that are given jobs, and the events that they report."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

LESS_MEMORY = "give it fewer runs or frames, or let fewer workers run at a time on this machine"
"""What a user can do about a worker that ran out of memory."""

_STARTS = 3  # tries to start a worker; when each dies before it is ready, its place is given up


@dataclass(frozen=True)
class Ready:
    """A worker has started and waits for its first job."""

    name: str  # its device, and its machine where there are several


@dataclass(frozen=True)
class Advance:
    """How far a worker is with its job."""

    stage: str  # what it does now, such as ``masks`` or ``search``
    done: int  # frames that are done
    total: int  # frames of the clip
    evaluations: int  # that were spent so far, of all runs together


@dataclass(frozen=True)
class Refusal:
    """The job cannot be done, here or elsewhere, until the user mends something."""

    problem: str


@dataclass(frozen=True)
class Death:
    """A worker is gone, and with it what it was doing. Another one may become ready in its place."""

    reason: str  # why it is gone
    remedy: str = ""  # what the user can do if it happens again, where that is known


@dataclass(frozen=True)
class Notice:
    """Something that a person should read, of all workers rather than of one."""

    text: str


Event = Any  # one of these, or a job's result. After a result or a refusal the worker waits for its next job


class EngineLost(Exception):
    """No worker is left, nor will one come; says why."""


class Worker(Protocol):
    """Does one job after the other on one device."""

    device: str

    def work(self, job: Any) -> Iterator[Event]:
        """Do a job: yields now and then how far it is, and last the result, or why there is none."""
        ...


MakeWorker = Callable[[str, int | None], Worker]
"""A class, of a Warp device and CPU threads; None for all that the process may use."""


@dataclass
class Seat:
    """A worker's place."""

    place: Any  # where another worker is started if this one dies
    worker: Any  # its process or its actor
    line: Any  # what is heard of it: a connection, or what it was asked last, None if that is answered
    failed_starts: int = 0
    ready: bool = False


class Engine(ABC):
    """Workers, numbered from 0. One that dies is replaced, unless too many have died there before they were ready."""

    def __init__(self, places: Sequence[Any]) -> None:
        self._seats = {worker: self._start(place) for worker, place in enumerate(places)}

    @abstractmethod
    def submit(self, worker: int, job: Any) -> None:
        """Give a worker that waits its next job."""

    @abstractmethod
    def events(self, seconds: float) -> list[tuple[int, Event]]:
        """What has happened to which worker; waits up to so long for something. An EngineLost if no worker is left."""

    def close(self) -> None:
        """End all workers, whatever they are doing."""
        for seat in self._seats.values():
            self._end(seat)
        self._seats = {}

    @abstractmethod
    def _start(self, place: Any) -> Seat:
        """Start a worker."""

    @abstractmethod
    def _end(self, seat: Seat) -> None:
        """See that a worker is gone, and let go of it."""

    def _replace(self, worker: int) -> None:
        """Start another worker in the place of one that died."""
        seat = self._seats.pop(worker)
        self._end(seat)
        failed_starts = 0 if seat.ready else seat.failed_starts + 1
        if failed_starts < _STARTS:
            self._seats[worker] = self._start(seat.place)
            self._seats[worker].failed_starts = failed_starts


def one_line(error: BaseException) -> str:
    """What an error is and says."""
    return " ".join(f"{type(error).__name__}: {error}".split())
