"""Reading a file in a process of its own first, where native code reads it that may not survive a damaged one.

OpenUSD and ezc3d trust what a file says: of a few hundred damaged files one ends the process, and some are read for
ever. No exception tells. So a file that this process did not write is read twice, first by another process, which may
be ended; once that runs it answers within milliseconds, and it ends by itself when nobody has asked for a while.
"""

from __future__ import annotations

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
from typing import ParamSpec, TypeVar

from mmocap_warp.errors import InputError

_SECONDS, _SECONDS_PER_BYTE = 10.0, 2e-7
"""Of processor time that a file may take."""
_BYTES, _BYTES_PER_BYTE = 2**30, 16
"""Of memory that it may take."""
_PATIENCE = 12.0  # times the processor's seconds: the machine may be busy
_IDLE = 20.0  # after which the other process ends [s]
_DONE = "done"
_REMEDY = "it is damaged: write or copy it again"
_START = "import sys; sys.path[:] = sys.argv[1:]; from mmocap_warp.formats.sandbox import _serve; _serve()"

_ALONE = {"PXR_WORK_THREAD_LIMIT": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
"""For the environment: on many cores the stacks and heaps of threads alone would take what a file may."""

P = ParamSpec("P")
T = TypeVar("T")
Stamp = tuple[int, int, int]

_sound: dict[tuple[str, str], Stamp] = {}
"""Files that need not be tried by a reader, or by any where none is named, as they were then."""


def sandboxed(reader: Callable[P, T]) -> Callable[P, T]:
    """Let a reader, whose first argument is a path, read a strange file in another process first.

    The reader then raises ``InputError`` also where a file ends the process that reads it, or takes more time or memory
    than a sound one of its size.
    """
    name = f"{reader.__module__}:{reader.__qualname__}"

    @wraps(reader)
    def careful(*args: P.args, **kwargs: P.kwargs) -> T:
        path = os.path.abspath(str(args[0]))
        stamp = _stamp(path)
        if stamp is not None and stamp not in (_sound.get((path, name)), _sound.get((path, ""))):
            _worker.read(name, str(args[0]), stamp[1])
            _sound[path, name] = stamp
        return reader(*args, **kwargs)

    return careful


def trust(path: Path) -> None:
    """Remember that this process has written a file."""
    name = os.path.abspath(path)
    stamp = _stamp(name)
    if stamp is not None:
        _sound[name, ""] = stamp


def _stamp(path: str) -> Stamp | None:
    """What changes when a file does; None where there is none."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def _settings() -> dict[str, str]:
    """The project's own variables of the environment."""
    return {name: value for name, value in os.environ.items() if name.startswith("MMOCAP_")}


class _Worker:
    """The process that reads first; started when it is needed. Systems that are not POSIX do without."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: subprocess.Popen[str] | None = None
        self._owner = 0

    def read(self, reader: str, path: str, size: int) -> None:
        """Let it read a file of so many bytes.

        Raises:
            InputError: what its reader raised; the file ended it, or took too much.
        """
        if os.name != "posix":
            return
        seconds, memory = _SECONDS + size * _SECONDS_PER_BYTE, _BYTES + size * _BYTES_PER_BYTE
        with self._lock:
            request: dict[str, object] = {
                "reader": reader,
                "path": path,
                "folder": os.getcwd(),
                "settings": _settings(),
            }
            answer = self._ask(request | {"seconds": seconds, "memory": memory}, seconds)
        if answer:
            raise InputError(*json.loads(answer)) if answer.startswith("[") else InputError(path, answer, _REMEDY)

    def _ask(self, request: dict[str, object], seconds: float) -> str:
        """What is wrong, nothing if all is well; asked again where the process had just ended for want of work."""
        for _ in range(2):
            process = self._process()
            if process.stdin is None or process.stdout is None:
                raise RuntimeError("a process without pipes")
            try:
                process.stdin.write(json.dumps(request) + "\n")
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
            if ended < 0:
                return "breaks the library that reads it"
        return ""  # no such process can be had here: the file is read as it is

    def _process(self) -> subprocess.Popen[str]:
        if self._running is None or self._running.poll() is not None or self._owner != os.getpid():
            if self._running is not None:
                _close_pipes(self._running)
            self._owner = os.getpid()  # a process that was forked off has the pipes of another's
            self._running = subprocess.Popen(
                [sys.executable, "-c", _START, *sys.path],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                env=os.environ | _ALONE,
            )
        return self._running

    def _end(self, process: subprocess.Popen[str]) -> int:
        self._running = None
        try:
            process.wait(1.0)
        except subprocess.TimeoutExpired:
            process.kill()
        _close_pipes(process)
        return process.wait()


def _close_pipes(process: subprocess.Popen[str]) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(BrokenPipeError):
                pipe.close()


_worker = _Worker()


def _serve() -> None:
    """Read what is asked for on stdin, a JSON object a line, and say on stdout what became of it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one who asks
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries may say what they like
    while select.select([sys.stdin], [], [], _IDLE)[0] and (line := sys.stdin.readline()):
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
            read(request["path"])
        except MemoryError:
            answer = f"takes more than {request['memory'] / 2**30:.1f} GiB of memory to be read"
        except InputError as error:
            answer = json.dumps([error.source, error.problem, error.remedy])
        signal.setitimer(signal.ITIMER_PROF, 0)
        print(answer, file=answers, flush=True)


def _limit_memory(more: int) -> None:
    """Let this process have so many bytes more than it has now, where the system tells how many that are.

    What it can write to is counted, and not what is merely reserved: a thread's heap reserves 64 MB, whatever it holds.
    """
    import resource

    table = Path("/proc/self/statm")
    if table.exists():
        *_, data, _ = map(int, table.read_text().split())
        held = data * resource.getpagesize()
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = held + more if hard == resource.RLIM_INFINITY else min(held + more, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
