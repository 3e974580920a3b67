"""Candidates shared by CPU threads: Warp runs a CPU launch on the calling thread and frees the others meanwhile."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from itertools import pairwise

import numpy as np
import warp as wp

from mmocap_warp.kernels.block import Batch, batch_of


class SharedWork:
    """Runs a piece of work on all candidates, a batch in each thread; on a GPU it is one batch.

    No batch has less than ``smallest`` candidates: starting a thread would cost more than it saves.
    """

    def __init__(self, device: str, threads: int, smallest: int = 1) -> None:
        self._device, self._smallest = device, smallest
        self._threads = threads if wp.get_device(device).is_cpu else 1
        self._batches: dict[tuple[int, int], list[Batch]] = {}

    def batches(self, candidates: int, threads: int | None = None) -> list[Batch]:
        """The candidates, one batch for each of ``threads`` or of all threads; made once."""
        count = min(threads or self._threads, max(1, candidates // self._smallest))
        if (candidates, count) not in self._batches:
            bounds = np.linspace(0, candidates, count + 1).round().astype(int).tolist()
            batches = [batch_of(first, end, candidates, self._device) for first, end in pairwise(bounds)]
            self._batches[candidates, count] = batches
        return self._batches[candidates, count]

    def run(self, work: Callable[[Batch], None], candidates: int) -> None:
        """Do the work for the first candidates."""
        batches = self.batches(candidates)
        if len(batches) == 1:
            work(batches[0])
        else:
            list(self._pool.map(work, batches))

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(self._threads)
