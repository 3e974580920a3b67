"""Timing work on a device, and the check of its answer; what comes out is ready for JSON.

Things to be compared take turns, so that a busy machine slows all of them alike.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Self

import numpy as np
import warp as wp

Work = Callable[[], object]
"""What is timed: launches on one device, the same at every call."""

SECONDS = {"cpu": 0.25, "cuda": 0.2}
"""How long each work is sampled for, if that gives enough rounds and not too many: a GPU's times vary less."""

_FEWEST_ROUNDS, _MOST_ROUNDS = 5, 40
_SAMPLE_SECONDS = {"cpu": 2e-2, "cuda": 2e-3}  # a shorter work is repeated within a sample
_MOST_CALLS = 200  # of a short work within a sample; each call is a piece of a captured graph


@dataclass(frozen=True)
class Timing:
    """How long a work takes."""

    samples: tuple[float, ...]  # seconds a call, one for each round. On a GPU a round replays a captured graph
    processor: float  # seconds of the processor a call (the median); all threads together
    first: float  # seconds of the first call, compiling included where nothing had compiled the kernels before
    launched: float | None  # seconds a call where the host launches every kernel; None on the CPU

    @cached_property
    def median(self) -> float:
        """Median [s]."""
        return float(np.median(self.samples))

    @property
    def quartiles(self) -> tuple[float, float]:
        """First and third quartile [s]."""
        low, high = np.quantile(self.samples, (0.25, 0.75))
        return float(low), float(high)

    @property
    def lowest(self) -> float:
        """The quickest sample [s]."""
        return min(self.samples)

    @property
    def compiling(self) -> float:
        """What the first call took over a later one [s]: compiling, or loading what had been compiled before."""
        return max(0.0, self.first - (self.median if self.launched is None else self.launched))


def time_together(
    works: Sequence[Work], device: str, *, captured: bool = True, seconds: float | None = None
) -> list[Timing]:
    """Time works in turns.

    Args:
        works: what to time; each is called twice beforehand.
        device: the Warp device that they launch on.
        captured: on a GPU, replay graphs of the works; False where a work waits for the device itself.
        seconds: to spend on each work, about; ``SECONDS`` where omitted.
    """
    kind = "cuda" if wp.get_device(device).is_cuda else "cpu"
    budget = len(works) * (SECONDS[kind] if seconds is None else seconds)
    first = [_elapsed(work, device)[0] for work in works]
    warm = [_elapsed(work, device)[0] for work in works]
    calls = [max(1, min(_MOST_CALLS, round(_SAMPLE_SECONDS[kind] / one))) for one in warm]
    repeated: list[Work] = [partial(_repeat, work, n) for work, n in zip(works, calls, strict=True)]
    launched: list[float | None] = [None] * len(works)
    if kind == "cuda" and captured:
        sampled = _rounds(repeated, device, budget / 4)
        launched = [float(np.median(taken[:, 0])) / n for taken, n in zip(sampled, calls, strict=True)]
        repeated = [_graph(work, device) for work in repeated]
    sampled = _rounds(repeated, device, budget)
    return [
        Timing(tuple((taken[:, 0] / n).tolist()), float(np.median(taken[:, 1])) / n, once, host)
        for taken, n, once, host in zip(sampled, calls, first, launched, strict=True)
    ]


def _rounds(works: Sequence[Work], device: str, budget: float) -> list[np.ndarray]:
    """For each work (round, 2): seconds, and seconds of the processor. Rounds go on until ``budget`` is spent."""
    started = time.perf_counter()
    taken: list[list[tuple[float, float]]] = []
    while len(taken) < _FEWEST_ROUNDS or (len(taken) < _MOST_ROUNDS and time.perf_counter() - started < budget):
        taken.append([_elapsed(work, device) for work in works])
    return list(np.array(taken).swapaxes(0, 1))


def _elapsed(work: Work, device: str) -> tuple[float, float]:
    wp.synchronize_device(device)
    started, processor = time.perf_counter(), time.process_time()
    work()
    wp.synchronize_device(device)
    return time.perf_counter() - started, time.process_time() - processor


def _repeat(work: Work, times: int) -> None:
    for _ in range(times):
        work()


def _graph(work: Work, device: str) -> Work:
    with wp.ScopedCapture(device) as capture:
        work()
    wp.capture_launch(capture.graph)  # the first launch uploads it
    return partial(wp.capture_launch, capture.graph)


@dataclass(frozen=True)
class Check:
    """Whether an answer is right."""

    what: str  # what was compared, and how far apart it is
    ok: bool  # whether that is near enough


@dataclass(frozen=True)
class Case:
    """A work to time."""

    group: str  # the table that it stands in
    name: str  # its line
    sizes: dict[str, Any]  # what the time depends on, such as ``candidates`` or ``renderer``
    work: Work  # it
    check: Callable[[], Check]  # looks at what the work left behind
    evaluations: int = 0  # of the objective in a call; 0 where it evaluates none
    captured: bool = True  # whether a graph of it can be captured


@dataclass(frozen=True)
class Measurement:
    """How long a call of a case takes [s]; see :class:`Timing`."""

    group: str
    name: str
    sizes: dict[str, Any]
    evaluations: int
    median: float
    quartiles: tuple[float, float]
    lowest: float
    processor: float
    launched: float | None
    compiling: float
    rounds: int
    check: str
    ok: bool

    @classmethod
    def of(cls, case: Case, timing: Timing) -> Self:
        """Check the answer of a case that was timed."""
        check = case.check()
        facts = {name: getattr(case, name) for name in ("group", "name", "sizes", "evaluations")}
        times = ("median", "quartiles", "lowest", "processor", "launched", "compiling")
        facts |= {name: getattr(timing, name) for name in times}
        return cls(rounds=len(timing.samples), check=check.what, ok=bool(check.ok), **facts)  # NumPy's bool is no JSON


def measure(cases: Sequence[Case], device: str, seconds: float | None = None) -> list[Measurement]:
    """Time cases in turns, then check their answers."""
    captured = all(case.captured for case in cases)
    timings = time_together([case.work for case in cases], device, captured=captured, seconds=seconds)
    return [Measurement.of(case, timing) for case, timing in zip(cases, timings, strict=True)]
