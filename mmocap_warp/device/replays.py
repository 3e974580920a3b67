"""Graphs of launches: on a GPU, many small ones would wait for the host."""

from __future__ import annotations

from collections.abc import Callable, Hashable

import warp as wp


class Replays:
    """On a GPU, captures work as a graph the second time it is done, and from then on replays that.

    The first time it is not captured, because it may load kernels and make arrays. Within a capture, and on the CPU, it
    is simply done.

    Args:
        device: a Warp device.
    """

    def __init__(self, device: str) -> None:
        self._device = wp.get_device(device)
        self._graphs: dict[Hashable, wp.Graph | None] = {}

    def run(self, kind: Hashable, work: Callable[[], None]) -> None:
        """Do the work, which launches the same on the same arrays whenever its ``kind`` is the same."""
        if self._device.is_cpu or self._device.is_capturing or kind not in self._graphs:
            work()
            self._graphs.setdefault(kind, None)
            return
        graph = self._graphs[kind]
        if graph is None:
            with wp.ScopedCapture(self._device) as capture:
                work()
            graph = self._graphs[kind] = capture.graph
        wp.capture_launch(graph)
