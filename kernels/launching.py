"""Launches that a CPU thread does again and again: their arguments are packed once.

To pack them takes Python some 60 us a launch, in which no other thread launches anything.
"""

import threading
from collections.abc import Callable, Hashable
from typing import Any

import warp as wp

_recorder = threading.local()  # its commands, in a thread that records


def launch(kernel: Any, dim: Any, inputs: list[Any], outputs: list[Any], *, device: Any, block_dim: int = 256) -> None:
    """As ``wp.launch``; a thread that records keeps the launch."""
    packed: list[Any] | None = getattr(_recorder, "commands", None)
    command = wp.launch(kernel, dim, inputs, outputs, device=device, block_dim=block_dim, record_cmd=packed is not None)
    if packed is not None and command is not None:
        packed.append(command)
        command.launch()


class Recordings:
    """Does work that is nothing but launches, and launches again what was packed; on a GPU, graphs do that."""

    def __init__(self) -> None:
        self._commands: dict[Hashable, list[Any]] = {}

    def run(self, kind: Hashable, device: Any, work: Callable[[], None]) -> None:
        """Do the work, which launches the same on the same arrays whenever its ``kind`` is the same."""
        if wp.get_device(device).is_cuda:
            work()
        elif kind in self._commands:
            for command in self._commands[kind]:
                command.launch()
        else:
            _recorder.commands = commands = []
            try:
                work()
            finally:
                _recorder.commands = None
            self._commands[kind] = commands
