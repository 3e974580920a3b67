"""The ``mmocap`` command line: a module per command, loaded when that command is called.

Nothing here imports Warp, USD or OpenCV, so that ``mmocap --help`` answers at once.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress

from cyclopts import App, CycloptsError

from mmocap_warp.cli.exit_codes import BAD_INPUT, FAILURE, INTERRUPTED, OK, USAGE, UsageError
from mmocap_warp.errors import InputError

app = App(
    name="mmocap",
    help="Markerless motion capture from silhouettes: calibrated cameras and masks in, an animated USD body out.",
    help_epilogue="Exit codes: 0 done, 1 failed, 2 wrong usage, 3 wrong input, 4 a check failed, 130 interrupted.",
    help_format="plaintext",
    version=lambda: _version(),
    suppress_keyboard_interrupt=False,
)

_COMMANDS = (
    ("demo", "demo:demo", "Track the built-in scene and compare with its truth."),
    ("track", "track:track", "Track a scene: from videos or masks to an animated USD body."),
    ("fit", "fit:fit", "Find the body, its place and its first pose in a scene."),
    ("mask", "mask:mask", "Write a scene's foreground masks and an overlay of them."),
    ("cameras", "cameras:cameras", "Print a scene's cameras and draw the world axes into their views."),
    ("eval", "evaluate:evaluate", "Print a result's IoU, and its errors where the truth is known."),
    ("show", "show:show", "Write a result's overlay video and contact sheet."),
    ("export", "export:export", "Write a result's animation alone, as .usda, .usdc or .usdz."),
    ("body", "body:app", "Make a body from MakeHuman's data."),
)
for _order, (_name, _target, _help) in enumerate(_COMMANDS):
    app.command(f"mmocap_warp.cli.{_target}", name=_name, help=_help, sort_key=_order)
_DEPENDENCIES = ("warp-lang", "usd-core", "opencv-python-headless", "opencv-python", "numpy")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; errors become one line on stderr.

    Args:
        argv: the arguments after the program's name; those of the process where omitted.
    """
    tokens = sys.argv[1:] if argv is None else list(argv)
    debug = "--debug" in tokens or os.environ.get("MMOCAP_DEBUG", "0") not in ("", "0")
    try:
        code = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        return _fail(f"{error} (mmocap --help lists what is possible)", USAGE)
    except UsageError as error:
        return _fail(str(error), USAGE)
    except InputError as error:
        if debug:
            raise
        return _fail(str(error), BAD_INPUT)
    except KeyboardInterrupt:
        return _fail("interrupted", INTERRUPTED)
    except Exception as error:
        if debug:
            raise
        return _fail(f"unexpected {type(error).__name__}: {error} (repeat with --debug to see where)", FAILURE)
    return code if isinstance(code, int) else OK


def _fail(message: str, code: int) -> int:
    print("mmocap:", " ".join(message.split()), file=sys.stderr)
    return code


def _version() -> str:
    import platform
    from importlib.metadata import PackageNotFoundError, version

    from mmocap_warp import __version__

    lines = [f"mmocap-warp {__version__}"]
    for package in _DEPENDENCIES:
        with suppress(PackageNotFoundError):  # OpenCV comes under two names
            lines.append(f"{package} {version(package)}")
    return "\n".join([*lines, f"Python {platform.python_version()}"])
