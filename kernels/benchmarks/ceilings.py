"""What the machine could do: bytes a second of a copy, operations a second of multiply-adds."""

from functools import partial

import numpy as np
import warp as wp

from mmocap_warp.kernels.benchmarks.case import Case, Check

wp.set_module_options({"enable_backward": False, "cpu_compiler_flags": "-march=native"})

GROUP = "ceilings"
_COPIED = 2**24  # vec4: 256 MB, more than caches hold
_THREADS = {"cpu": 2**12, "cuda": 2**20}
_OPERATIONS = 2 * 4 * 32 * 1024  # multiplications and additions of a thread
_STEPS = wp.constant(1024)
_Numbers = wp.types.vector(length=32, dtype=wp.float32)
_RAMP = wp.constant(_Numbers(*range(32)))


@wp.kernel
def _copy(
    source: wp.array[wp.vec4],  # (number,)
    # out
    copied: wp.array[wp.vec4],  # (number,)
):
    i = wp.tid()
    copied[i] = source[i]


def copy(source, copied):
    """``copied = source``, four numbers at a time."""
    wp.launch(_copy, dim=source.shape, inputs=[source], outputs=[copied], device=source.device)


@wp.kernel
def _multiply_add(
    start: wp.array[wp.float32],  # (thread,)
    # out
    total: wp.array[wp.float32],  # (thread,)
):
    i = wp.tid()
    # Numbers that all differ, or the compiler works on one of them; four rows of them, so that none waits for itself.
    a = _RAMP * start[i]
    b = a + a
    c = b + a
    d = c + a
    one = _Numbers(1.0)
    for _step in range(_STEPS):
        a = a * 0.5 + one
        b = b * 0.5 + one
        c = c * 0.5 + one
        d = d * 0.5 + one
    total[i] = wp.dot(a + b + c + d, one)


def multiply_add(start, total):
    """A long row of ``x = x / 2 + 1`` on 128 numbers a thread: each of them ends at 2, and ``total`` at 256."""
    wp.launch(_multiply_add, dim=start.shape, inputs=[start], outputs=[total], device=start.device)


def ceilings(device: str) -> list[list[Case]]:
    """Both kernels; ``sizes`` has the bytes, read and written, or the operations of a call. A CPU uses one thread."""
    source = wp.full(_COPIED, wp.vec4(1.0, 2.0, 3.0, 4.0), dtype=wp.vec4, device=device)
    copied = wp.zeros_like(source)
    threads = _THREADS["cpu" if wp.get_device(device).is_cpu else "cuda"]
    start = wp.ones(threads, dtype=wp.float32, device=device)
    total = wp.zeros_like(start)

    def is_copied() -> Check:
        same = bool(np.array_equal(source.numpy(), copied.numpy()))
        return Check("the copy is the same" if same else "the copy differs", same)

    def is_total() -> Check:
        apart = float(np.abs(total.numpy() - 256.0).max())
        return Check(f"sums are {apart:.1g} off 256", apart < 1e-3)

    bytes_moved = {"bytes": 2 * source.capacity}
    operations = {"operations": threads * _OPERATIONS}
    return [
        [Case(GROUP, "copy", bytes_moved, partial(copy, source, copied), is_copied)],
        [Case(GROUP, "multiply-add", operations, partial(multiply_add, start, total), is_total)],
    ]
