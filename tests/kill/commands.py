"""The commands that are killed, and processes that run them."""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path

CONTEXT = multiprocessing.get_context("forkserver")  # what takes long to import is imported once
CONTEXT.set_forkserver_preload(["numpy", "cv2", "warp", "scipy.stats", "pxr.Usd", "pxr.UsdSkel", "cyclopts"])


@dataclass(frozen=True)
class Command:
    """A command of ``mmocap``, and how it is given again after it was killed."""

    arguments: Callable[[Path, Path], list[str]]  # of the recording's folder and of the folder to write
    again: tuple[str, ...] = ("--force",)
    any_process: bool = False  # whether any of its processes is killed, and not the one that was started alone


COMMANDS = {
    "track": Command(
        lambda made, out: ["track", str(made / "scene.toml"), "-o", str(out / "r.usdc"), "--evaluations", "2000"],
        ("--resume",),
    ),
    "fit": Command(lambda made, out: ["fit", str(made / "scene.toml"), "-o", str(out / "s.usdc"), "--device", "cpu"]),
    "mask": Command(lambda made, out: ["mask", str(made / "scene.toml"), "-o", str(out / "masks")]),
    "study": Command(lambda made, out: ["study", "run", str(made / "study.toml"), "-o", str(out / "study")], ()),
    "batch": Command(
        lambda made, out: [
            *("batch", str(made / "many"), "-o", str(out / "batch"), "--steps", "track,eval,export:glb,view"),
            *("--device", "cpu", "--workers", "2"),
        ],
        (),
        any_process=True,
    ),
    "export": Command(lambda made, out: ["export", str(made / "result.usdc"), "-o", str(out / "a.usdz")]),
}


def processes_of(run: BaseProcess) -> list[int]:
    """A command's process and all that it has begun."""
    parents = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(file.parent.name)] = int(file.read_text().rpartition(")")[2].split()[1])
    own = [run.pid]
    for pid in own:  # it grows on the way
        own += [child for child, parent in parents.items() if parent == pid]
    return own


def run_to_end(arguments: list[str]) -> float:
    """Run a command and return how long it took [s]."""
    begun = time.monotonic()
    run = started(arguments)
    run.join()
    if run.exitcode:
        raise SystemExit(f"mmocap {' '.join(arguments)} ended with {run.exitcode}")
    return time.monotonic() - begun


def started(arguments: list[str]) -> BaseProcess:
    """A process that runs a command."""
    run = CONTEXT.Process(target=_command_line, args=([*arguments, "--quiet"],))
    run.start()
    return run


def _command_line(arguments: list[str]) -> None:
    """The command line, with a checkpoint after every frame."""
    from mmocap_warp import cli
    from mmocap_warp.tracking import checkpoint

    checkpoint._INTERVAL = 0.0
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        sys.exit(cli.main(arguments))
