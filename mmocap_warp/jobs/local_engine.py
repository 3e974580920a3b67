"""This machine's devices, a process each."""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from mmocap_warp.device.cores import work_beside_others
from mmocap_warp.device.resolve import device_kind, resolve_device, start_quietly
from mmocap_warp.jobs.engine import LESS_MEMORY, Death, Engine, EngineLost, MakeWorker, Ready, Seat, one_line

_GRACE = 5.0  # time that a worker has to end [s]
_WAITS = 0.0, 0.1, 1.0, 5.0  # before each attempt to start a worker [s]


def local_devices(wanted: str) -> list[str]:
    """Devices of this machine by their aliases: ``auto`` (all CUDA devices, or the CPU), or a list with commas.

    A device that is listed twice gets two processes. Raises a ValueError for no such device here, or CPU and GPUs at
    once, whose results differ in the last bits.
    """
    import warp as wp

    if wanted == "auto":
        return [device.alias for device in wp.get_cuda_devices()] or ["cpu"]
    devices = [resolve_device(name.strip()) for name in wanted.split(",")]
    if len({device_kind(device) for device in devices}) > 1:
        raise ValueError(f"device must be cpu or CUDA devices, not both, got {wanted!r}")
    return devices


def forks_of(module: str) -> Any:
    """How processes are started that need a module.

    They are never forks of this one, whose CUDA context would not survive it. On Linux they are forks of a process that
    has imported the module and has started nothing.
    """
    context: Any = multiprocessing.get_context("forkserver" if sys.platform == "linux" else "spawn")
    if sys.platform == "linux":
        context.set_forkserver_preload([module])
    return context


class LocalEngine(Engine):
    """One process per device, see :func:`local_devices`, with so many CPU threads; None for all that may be used.

    ``make`` makes the worker of a process, unless it is to ``serve`` in another way.
    """

    def __init__(
        self, make: MakeWorker, devices: Sequence[str], threads: int | None, serve: Callable[..., Any] | None = None
    ) -> None:
        self._context = forks_of(make.__module__)
        self._threads, self._serve = threads, serve or partial(serve_jobs, make)
        super().__init__(devices)

    def submit(self, worker: int, job: Any) -> None:
        """See :class:`~mmocap_warp.jobs.engine.Engine`."""
        with suppress(OSError):  # it died while it waited, which events() reports
            self._seats[worker].line.send(job)

    def events(self, seconds: float) -> list[tuple[int, Any]]:
        """See :class:`~mmocap_warp.jobs.engine.Engine`."""
        if not self._seats:
            raise EngineLost("every worker died while starting")
        by_connection = {seat.line: worker for worker, seat in self._seats.items()}
        happened: list[tuple[int, Any]] = []
        for connection in wait(list(by_connection), seconds):
            worker = by_connection[connection]
            seat = self._seats[worker]
            try:
                event = seat.line.recv()
            except (EOFError, OSError):
                event = _how_it_ended(seat.worker)
            seat.ready = seat.ready or isinstance(event, Ready)
            if isinstance(event, Death):
                with suppress(EngineLost):  # the others' results count; without any worker the next call raises it
                    self._replace(worker)
            happened.append((worker, event))
        return happened

    def close(self) -> None:
        """See :class:`~mmocap_warp.jobs.engine.Engine`."""
        for seat in self._seats.values():
            seat.worker.terminate()
        super().close()

    def _start(self, place: str) -> Seat:
        mine, its = self._context.Pipe()
        # What forks may be about to die of a kill; then another one takes its place.
        for seconds in _WAITS:
            time.sleep(seconds)
            process = self._context.Process(target=self._serve, args=(its, place, self._threads), daemon=True)
            with suppress(EOFError, OSError), _ctrl_c_waits():
                process.start()
                break
        else:
            raise EngineLost("no process can be started here")
        its.close()  # so that its end closes when it dies
        return Seat(place, process, mine)

    def _end(self, seat: Seat) -> None:
        seat.line.close()
        seat.worker.join(_GRACE)
        if seat.worker.is_alive():
            seat.worker.kill()
            seat.worker.join()


@contextmanager
def _ctrl_c_waits() -> Iterator[None]:
    """Ctrl-C waits here, and for good in processes that are started: it would end their imports with a traceback."""
    if sys.platform == "win32":
        yield
        return
    resource_tracker.ensure_running()  # before Python 3.12 its start ends with signals that come through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve_jobs(make: MakeWorker, connection: Connection, device: str, threads: int | None) -> None:
    """A worker process: it does jobs until its parent is gone.

    An error that is no refusal is reported as a death, which ends it: the device may be in any state then.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    threading.Thread(target=_end_with_parent, daemon=True).start()
    start_quietly()
    work_beside_others(threads)
    worker = make(device, threads)
    connection.send(Ready(device))
    with suppress(EOFError, OSError):  # the parent is gone
        while True:
            for event in _events_of(worker, connection.recv()):
                connection.send(event)


def _events_of(worker: Any, job: Any) -> Iterator[Any]:
    try:
        yield from worker.work(job)
    except Exception as error:
        yield Death(one_line(error))


def _end_with_parent() -> None:
    """End this process as soon as its parent ends, however that happens."""
    if (parent := multiprocessing.parent_process()) is not None:
        wait([parent.sentinel])
        os._exit(1)


def _how_it_ended(process: BaseProcess) -> Death:
    process.join(_GRACE)
    code = process.exitcode
    if code is None or code >= 0:
        return Death(f"ended with exit code {code}")
    name = signal.Signals(-code).name
    often = f"a system that is short of memory kills so: {LESS_MEMORY}" if name == "SIGKILL" else ""
    return Death(f"killed by {name}", often)
