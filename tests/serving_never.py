"""A worker that does not come up, in a module of its own: a process that starts with it imports nothing else."""

from __future__ import annotations

import sys


def serve_never(connection: object, device: str, threads: int | None) -> None:
    """End at once."""
    sys.exit(3)
