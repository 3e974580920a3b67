"""Progress of a run on stderr: a live bar on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import TextIO

from rich.console import Console as RichConsole
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as RichProgress

SECONDS_BETWEEN_LINES = 10.0
"""How often a line is written where stderr is no terminal."""

NO_TIME = 1e-3
"""A step reported so soon after the one before was not worked on now [s]."""


class Progress:
    """Shows steps done, steps and evaluations a second, and the time left; used as a context.

    Args:
        task: what runs, such as ``track``.
        unit: what a step is, such as ``frames``; None where steps are only shares of the whole.
        quiet: show nothing.
        stream: where to show it; stderr by default.
    """

    def __init__(
        self, task: str, unit: str | None = "frames", *, quiet: bool = False, stream: TextIO | None = None
    ) -> None:
        self._task, self._unit, self._quiet = task, unit, quiet
        self._stream = sys.stderr if stream is None else stream
        self._bar: RichProgress | None = None
        self._first: tuple[float, int, int] | None = None
        self._spoke = self._last = time.monotonic()

    def __enter__(self) -> Progress:
        if not self._quiet and self._stream.isatty():
            columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[state]}"))
            self._bar = RichProgress(*columns, console=RichConsole(file=self._stream), transient=True)
            self._bar.add_task(self._task, total=None, state="")  # it pulses until the first report
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, done: int, total: int, evaluations: int = 0) -> None:
        """Report that ``done`` of ``total`` steps are finished, after ``evaluations`` evaluations in all.

        Rates count from the first report, and anew from a step that took no time: neither compiling kernels nor what
        an earlier run had done is in them.
        """
        now = time.monotonic()
        if self._first is None or now - self._last < NO_TIME:
            self._first = (now, done, evaluations)
        self._last = now
        state = self._state(self._first, (now, done, evaluations), total)
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=done, total=total, state=state)
        elif not self._quiet and (now - self._spoke >= SECONDS_BETWEEN_LINES or done == total):
            self._spoke = now
            print(f"{self._task}: {state}", file=self._stream, flush=True)

    def _state(self, first: tuple[float, int, int], last: tuple[float, int, int], total: int) -> str:
        seconds, steps, evaluations = (after - before for before, after in zip(first, last, strict=True))
        done = last[1]
        parts = [f"{100 * done // total} %" if self._unit is None else f"{done}/{total} {self._unit}"]
        if seconds > 0 and steps > 0:
            if self._unit is not None:
                parts.append(f"{steps / seconds:.3g} {self._unit}/s")
            if evaluations > 0:
                parts.append(f"{evaluations / seconds:,.0f} evaluations/s")
            if done < total:
                parts.append(f"{clock((total - done) * seconds / steps)} left")
        return ", ".join(parts)


def clock(seconds: float) -> str:
    """A duration as minutes and seconds, with hours where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}" if minutes >= 60 else f"{minutes}:{rest:02d}"
