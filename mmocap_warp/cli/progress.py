"""Progress on stderr, of a run and of many jobs: live on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Self, TextIO

from rich.console import Console as RichConsole
from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as RichProgress
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from mmocap_warp.commands.caller import Reporter

if TYPE_CHECKING:
    from mmocap_warp.jobs.job_run import Status

SECONDS_BETWEEN_LINES = 10.0  # how often a line is written where stderr is no terminal

NO_TIME = 1e-3  # a step reported so soon after the one before was not worked on now [s]


class _Display(ABC):
    """What is shown, on stderr, of something that runs, such as ``track``, while a context is open."""

    _live: RichProgress | Live | None = None

    def __init__(self, name: str, *, quiet: bool = False, stream: TextIO | None = None) -> None:
        self._name, self._quiet = name, quiet
        self._stream = sys.stderr if stream is None else stream
        self._printed_at = time.monotonic()

    @abstractmethod
    def _on_terminal(self, console: RichConsole) -> RichProgress | Live:
        """What is shown on a terminal."""

    def __enter__(self) -> Self:
        if not self._quiet and self._stream.isatty():
            self._live = self._on_terminal(RichConsole(file=self._stream))
            self._live.start()
        return self

    def __exit__(self, *raised: object) -> None:
        if self._live is not None:
            self._live.stop()

    def _print(self, state: str, is_last: bool) -> None:
        """Write a line, if it is the last one or it is time for one."""
        if not self._quiet and (is_last or time.monotonic() - self._printed_at >= SECONDS_BETWEEN_LINES):
            self._printed_at = time.monotonic()
            print(f"{self._name}: {state}", file=self._stream, flush=True)


class Progress(_Display):
    """Shows steps done, steps and evaluations a second, and the time left; used as a context.

    Its ``unit`` says what a step is, such as ``frames``; it is None where steps are only shares of the whole.
    """

    _live: RichProgress | None = None

    def __init__(
        self, task: str, unit: str | None = "frames", *, quiet: bool = False, stream: TextIO | None = None
    ) -> None:
        super().__init__(task, quiet=quiet, stream=stream)
        self._unit = unit
        self._first: tuple[float, int, int] | None = None
        self._last = self._printed_at

    def _on_terminal(self, console: RichConsole) -> RichProgress:
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[state]}"))
        bar = RichProgress(*columns, console=console, transient=True)
        bar.add_task(self._name, total=None, state="")  # it pulses until the first report
        return bar

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
        if self._live is not None:
            self._live.update(self._live.task_ids[0], completed=done, total=total, state=state)
        else:
            self._print(state, is_last=done == total)

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


class JobsProgress(_Display, Reporter):
    """Shows what every worker of many jobs does, jobs done, the rate and the time left; used as a context."""

    _live: Live | None = None
    _shown_done = -1  # jobs, when they were shown before

    def _on_terminal(self, console: RichConsole) -> Live:
        return Live(console=console, transient=True, refresh_per_second=2, redirect_stdout=False)

    def note(self, line: str) -> None:
        """Write a line that stays, unless all is to be quiet."""
        if not self._quiet:
            self.warn(line)

    def warn(self, line: str) -> None:
        """Write a line that stays."""
        if self._live is not None:
            self._live.console.print(Text(line))
        else:
            print(line, file=self._stream, flush=True)

    def show(self, status: Status) -> None:
        """Show where the run stands."""
        if self._live is not None:
            self._live.update(Group(_seats(status), Text(f"{self._name}: {headline(status)}")))
            return
        done, before = status.reused + status.finished, self._shown_done
        self._shown_done = done
        self._print(headline(status), is_last=done == status.jobs != before)


def headline(status: Status) -> str:
    """Jobs done, rate and time left in one line."""
    parts = [f"{status.reused + status.finished}/{status.jobs} {status.noun}s"]
    if status.failures:
        parts.append(f"{len(status.failures)} failed")
    if status.unstored:
        parts.append(f"{status.unstored} waiting for room on the disk")
    if not status.seats and status.evaluations_left:
        parts.append("no worker is left" if status.evaluations else "no worker has started yet")
    if status.rate > 0:
        parts.append(f"{status.rate:,.0f} evaluations/s")
        if status.evaluations_left and status.seats:
            parts.append(f"{clock(status.evaluations_left / status.rate)} left")
    return ", ".join(parts)


def _seats(status: Status) -> Table:
    """What every worker does."""
    table = Table(box=None, padding=(0, 1), show_header=False)
    for seat in status.seats:
        advance = seat.advance
        if seat.task is None:
            table.add_row(seat.name, "waits", "", "")
        elif advance is None:
            table.add_row(seat.name, str(seat.task.name), "starts", "")
        else:
            bar = ProgressBar(total=advance.total, completed=advance.done, width=20)
            table.add_row(seat.name, str(seat.task.name), bar, f"{advance.stage} {advance.done}/{advance.total}")
    return table
