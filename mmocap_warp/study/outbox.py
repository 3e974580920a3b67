"""Results on their way to disk: what cannot be stored now is kept, and tried again."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.study.cell import Cell, CellResult, write_cell

_CAPACITY = 16  # results, of some megabytes each
_SECONDS_BETWEEN_TRIES = 5.0


class Outbox:
    """Stores results; a full disk costs none of them, if room is made before the run ends.

    Args:
        note: is told, once, that results cannot be stored, and why.
    """

    def __init__(self, note: Callable[[str], None]) -> None:
        self._note = note
        self._kept: dict[Path, CellResult] = {}
        self._next_try = 0.0
        self.problem = ""

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Whose results are kept."""
        return tuple(result.cell for result in self._kept.values())

    @property
    def full(self) -> bool:
        """Whether no more results should be made before these are stored."""
        return len(self._kept) >= _CAPACITY

    def put(self, path: Path, result: CellResult) -> int:
        """Store a result, with what is kept already; says how many were stored."""
        self._kept[path] = result
        return self.flush() if len(self._kept) == 1 else self.flush_if_due()

    def flush_if_due(self) -> int:
        """Try again what could not be stored, now and then; says how many were stored."""
        return self.flush() if self._kept and time.monotonic() >= self._next_try else 0

    def flush(self) -> int:
        """Try again what could not be stored; says how many were stored."""
        waiting = list(self._kept.items())
        for stored, (path, result) in enumerate(waiting):
            try:
                write_cell(path, result)
            except InputError as error:
                self._next_try = time.monotonic() + _SECONDS_BETWEEN_TRIES
                if not self.problem:
                    self._note(f"{error}; results wait in memory until then")
                self.problem = str(error)
                return stored
            del self._kept[path]
        self.problem = ""
        return len(waiting)
