"""What a command says while it works: notes, warnings and progress, to whoever called it."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

Progress = Callable[..., None]
"""Called with the steps that are done, how many there are, and perhaps the evaluations that were spent."""


class Reporter:
    """Listens to a command. Notes and progress are dropped, warnings are Python's; a subclass may do otherwise."""

    def note(self, line: str) -> None:
        """Hear what happens."""

    def warn(self, line: str) -> None:
        """Hear what is wrong."""
        level, frame = 1, sys._getframe()
        while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("mmocap_warp."):
            level, frame = level + 1, frame.f_back
        warnings.warn(line, stacklevel=level)  # it names the caller's line, not one of ours

    def progress(self, stage: str, done: int, total: int) -> None:
        """Hear that a stage, such as ``track``, has done so many of its steps."""

    def stage(self, name: str, unit: str | None = "frames") -> AbstractContextManager[Progress]:
        """Work on a stage for as long as the context is open; what it gives is called after each step.

        Args:
            name: of the stage.
            unit: what a step is; None where steps are only shares of the whole.
        """
        return nullcontext(lambda done, total, evaluations=0: self.progress(name, done, total))
