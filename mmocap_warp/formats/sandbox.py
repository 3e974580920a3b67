"""A sandbox for native readers: a process that reads a file first, because a damaged file may end its reader.

OpenUSD and ezc3d trust what a file says: of a few hundred damaged files one ends the process, and some are read for
ever, without an exception. So a file that this process did not write is read twice, first by a worker process, which
may be ended. The worker answers within milliseconds once it runs, and ends by itself when it has been idle for a while.
"""

import atexit
import json
import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from mmocap_warp.errors import InputError
from mmocap_warp.whole_file import native_path

_SECONDS, _SECONDS_PER_BYTE = 10.0, 2e-7  # of processor time that a file may take
_BYTES, _BYTES_PER_BYTE = 2**30, 16  # of memory that a file may take
_PATIENCE = 12.0  # wall clock's seconds to wait for one of the processor's: the machine may be busy
_IDLE_SECONDS = 120.0  # after which the worker ends: starting one takes half a second of a processor
_DONE = "done"
_REMEDY = "it is damaged: write or copy it again"
_START = "import sys; sys.path[:] = sys.argv[1:]; from mmocap_warp.formats.sandbox import _serve; _serve()"

_LIMITS = {"PXR_WORK_THREAD_LIMIT": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
"""The worker's environment: on many cores, threads' stacks and heaps alone would take a file's share of memory."""

P = ParamSpec("P")
T = TypeVar("T")
Stamp = tuple[int, int, int]

_sound: dict[tuple[str, str], Stamp] = {}
"""By path and reader: the stamp of a file that was read without harm; the reader is "" for a file of our own."""


def sandboxed(reader: Callable[P, T]) -> Callable[P, T]:
    """Let a reader, whose first argument is a path, read a strange file in the sandbox first.

    The reader then raises ``InputError`` also where a file ends the process that reads it, or takes more time or memory
    than a sound one of its size.
    """
    name = f"{reader.__module__}:{reader.__qualname__}"

    @wraps(reader)
    def read_twice(*args: P.args, **kwargs: P.kwargs) -> T:
        path = os.path.abspath(native_path(str(args[0])))
        stamp = _stamp(path)
        if stamp is not None and stamp not in (_sound.get((path, name)), _sound.get((path, ""))):
            _worker.read(name, [str(args[0]), *args[1:]], kwargs, stamp[1])
            _sound[path, name] = stamp
        return reader(*args, **kwargs)

    return read_twice


def trust(path: Path) -> None:
    """Remember that this process has written a file."""
    name = os.path.abspath(path)
    stamp = _stamp(name)
    if stamp is not None:
        _sound[name, ""] = stamp


def _stamp(path: str) -> Stamp | None:
    """What changes when a file does; None where there is none."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns


def _settings() -> dict[str, str]:
    """The project's own variables of the environment."""
    return {name: value for name, value in os.environ.items() if name.startswith("MMOCAP_")}


class _Worker:
    """The process that reads first; it is started when it is needed. Windows does without."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: subprocess.Popen[str] | None = None
        self._owner = 0

    def begin(self) -> None:
        """Start it before it is needed: it imports OpenUSD while this process does."""
        with self._lock, suppress(OSError):
            if sys.platform != "win32":
                self._process()

    def read(self, reader: str, given: list[Any], named: dict[str, Any], size: int) -> None:
        """Let it read a file of so many bytes; an InputError is the reader's, or that of a file which was too much."""
        seconds, memory = _SECONDS + size * _SECONDS_PER_BYTE, _BYTES + size * _BYTES_PER_BYTE
        with self._lock:
            request = {"reader": reader, "given": given, "named": named, "folder": os.getcwd(), "settings": _settings()}
            answer = self._ask(json.dumps(request | {"seconds": seconds, "memory": memory}), seconds)
        if answer:
            raise InputError(*json.loads(answer)) if answer.startswith("[") else InputError(given[0], answer, _REMEDY)

    def _ask(self, request: str, seconds: float) -> str:
        """What is wrong with the file, "" for nothing. A worker that was idle and has ended is started again."""
        if sys.platform == "win32":
            return ""  # it limits neither time nor memory of a process: the file is read as it is
        for _ in range(2):
            process = self._process()
            if process.stdin is None or process.stdout is None:
                raise RuntimeError("a process without pipes")
            try:
                process.stdin.write(request + "\n")
                process.stdin.flush()
                ready, _, _ = select.select([process.stdout], [], [], _PATIENCE * seconds)
                answer = process.stdout.readline().strip() if ready else ""
            except BrokenPipeError:
                ready, answer = [process.stdout], ""
            if answer:
                return answer.removeprefix(_DONE)
            ended = self._end(process)
            if not ready or ended == -signal.SIGPROF:
                return f"takes more than {seconds:.0f} s to be read"
            if ended < 0 and ended != -signal.SIGKILL:  # which somebody else has sent
                return "crashes the library that reads it"
        return ""  # no worker can be had here: the file is read as it is

    def _process(self) -> subprocess.Popen[str]:
        if self._running is None or self._running.poll() is not None or self._owner != os.getpid():
            if self._running is not None:
                _close(self._running)
            self._owner = os.getpid()  # a process that was forked off holds the pipes of its parent's worker
            command, pipe = [sys.executable, "-c", _START, *sys.path], subprocess.PIPE
            self._running = subprocess.Popen(
                command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True, env=os.environ | _LIMITS
            )
        return self._running

    def leave(self) -> None:
        """End an idle process with this one; one that a parent of this one has started is the parent's."""
        if self._running is not None and self._owner == os.getpid():
            self._running.kill()
            _close(self._running)

    def _end(self, process: subprocess.Popen[str]) -> int:
        self._running = None
        try:
            process.wait(1.0)
        except subprocess.TimeoutExpired:
            process.kill()
        return _close(process)


def _close(process: subprocess.Popen[str]) -> int:
    """Close the pipes of a process that has ended, or is another's, and return its code."""
    with suppress(BrokenPipeError), process:
        pass
    return process.wait()


_worker = _Worker()
start_sandbox = _worker.begin
atexit.register(_worker.leave)


def _serve() -> None:
    """Be the worker: read what is asked for on stdin, a JSON object a line, and answer each on stdout."""
    if sys.platform == "win32":
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asks
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print must not get among the answers
    import_module("pxr.UsdSkel")
    while select.select([sys.stdin], [], [], _IDLE_SECONDS)[0] and (line := sys.stdin.readline()):
        request = json.loads(line)
        module, name = request["reader"].split(":")
        read = getattr(import_module(module), name).__wrapped__
        _limit_memory(int(request["memory"]))
        signal.setitimer(signal.ITIMER_PROF, request["seconds"])
        answer = _DONE
        try:
            os.chdir(request["folder"])
            for setting in _settings():
                del os.environ[setting]
            os.environ |= request["settings"]
            read(*request["given"], **request["named"])
        except MemoryError:
            answer = f"takes more than {request['memory'] / 2**30:.1f} GiB of memory to be read"
        except InputError as error:
            answer = json.dumps([error.source, error.problem, error.remedy])
        signal.setitimer(signal.ITIMER_PROF, 0)
        print(answer, file=answers, flush=True)


def _limit_memory(more: int) -> None:
    """Let this process have ``more`` bytes beyond what it holds now, where the system says how much that is.

    Writable memory is counted, and not what is merely reserved: a thread's heap reserves 64 MB, whatever it holds.
    """
    if sys.platform == "win32":
        return
    import resource

    table = Path("/proc/self/statm")
    if table.exists():
        *_, data, _ = map(int, table.read_text().split())
        held = data * resource.getpagesize()
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = held + more if hard == resource.RLIM_INFINITY else min(held + more, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
