"""The ``mmocap`` command line: a module per command, loaded when that command is called.

Nothing here imports Warp, USD or OpenCV, so that ``mmocap --help`` answers at once.
"""

import atexit
import errno
import gc
import os
import platform
import signal
import sys
import threading
import tomllib
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path
from typing import Any, TextIO, cast, get_args

from cyclopts import App, CycloptsError, Parameter, Token, convert

from mmocap_warp.cli.console import BAD_INPUT, BROKEN_PIPE, FAILURE, INTERRUPTED, OK, TERMINATED, USAGE
from mmocap_warp.commands.outputs import release_locks
from mmocap_warp.errors import InputError, UsageError

_REFERENCES = "MMOCAP_ALLOW_REFERENCES"
_NO_ROOM = (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # of what is written to, be it stdout or a file
_LOADING = {("context.py", "load"), ("build.py", "init_kernel_cache")}  # by file, what reads and writes Warp's kernels

atexit.register(gc.freeze)  # to look through all that is left for garbage is a tenth of a short command


def _converted(kind: Any, tokens: Sequence[Token]) -> Any:
    """What a flag's text is; the parser by itself would round it to a whole number."""
    if int in (get_args(kind) or (kind,)) and "." in tokens[0].value:
        raise ValueError("it must be a whole number")
    return convert(kind, tokens)


app = App(
    name="mmocap",
    help="Markerless motion capture from silhouettes: calibrated cameras and masks in, an animated USD body out.",
    help_epilogue="Exit codes: 0 done, 1 failed, 2 wrong usage, 3 wrong input, 4 a check failed, 130 interrupted, "
    "143 terminated.",
    help_format="markdown",  # plain text would keep the line breaks of the docstrings
    default_parameter=Parameter(negative_iterable=(), converter=_converted),
    version=lambda: _version(),
    version_format="plaintext",  # a package a line
    suppress_keyboard_interrupt=False,
)

COMMANDS: dict[str, dict[str, str]] = tomllib.loads(Path(__file__).with_name("commands.toml").read_text("utf-8"))
"""Where each command is, and its help; the commands within another one say only their help here."""
for _order, (_name, _command) in enumerate(COMMANDS.items()):
    if "target" in _command:
        app.command(f"mmocap_warp.cli.{_command['target']}", name=_name, help=_command["help"], sort_key=_order)


class Terminated(KeyboardInterrupt):
    """SIGTERM: whatever saves its work on Ctrl-C saves it on this too."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; errors become one line on stderr.

    Without ``argv``, the arguments after the program's name, those of the process count.
    """
    gc.set_threshold(10_000, 20, 50)  # what is imported is no garbage, and looking through it is a fifth of a start
    tokens = sys.argv[1:] if argv is None else list(argv)
    # NumPy's matrix products have other last bits with other numbers of threads: results would depend on the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A small file may say that its image is as large as the memory.
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 27))
    _open_streams()
    messages = sys.stderr
    sys.stderr = cast(TextIO, _Messages(messages))
    try:
        code = _run(tokens)
        sys.stdout.flush()
        return code
    except (BrokenPipeError, SystemExit):  # the writer of the help makes the second of the first
        _drop_output(sys.stdout)
        return BROKEN_PIPE
    except OSError as error:
        _drop_output(sys.stdout)
        if error.errno not in _NO_ROOM:
            raise
        return _fail(f"cannot write ({error.strerror}); make room, or send the output elsewhere", FAILURE)
    finally:
        sys.stderr = messages


class _Messages:
    """Standard error, or nothing once it cannot be written: a run does not end for want of somebody who reads."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        with suppress(OSError):
            return self._stream.write(text)
        _drop_output(self._stream)
        return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError:
            _drop_output(self._stream)


def _open_streams() -> None:
    """Open standard streams that are closed: the next file that is opened would be taken for one of them.

    A path that is not UTF-8 is printed with escapes.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # as a rule it gets this number, the lowest that is free
            os.dup2(opened, number)
            if opened != number:
                os.close(opened)
            os.set_inheritable(number, True)
    sys.stdout, sys.stderr = (
        stream or open(number, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        for number, stream in ((1, sys.stdout), (2, sys.stderr))
    )
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _run(tokens: list[str]) -> int:
    debug = "--debug" in tokens or os.environ.get("MMOCAP_DEBUG", "0") not in ("", "0")
    try:
        with _process_state(tokens):
            code = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        return _fail(f"{error} (mmocap --help lists what is possible)", USAGE)
    except UsageError as error:
        return _fail(error.flags, USAGE)
    except Terminated:
        return _fail("terminated", TERMINATED)
    except KeyboardInterrupt:
        return _fail("interrupted", INTERRUPTED)
    except Exception as error:
        if debug or (isinstance(error, OSError) and error.errno in _NO_ROOM):
            raise
        if isinstance(error, InputError):
            return _fail(str(error), BAD_INPUT)
        if isinstance(error, MemoryError):
            return _fail("not enough memory; try fewer runs, evaluations or headings, or a smaller --scale", FAILURE)
        if cache := _kernel_cache_at_fault(error):
            return _fail(cache, BAD_INPUT)
        return _fail(f"unexpected {type(error).__name__}: {error} (repeat with --debug to see where)", FAILURE)
    finally:
        release_locks()
    return code if isinstance(code, int) else OK


@contextmanager
def _process_state(tokens: Sequence[str]) -> Iterator[None]:
    """While it runs, SIGTERM raises :class:`Terminated`, and readers of USD know whether to follow references."""

    def terminate(*_: object) -> None:
        raise Terminated

    in_main_thread = threading.current_thread() is threading.main_thread()  # no other may set signals
    handler = signal.signal(signal.SIGTERM, terminate) if in_main_thread else None
    references = os.environ.get(_REFERENCES, "")
    os.environ[_REFERENCES] = "1" if "--allow-references" in tokens else references
    try:
        yield
    finally:
        os.environ[_REFERENCES] = references
        if in_main_thread:
            signal.signal(signal.SIGTERM, handler)


def _kernel_cache_at_fault(error: Exception) -> str | None:
    """What is wrong with the kernel cache and how to move it, if an error came from there; else None.

    Warp raises a plain ``Exception`` for a kernel that cannot be loaded, ``OSError`` where it cannot write, and
    ``ValueError`` for a damaged description. An error in a kernel's own code is of other types.
    """
    places = {(os.path.basename(frame.filename), frame.name) for frame in traceback.extract_tb(error.__traceback__)}
    of_a_file = isinstance(error, (OSError, ValueError)) or str(error).startswith("Failed to load")
    if not (places & _LOADING and of_a_file and "warp" in sys.modules):
        return None
    import warp as wp

    folder = wp.config.kernel_cache_dir or os.environ.get("WARP_CACHE_PATH", "")
    remedy = "delete that folder, or name another in the environment's variable WARP_CACHE_PATH"
    return f"{folder}: the compiled kernels kept there cannot be used ({error}); {remedy}"


def _drop_output(stream: TextIO) -> None:
    """Let nothing more be written to where nothing can be: Python would try once more as it ends, and complain."""
    with suppress(OSError, ValueError), open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def _fail(message: str, code: int) -> int:
    print("mmocap:", " ".join(message.split()), file=sys.stderr)
    return code


def _version() -> str:
    from mmocap_warp.versions import package_versions

    lines = [f"{name} {version}" for name, version in package_versions().items()]
    return "\n".join([*lines, f"Python {platform.python_version()}"])
