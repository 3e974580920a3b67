"""The ``mmocap`` command line: a module per command, loaded when that command is called.

Nothing here imports Warp, USD or OpenCV, so that ``mmocap --help`` answers at once.

May import: every other room.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from cyclopts import App, CycloptsError, Parameter

from mmocap_warp.cli.console import BAD_INPUT, BROKEN_PIPE, FAILURE, INTERRUPTED, OK, TERMINATED, USAGE
from mmocap_warp.commands.outputs import release_locks
from mmocap_warp.errors import InputError, UsageError

_REFERENCES = "MMOCAP_ALLOW_REFERENCES"
_NO_ROOM = (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of what is written to, be it stdout or a file."""
_LOADING = {("context.py", "load"), ("build.py", "init_kernel_cache")}
"""Warp's functions, by file, that read and write its kernel cache."""

app = App(
    name="mmocap",
    help="Markerless motion capture from silhouettes: calibrated cameras and masks in, an animated USD body out.",
    help_epilogue="Exit codes: 0 done, 1 failed, 2 wrong usage, 3 wrong input, 4 a check failed, 130 interrupted, "
    "143 terminated.",
    help_format="markdown",  # plain text would keep the line breaks of the docstrings
    default_parameter=Parameter(negative_iterable=()),
    version=lambda: _version(),
    suppress_keyboard_interrupt=False,
)

_DEMO = (
    "Track the built-in scene and compare with its truth.\n\n"
    "Who walks in it is not the tracker's own body. Writes result, fitted subject, overlay video, contact sheet and a "
    "plot of error against frame, replacing those of an earlier demo. "
    "Exits with 4 if the mean marker error is over 30 mm.\n\n"
    "'mmocap demo fox', 'hand', 'quadruped' and 'arm' make a scene of a body that is no person, with faulty masks and "
    "its truth, and track that; they exit with 4 if joints are off by over 2 % of its size on average."
)
_INIT = (
    "Write a scene.toml for a folder of videos, and say what is missing.\n\n"
    "It looks at videos, folders of images, masks, pictures of the background and the calibration; projects of "
    "Pose2Sim, EasyMocap, Caliscope and OpenCap are known. Every command says what to run next."
)
_MASK = (
    "Write a scene's foreground masks and an overlay of them.\n\n"
    "They are made as its [foreground] table says. The folder is a scene itself, with the masks undistorted and a "
    "calibration to match: track it as any other."
)
_CAMERAS = (
    "Print a scene's cameras and draw the world axes into their views.\n\n"
    "Exits with 4 where the cameras' mean height is not above the world's zero, which most often is a wrong 'up'."
)
_SYNC = (
    "Find how far a scene's cameras lag one another, and say how sure that is.\n\n"
    "From the motion of the silhouettes; a calibration is used where there is one. Prints the lines for scene.toml. "
    "Exits with 4 where a camera's lag cannot be told."
)
_BENCH = (
    "Measure how fast the program is on this machine, checking every answer.\n\n"
    "From the pose of a body to its cost, in seven cameras of 640x480: each kernel, the whole evaluation, the "
    "optimizers, and frames. Exits with 4 if an answer is wrong."
)
_VALIDATE = (
    "Say what is wrong with a USD file.\n\n"
    "By OpenUSD's validators, and what they miss in bodies that move: weights, lengths, joints, scales, numbers that "
    "are none, files that are needed and lie elsewhere. Exits with 4 where anything is."
)
_MEASURE = "Print a result's joint angles, heel strikes, steps, centre of mass and bone lengths."
_COMMANDS = (  # a command's help is here and not in its docstring, so that the list of commands loads none of them
    ("demo", "track_command:demo", _DEMO),
    ("init", "scene_commands:init", _INIT),
    ("track", "track_command:track", "Track a scene: from videos or masks to an animated USD body."),
    ("fit", "track_command:fit", "Find the body, its place and its first pose in a scene."),
    ("mask", "scene_commands:mask", _MASK),
    ("cameras", "scene_commands:cameras", _CAMERAS),
    ("calib", "calib_command:app", "Calibrations: convert, check, refine or find them."),
    ("sync", "scene_commands:sync", _SYNC),
    ("eval", "result_commands:evaluate", "Print a result's IoU, and its errors where the truth is known."),
    ("show", "result_commands:show", "Write a result's overlay video and contact sheet."),
    ("view", "result_commands:view", "Write a result as one page for a browser: body, cameras, masks and curves."),
    ("export", "result_commands:export", "Write a result's animation alone, for other programs."),
    ("validate", "scene_commands:validate", _VALIDATE),
    ("measure", "result_commands:measure", _MEASURE),
    ("body", "body_command:app", "Bodies: import, draw or export one, or learn its limits."),
    ("synth", "scene_commands:synth", "Write a made-up scene of a body in motion, with its truth."),
    ("study", "study_command:app", "Compare trackers: run a grid of them, and report on it."),
    ("bench", "bench_command:app", _BENCH),
    ("humaneva", "scene_commands:humaneva", "Write a sequence of your own copy of HumanEva-I as a scene."),
)
for _order, (_name, _target, _help) in enumerate(_COMMANDS):
    app.command(f"mmocap_warp.cli.{_target}", name=_name, help=_help, sort_key=_order)


