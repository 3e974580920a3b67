"""This machine's devices, a process each."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from mmocap_warp.device.resolve import resolve_device, start_quietly
from mmocap_warp.study.engines.engine import Death, EngineLost, Event, Ready
from mmocap_warp.study.job import LESS_MEMORY, Job, Worker, device_kind

_STARTS = 3  # tries to start a worker; when each dies before it is ready, its device is given up
_GRACE = 5.0  # time that a worker has to end [s]


def local_devices(wanted: str) -> list[str]:
    """Devices of this machine by their aliases: ``auto`` (all CUDA devices, or the CPU), or a list with commas.

    A device that is listed twice gets two processes.

    Raises:
        ValueError: no such device here, or a mixture of CPU and GPUs, whose results differ in the last bits.
    """
    import warp as wp

    if wanted == "auto":
        return [device.alias for device in wp.get_cuda_devices()] or ["cpu"]
    devices = [resolve_device(name.strip()) for name in wanted.split(",")]
    if len({device_kind(device) for device in devices}) > 1:
        raise ValueError(f"device must be cpu or CUDA devices, not both, got {wanted!r}")
    return devices


def _context() -> Any:
    """How processes are started: never by a fork of this one, whose CUDA context would not survive it.

    On Linux they are forks of a process that has imported what they need and has started nothing.
    """
    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["mmocap_warp.study.job"])
    return context


@dataclass
class _Seat:
    """A device and the process that works on it now."""

    device: str
    process: BaseProcess
    connection: Any  # a Connection, or a PipeConnection on Windows
    failed_starts: int = 0
    ready: bool = False


class LocalEngine:
    """One process per device.

    Args:
        devices: Warp devices, such as ``cuda:0`` and ``cuda:1``, or ``cpu``; see :func:`local_devices`.
        threads: CPU threads of each; None for all that this process may use.
        serve: what a process does with its end of the connection, the device and the threads.
    """

    def __init__(
        self, devices: Sequence[str], threads: int | None = None, serve: Callable[..., Any] | None = None
    ) -> None:
        self._context = _context()
        self._threads, self._serve = threads, serve or serve_jobs
        self._seats: dict[int, _Seat] = {}
        for worker, device in enumerate(devices):
            self._seats[worker] = self._start(device)

    def submit(self, worker: int, job: Job) -> None:
        """See :class:`~mmocap_warp.study.engines.engine.Engine`."""
        try:
            self._seats[worker].connection.send(job)
        except OSError:  # it died while it waited, which events() tells
            return

    def events(self, seconds: float) -> list[tuple[int, Event]]:
        """See :class:`~mmocap_warp.study.engines.engine.Engine`."""
        if not self._seats:
            raise EngineLost("every worker died while starting")
        by_connection = {seat.connection: worker for worker, seat in self._seats.items()}
        happened: list[tuple[int, Event]] = []
        for connection in wait(list(by_connection), seconds):
            worker = by_connection[connection]  # type: ignore[index]
            try:
                event = self._seats[worker].connection.recv()
            except (EOFError, OSError):
                event = _how_it_ended(self._seats[worker].process)
            if isinstance(event, Ready):
                self._seats[worker].ready = True
            if isinstance(event, Death):
                self._replace(worker)
            happened.append((worker, event))
        return happened

    def close(self) -> None:
        """See :class:`~mmocap_warp.study.engines.engine.Engine`."""
        for seat in self._seats.values():
            seat.process.terminate()
        for seat in self._seats.values():
            _end(seat)
        self._seats = {}

    def _start(self, device: str) -> _Seat:
        mine, its = self._context.Pipe()
        process = self._context.Process(target=self._serve, args=(its, device, self._threads), daemon=True)
        process.start()
        its.close()  # so that its end closes when it dies
        return _Seat(device, process, mine)

    def _replace(self, worker: int) -> None:
        """Start another process in the place of one that died."""
        seat = self._seats.pop(worker)
        _end(seat)
        failed_starts = 0 if seat.ready else seat.failed_starts + 1
        if failed_starts < _STARTS:
            self._seats[worker] = self._start(seat.device)
            self._seats[worker].failed_starts = failed_starts


def serve_jobs(connection: Connection, device: str, threads: int | None) -> None:
    """A worker process: it does jobs until its parent is gone. An error that is no refusal is reported and ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    threading.Thread(target=_end_with_parent, daemon=True).start()
    start_quietly()
    worker = Worker(device, threads)
    connection.send(Ready(device))
    with suppress(EOFError, OSError):  # the parent is gone
        while True:
            for event in _events_of(worker, connection.recv()):
                connection.send(event)


def _events_of(worker: Worker, job: Job) -> Iterator[Event]:
    """What happens in a job. An error that is no refusal counts as a death: the device may be in any state then."""
    try:
        yield from worker.work(job)
    except Exception as error:
        yield Death(" ".join(f"{type(error).__name__}: {error}".split()))


def _end_with_parent() -> None:
    """End this process as soon as its parent ends, however that happens."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _end(seat: _Seat) -> None:
    seat.connection.close()
    seat.process.join(_GRACE)
    if seat.process.is_alive():
        seat.process.kill()
        seat.process.join()


def _how_it_ended(process: BaseProcess) -> Death:
    process.join(_GRACE)
    code = process.exitcode
    if code is None or code >= 0:
        return Death(f"ended with exit code {code}")
    name = signal.Signals(-code).name
    often = f"a system that is short of memory kills so: {LESS_MEMORY}" if name == "SIGKILL" else ""
    return Death(f"killed by {name}", often)
