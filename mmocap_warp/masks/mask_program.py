"""Masks by a program of its own environment, so that nothing that it needs enters ours.

The program is started once for each camera, with two more arguments: a folder of frames, ``000000.jpg`` and so on, and
a folder for their masks; both have the camera's name. For each frame it writes a mask or labels of the same name and
size, as PNG. Masks that are there already were made by an earlier run: it may leave these frames out.
"""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import DEVNULL, STDOUT
from typing import Any

from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.masks.frames import read_file
from mmocap_warp.masks.mask_files import decode_mask_image

_PATIENCE = 600.0  # seconds that a program may go on without a new mask or a word: it may load a large model first
_LOOK_INTERVAL = 0.2  # seconds between two looks at what a program has made
_LAST_WORDS = 200  # characters of what a program said that are repeated where it fails
MEDIAPIPE_SCRIPT = Path(__file__).parent / "programs" / "mediapipe_pose.py"
_BY_HAND = "python3.12 -m venv mp && mp/bin/pip install mediapipe==0.10.14 'numpy<2'"


@dataclass(frozen=True)
class MaskProgram:
    """A program that makes masks."""

    name: str  # as the user called it
    command: tuple[str, ...]  # its words; two folders follow
    environment: dict[str, str] | None = field(default=None, repr=False)  # of its process; None for ours

    def make(self, frames: Path, masks: Path, size: tuple[int, int], progress: Callable[[int], None]) -> list[Path]:
        """Let it make the masks of one camera that are not there yet; the files of all, in the order of the frames.

        ``frames`` is a folder of images of one ``size``, width and height [px], and ``masks`` that for their masks;
        what the program says goes into a file beside it. ``progress`` is called with how many masks there are. Raises
        an InputError where it cannot be started, fails, hangs, or leaves a frame without a mask.
        """
        made = [masks / f"{file.stem}.png" for file in sorted(frames.iterdir())]
        for mask in made:  # a run that was stopped may have left half a file
            if mask.exists() and _fault(mask, size):
                mask.unlink()
        if not all(mask.exists() for mask in made):
            problem = self._run([*self.command, str(frames), str(masks)], made, masks.with_suffix(".log"), progress)
            for mask in made:  # a program that fails at its end, with all masks written, has done its work
                if fault := _fault(mask, size):
                    raise self._error(problem or fault, mask, frames)
        progress(len(made))
        return made

    def _run(self, words: list[str], made: list[Path], log: Path, progress: Callable[[int], None]) -> str | None:
        """Run it to its end, and say what went wrong."""
        with log.open("wb") as said:
            try:
                # In a session of its own, so that it can be ended with all that it has started.
                process = subprocess.Popen(
                    words, stdin=DEVNULL, stdout=said, stderr=STDOUT, env=self.environment, start_new_session=True
                )
            except (OSError, ValueError) as error:
                return f"cannot be started: {words[0]}: {getattr(error, 'strerror', None) or error}"
            try:
                state, changed = (0, 0), time.monotonic()
                while process.poll() is None:
                    now = (sum(mask.exists() for mask in made), log.stat().st_size)
                    progress(now[0])
                    if now != state:
                        state, changed = now, time.monotonic()
                    elif time.monotonic() - changed > _PATIENCE:
                        return f"made no mask and said nothing for {_PATIENCE:.0f} s"
                    with suppress(subprocess.TimeoutExpired):
                        process.wait(_LOOK_INTERVAL)
            finally:
                end_program(process)
        return f"failed with exit code {process.returncode}" if process.returncode else None

    def _error(self, fault: str, mask: Path, frames: Path) -> InputError:
        """The error of a mask, with what the program said last and the line that runs it alone."""
        log = mask.parent.with_suffix(".log")
        said = log.read_text("utf-8", "replace").strip()[-_LAST_WORDS:]
        mask.unlink(missing_ok=True)
        where = f"--with {self.name}, camera {frames.name}, frame {int(mask.stem)}"
        ran = shlex.join([*self.command, "FRAMES", "MASKS"])
        remedy = f"see {log}, mend it and go on with the same command; it ran: {ran}"
        return InputError(where, f"{fault}; it said: {said or 'nothing'}", remedy)


def _fault(mask: Path, size: tuple[int, int]) -> str | None:
    """What is wrong with a mask."""
    try:
        height, width = decode_mask_image(read_file(mask), mask).shape[:2]
    except InputError as error:
        return error.problem if mask.exists() else "has no mask"
    return None if (width, height) == size else f"its mask is {width}x{height}, the frame is {size[0]}x{size[1]}"


def end_program(process: subprocess.Popen[Any]) -> None:
    """End a program that still runs, with all that it has started."""
    if process.poll() is not None:
        return
    if sys.platform == "win32":
        process.kill()
    else:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def find_program(text: str, note: Callable[[str], None]) -> MaskProgram:
    """The program that ``--with`` means: ``mediapipe``, or a command as a shell would split it; no shell runs it.

    What is downloaded for it is noted before.

    Raises:
        UsageError: no command.
        InputError: mediapipe, and ``uv`` is missing or cannot install it.
    """
    if text == "mediapipe":
        return _mediapipe(note)
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise UsageError(f"--with {text} is no command ({error})") from None
    if not words:
        raise UsageError("--with names no program")
    return MaskProgram(text, tuple(words))


def _mediapipe(note: Callable[[str], None]) -> MaskProgram:
    """MediaPipe Pose in an environment that ``uv`` makes once and keeps in its cache."""
    manual = f"or by hand: {_BY_HAND}, then --with {shlex.quote(f'mp/bin/python {shlex.quote(str(MEDIAPIPE_SCRIPT))}')}"
    uv = shutil.which("uv") or shutil.which("uv", path=str(Path(sys.executable).parent))
    if uv is None:
        raise InputError("--with mediapipe", "needs uv, which is not installed", f"pip install uv; {manual}")
    # Packages of ours that PYTHONPATH names are none for another version of Python.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    offline = (uv, "run", "--quiet", "--offline", "--script", str(MEDIAPIPE_SCRIPT))
    if subprocess.run(offline, capture_output=True, env=environment).returncode:
        note("uv installs MediaPipe 0.10.14 with its weights (Apache-2.0) into its cache: about 200 MB, once")
        done = subprocess.run([word for word in offline if word != "--offline"], capture_output=True, env=environment)
        if done.returncode:
            said = done.stderr.decode("utf-8", "replace").strip()[-_LAST_WORDS:]
            raise InputError("--with mediapipe", f"uv cannot install it: {said}", f"connect to the network, {manual}")
    return MaskProgram("mediapipe", offline, environment)