class Terminated(KeyboardInterrupt):
    """SIGTERM: whatever saves its work on Ctrl-C saves it on this too."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; errors become one line on stderr.

    Args:
        argv: the arguments after the program's name; those of the process where omitted.
    """
    tokens = sys.argv[1:] if argv is None else list(argv)
    # NumPy's matrix products have other last bits with other numbers of threads: results would depend on the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        with _references_as_asked(tokens):
            code = _run(tokens)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        _drop_output()
        return BROKEN_PIPE
    except OSError as error:
        _drop_output()
        if error.errno not in _NO_ROOM:
            raise
        return _fail(f"cannot write ({error.strerror}); make room, or send the output elsewhere", FAILURE)


def _run(tokens: list[str]) -> int:
    debug = "--debug" in tokens or os.environ.get("MMOCAP_DEBUG", "0") not in ("", "0")
    try:
        with _termination_raised():
            code = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        return _fail(f"{error} (mmocap --help lists what is possible)", USAGE)
    except UsageError as error:
        return _fail(error.flags, USAGE)
    except InputError as error:
        if debug:
            raise
        return _fail(str(error), BAD_INPUT)
    except Terminated:
        return _fail("terminated", TERMINATED)
    except KeyboardInterrupt:
        return _fail("interrupted", INTERRUPTED)
    except MemoryError:
        if debug:
            raise
        return _fail("not enough memory; try fewer runs, evaluations or headings, or a smaller --scale", FAILURE)
    except Exception as error:
        if debug or (isinstance(error, OSError) and error.errno in _NO_ROOM):
            raise
        if cache := _kernel_cache_at_fault(error):
            return _fail(cache, BAD_INPUT)
        return _fail(f"unexpected {type(error).__name__}: {error} (repeat with --debug to see where)", FAILURE)
    finally:
        release_locks()
    return code if isinstance(code, int) else OK


@contextmanager
def _termination_raised() -> Iterator[None]:
    """Let SIGTERM raise :class:`Terminated`, as Ctrl-C raises KeyboardInterrupt; signals are the main thread's."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def terminate(*_: object) -> None:
        raise Terminated

    before = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _references_as_asked(tokens: Sequence[str]) -> Iterator[None]:
    """Set what ``formats.usd.references`` asks for, while a command runs."""
    before = os.environ.get(_REFERENCES)
    if "--allow-references" in tokens:
        os.environ[_REFERENCES] = "1"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(_REFERENCES, None)
        else:
            os.environ[_REFERENCES] = before


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


def _drop_output() -> None:
    """Let nothing more be written to where nothing can be: Python would try once more as it ends, and complain."""
    with suppress(OSError, ValueError), open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


def _fail(message: str, code: int) -> int:
    print("mmocap:", " ".join(message.split()), file=sys.stderr)
    return code


def _version() -> str:
    import platform

    from mmocap_warp.versions import package_versions

    lines = [f"{name} {version}" for name, version in package_versions().items()]
    return "\n".join([*lines, f"Python {platform.python_version()}"])
