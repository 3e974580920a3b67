"""The protocol of an engine: workers that are given jobs, and the events that they report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from mmocap_warp.study.cell import CellResult
from mmocap_warp.study.job import Advance, Job, Refusal


@dataclass(frozen=True)
class Ready:
    """A worker has started and waits for its first job."""

    name: str  # its device, and its machine where there are several


@dataclass(frozen=True)
class Death:
    """A worker is gone, and with it what it was tracking. Another one may become ready in its place."""

    reason: str  # why it is gone
    remedy: str = ""  # what the user can do if it happens again, where that is known


@dataclass(frozen=True)
class Notice:
    """Something that a person should read, of all workers rather than of one."""

    text: str


Event = Ready | Advance | CellResult | Refusal | Death | Notice
"""After a result or a refusal the worker waits for its next job."""


class EngineLost(Exception):
    """No worker is left, nor will one come; says why."""


class Engine(Protocol):
    """Workers, numbered from 0."""

    def submit(self, worker: int, job: Job) -> None:
        """Give a worker that waits its next job."""
        ...

    def events(self, seconds: float) -> list[tuple[int, Event]]:
        """What has happened to which worker; waits up to so long for something to happen.

        Raises:
            EngineLost: no worker is left.
        """
        ...

    def close(self) -> None:
        """End all workers, whatever they are doing."""
        ...
