"""Threads that launch a kernel at once load its module once."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import warp as wp

import mmocap_warp.kernels  # noqa: F401


@wp.kernel(module="unique")
def _count(
    # out
    number: wp.array[int],
) -> None:
    number[wp.tid()] = wp.tid()


def test_two_threads_load_a_module_once(monkeypatch):
    module, loads = wp.Module, []
    compiled = module._compile

    def slow(self, *arguments, **named):
        loads.append(self.name)
        time.sleep(0.1)  # until the other thread wants it too
        return compiled(self, *arguments, **named)

    monkeypatch.setattr(module, "_compile", slow)
    together = threading.Barrier(2)

    def launch(_):
        number = wp.zeros(8, dtype=int, device="cpu")
        together.wait()
        wp.launch(_count, 8, outputs=[number], device="cpu")
        return number.numpy()

    with ThreadPoolExecutor(2) as pool:
        for number in pool.map(launch, range(2)):
            np.testing.assert_array_equal(number, range(8))
    assert len(loads) == 1
