"""What is timed, its sizes and the check of its answer; and what comes out, ready for JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from mmocap_warp.kernels.benchmarks.timing import Timing, Work, time_together


@dataclass(frozen=True)
class Check:
    """Whether an answer is right.

    Attributes:
        what: what was compared, and how far apart it is.
        ok: whether that is near enough.
    """

    what: str
    ok: bool


@dataclass(frozen=True)
class Case:
    """A work to time.

    Attributes:
        group: the table that it stands in.
        name: its line.
        sizes: what the time depends on, such as ``candidates`` or ``renderer``.
        work: it.
        check: looks at what the work left behind.
        evaluations: of the objective in a call; 0 where it evaluates none.
        captured: whether a graph of it can be captured.
    """

    group: str
    name: str
    sizes: dict[str, Any]
    work: Work
    check: Callable[[], Check]
    evaluations: int = 0
    captured: bool = True


@dataclass(frozen=True)
class Measurement:
    """How long a call of a case takes [s]; see :class:`~mmocap_warp.kernels.benchmarks.timing.Timing`."""

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
    def of(cls, case: Case, timing: Timing) -> Measurement:
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
