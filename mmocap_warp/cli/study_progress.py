"""A study's progress on stderr: a live table on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

from rich.console import Console as RichConsole
from rich.console import Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from mmocap_warp.cli.progress import SECONDS_BETWEEN_LINES, clock
from mmocap_warp.commands.reporter import Reporter

if TYPE_CHECKING:
    from mmocap_warp.study.run import Status


class StudyProgress(Reporter):
    """Shows what every worker does, cells done, the rate and the time left; used as a context.

    Args:
        name: the study's.
        quiet: show nothing but notes.
        stream: where to show it; stderr by default.
    """

    def __init__(self, name: str, *, quiet: bool = False, stream: TextIO | None = None) -> None:
        self._name, self._quiet = name, quiet
        self._stream = sys.stderr if stream is None else stream
        self._live: Live | None = None
        self._printed_at = time.monotonic()
        self._printed_done = -1

    def __enter__(self) -> StudyProgress:
        if not self._quiet and self._stream.isatty():
            console = RichConsole(file=self._stream)
            self._live = Live(console=console, transient=True, refresh_per_second=2, redirect_stdout=False)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def note(self, line: str) -> None:
        """Write a line that stays."""
        if self._live is not None:
            self._live.console.print(Text(line))
        else:
            print(line, file=self._stream, flush=True)

    warn = note

    def show(self, status: Status) -> None:
        """Show where the study stands."""
        if self._live is not None:
            self._live.update(Group(_seats(status), Text(f"{self._name}: {headline(status)}")))
            return
        now, done = time.monotonic(), status.reused + status.finished
        last = done == status.cells and self._printed_done != done
        if not self._quiet and (last or now - self._printed_at >= SECONDS_BETWEEN_LINES):
            self._printed_at, self._printed_done = now, done
            print(f"{self._name}: {headline(status)}", file=self._stream, flush=True)


def headline(status: Status) -> str:
    """Cells done, rate and time left in one line."""
    parts = [f"{status.reused + status.finished}/{status.cells} cells"]
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
        if seat.cell is None:
            table.add_row(seat.name, "waits", "", "")
        elif advance is None:
            table.add_row(seat.name, str(seat.cell), "starts", "")
        else:
            bar = ProgressBar(total=advance.total, completed=advance.done, width=20)
            table.add_row(seat.name, str(seat.cell), bar, f"{advance.stage} {advance.done}/{advance.total}")
    return table
