"""What a GPU does without waiting for the host: copies through pinned memory, and captured graphs of launches."""

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np
import warp as wp


class Upload:
    """The host's side of a contiguous array that it writes again and again; on the CPU the array itself."""

    def __init__(self, array: Any) -> None:
        self._array = array
        self._host = _host_side(array)
        self._values: np.ndarray = self._host.numpy()
        self._sent = None if array.device.is_cpu else wp.Event(array.device)

    @property
    def values(self) -> np.ndarray:
        """To be written, and then sent. This waits until what was sent last has left."""
        if self._sent:
            wp.synchronize_event(self._sent)
        return self._values

    def send(self, rows: int) -> None:
        """Let the first rows of the values take their place in the device's queue; a graph may hold this.

        Whoever replays it says so by :meth:`sent`, or reads what it finds before the values are written again.
        """
        if self._sent:
            _copy_rows(self._array, self._host, rows)
            if not self._array.device.is_capturing:
                self.sent()

    def sent(self) -> None:
        """What was queued last is waited for before the values are written again."""
        if self._sent:
            self._array.device.stream.record_event(self._sent)  # the current device may be another one


class Download:
    """The host's side of a device's contiguous arrays that are read together, with one wait for all."""

    def __init__(self, arrays: Sequence[Any]) -> None:
        self._arrays = arrays
        self._host = [_host_side(array) for array in arrays]
        self._values: list[np.ndarray] = [host.numpy() for host in self._host]
        self._device = arrays[0].device

    def fetch(self, rows: int) -> None:
        """Let the first rows take their place in the device's queue; a graph may hold this."""
        if self._device.is_cuda:
            for host, array in zip(self._host, self._arrays, strict=True):
                _copy_rows(host, array, rows)

    def read(self, rows: int) -> list[np.ndarray]:
        """Wait, and give copies of the rows that were fetched."""
        if self._device.is_cuda:
            wp.synchronize_stream(self._device.stream)
        return [values[:rows].copy() for values in self._values]


class Replays:
    """On a GPU, captures work as a graph the second time it is done, and from then on replays that.

    The first time it is not captured, because it may load kernels and make arrays. Within a capture, and on the CPU, it
    is simply done.
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


def _host_side(array: Any) -> Any:
    return array if array.device.is_cpu else wp.zeros(array.shape, dtype=array.dtype, device="cpu", pinned=True)


def _copy_rows(to: Any, array: Any, rows: int) -> None:
    if rows and array.size:
        wp.copy(to, array, count=rows * array.size // array.shape[0])
