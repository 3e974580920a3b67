"""What to run next, so that it can be copied from one command's answer to the next prompt."""

from __future__ import annotations

import shlex
from pathlib import Path


def command(name: str, *arguments: str | Path) -> str:
    """A command of ``mmocap`` as a shell takes it."""
    return shlex.join(["mmocap", name, *map(str, arguments)])


def mask_command(scene: Path) -> str:
    """To make masks of a scene's videos."""
    return command("mask", scene, "-o", scene.parent / "masks")


def track_command(scene: Path) -> str:
    """To track a scene."""
    return command("track", scene, "-o", scene.parent / "result.usdc")
