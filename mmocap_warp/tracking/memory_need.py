"""What a search would take of a device's memory, told before it is taken.

A machine that runs out of memory kills the program, or slows to a crawl; so what is too large is refused beforehand,
naming what fits. The need is measured on small searches, not modelled: it follows whatever arrays they hold.
"""

from __future__ import annotations

import bisect
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import warp as wp

from mmocap_warp.device import free_memory
from mmocap_warp.errors import InputError

if TYPE_CHECKING:
    from mmocap_warp.tracking.config import TrackConfig

_SHARE = 0.9  # of the free memory may be taken: kernels, graphs and everybody else want some too
_SMALL = 600  # evaluations of the smallest search that is measured: filters' layers and parts divide it
_GB = 1e9


@dataclass(frozen=True)
class MemoryNeed:
    """Bytes of all Warp arrays of a search, for any number of runs of any budget.

    A run's are a polynomial of second degree in the budget: a filter's particles grow with it, and the arrays that hold
    a number for each two particles with its square; other searches take the same whatever the budget.

    Attributes:
        fixed: bytes that do not depend on the number of runs.
        budget: evaluations of the smallest search that was measured.
        per_run: bytes of a run at one, two and three times that budget.
    """

    fixed: int
    budget: int
    per_run: tuple[int, int, int]

    def of(self, runs: int, evaluations: int) -> float:
        """Bytes that so many runs of a budget, no smaller than the measured one, take."""
        x = evaluations / self.budget - 1.0
        once, twice, thrice = self.per_run
        each = once + x * (twice - once) + x * (x - 1.0) / 2.0 * (thrice - 2 * twice + once)
        return self.fixed + runs * each


def measure_need(build: Callable[[TrackConfig], object], config: TrackConfig) -> MemoryNeed:
    """Measure on searches of a run or two.

    Args:
        build: makes a search of a configuration.
        config: what is wanted; ``runs`` and ``evaluations`` of what is built are small.
    """

    def size(runs: int, evaluations: int) -> int:
        return array_bytes(build(replace(config, seed=0, runs=runs, evaluations=evaluations)))

    budget = min(config.evaluations, _SMALL)
    one = size(1, budget)
    run = size(2, budget) - one
    fixed = one - run
    if config.evaluations == budget:
        return MemoryNeed(fixed, budget, (run, run, run))
    return MemoryNeed(fixed, budget, (run, size(1, 2 * budget) - fixed, size(1, 3 * budget) - fixed))


def check_fits(build: Callable[[TrackConfig], object], config: TrackConfig, device: str) -> None:
    """See that a search fits into the device's free memory.

    Raises:
        InputError: it does not; says how many runs, or what budget, would.
    """
    free = free_memory(device)
    if free is None:
        return
    need = measure_need(build, config)
    wanted, memory = need.of(config.runs, config.evaluations), _SHARE * free
    if wanted <= memory:
        return
    runs = _most(config.runs, lambda runs: need.of(runs, config.evaluations) <= memory)
    evaluations = _most(config.evaluations, lambda evaluations: need.of(config.runs, evaluations) <= memory)
    nothing = "choose fewer runs, a smaller budget and a smaller scale"
    fitting = [f"runs = {runs}"] * (runs > 0) + [f"evaluations = {evaluations}"] * (evaluations >= need.budget)
    raise InputError(
        device,
        f"{config.algorithm} with runs = {config.runs} and evaluations = {config.evaluations} takes "
        f"{wanted / _GB:,.1f} GB of memory, {free / _GB:,.1f} GB are free",
        f"the most that fits is {' or '.join(fitting)}" if fitting else nothing,
    )


def _most(wanted: int, fits: Callable[[int], bool]) -> int:
    """The largest number below ``wanted``, which does not fit, that does."""
    return bisect.bisect_left(range(1, wanted), True, key=lambda number: not fits(number))


def array_bytes(owner: object) -> int:
    """Bytes of the Warp arrays that an object of this project holds, in itself and in its parts."""
    seen: dict[int, object] = {}
    unseen = [owner]
    while unseen:
        thing = unseen.pop()
        if id(thing) in seen:
            continue
        seen[id(thing)] = thing
        if isinstance(thing, dict):
            unseen += thing.values()
        elif isinstance(thing, list | tuple):
            unseen += thing
        elif type(thing).__module__.startswith("mmocap_warp") and hasattr(thing, "__dict__"):
            unseen += vars(thing).values()
    total = end = 0
    arrays = [thing for thing in seen.values() if isinstance(thing, wp.array) and thing.ptr]
    for first, last in sorted((array.ptr, array.ptr + array.capacity) for array in arrays):
        total += max(0, last - max(first, end))  # a view lies within another array
        end = max(end, last)
    return total
