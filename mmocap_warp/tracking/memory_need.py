"""What a search would take of a device's memory, told before it is taken.

A machine that runs out of memory kills the program, or slows to a crawl; so what is too large is refused beforehand,
naming what fits. The need is not modelled but read from a tracker of no runs: its arrays have no rows, and so take next
to nothing whatever the budget, but each knows how many bytes a row of it has.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import warp as wp

from mmocap_warp.body.model import Subject
from mmocap_warp.device import free_memory, resolve_device
from mmocap_warp.errors import InputError
from mmocap_warp.tracking.config import TrackConfig
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.tracker import Tracker
from mmocap_warp.views.rig import CameraRig

_SHARE = 0.9  # of the free memory may be taken: kernels, graphs and everybody else want some too
_GB = 1e9


@dataclass(frozen=True)
class MemoryNeed:
    """Bytes of all Warp arrays of a tracker.

    Attributes:
        fixed: of those that do not depend on the number of runs.
        per_run: of each run.
    """

    fixed: int
    per_run: int

    def of(self, runs: int) -> int:
        """Bytes that so many runs take."""
        return self.fixed + runs * self.per_run


def memory_need(subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> MemoryNeed:
    """What a tracker would take; the arguments are its own."""
    empty = tracker_of(config)(subject, rig, config, fps, runs=0)
    of_candidates = {id(array) for array in empty.candidate_arrays}
    fixed = per_run = 0
    for array in arrays_of(empty):
        if array.size:
            fixed += array.capacity
        else:
            per_run += array.strides[0] * (empty.particles if id(array) in of_candidates else 1)
    return MemoryNeed(fixed, per_run)


def arrays_of(owner: object) -> Iterator[wp.array[Any]]:
    """The Warp arrays that an object of this project holds, in itself and in its parts, each once."""
    seen: set[int] = set()
    unseen = [owner]
    while unseen:
        thing = unseen.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, wp.array):
            yield thing
        elif isinstance(thing, dict):
            unseen += thing.values()
        elif isinstance(thing, list | tuple):
            unseen += thing
        elif _is_ours(thing) and hasattr(thing, "__dict__"):
            unseen += vars(thing).values()


def _is_ours(thing: object) -> bool:
    """Whether a thing may hold arrays: an object of this project, or a Warp struct."""
    is_struct = hasattr(thing, "__ctype__")
    return is_struct or any(base.__module__.startswith("mmocap_warp") for base in type(thing).mro())


def tracker_of(config: TrackConfig) -> type[Tracker] | type[ContourTracker]:
    """The class that tracks by some settings."""
    return ContourTracker if config.fits_contours else Tracker


def fitting_tracker(subject: Subject, rig: CameraRig, config: TrackConfig, fps: float) -> Tracker | ContourTracker:
    """A tracker, or an error where the device has not the memory for it.

    Raises:
        InputError: too many runs, or too large a budget; says how many runs, or what budget, would fit.
    """
    device = resolve_device(config.device)
    free = free_memory(device)
    need = memory_need(subject, rig, config, fps)
    if free is None or need.of(config.runs) <= _SHARE * free:
        return tracker_of(config)(subject, rig, config, fps)

    def too_much(evaluations: int) -> bool:
        smaller = memory_need(subject, rig, replace(config, evaluations=evaluations), fps)
        return smaller.of(config.runs) > _SHARE * free

    runs = int((_SHARE * free - need.fixed) // need.per_run)
    budgets = range(1, 1 if too_much(1) else config.budget)
    evaluations = bisect.bisect_left(budgets, True, key=too_much)
    fitting = [f"runs = {runs}"] * (runs > 0) + [f"evaluations = {evaluations}"] * (evaluations > 0)
    raise InputError(
        device,
        f"{config.algorithm} with runs = {config.runs} and evaluations = {config.budget} takes "
        f"{need.of(config.runs) / _GB:,.1f} GB of memory, {free / _GB:,.1f} GB are free",
        f"the most that fits is {' or '.join(fitting)}"
        if fitting
        else "choose fewer runs, a smaller budget and a smaller scale",
    )
