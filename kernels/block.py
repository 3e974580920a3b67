"""Threads that work together: on a GPU a block of them shares fast memory, on the CPU a block is one thread.

Kernels written with these functions run on both: a loop ``range(lane, n, lanes)`` spreads over a block's lanes. On the
CPU threads share the candidates of an evaluation instead, a launch of a ``Batch`` each.
"""

import warp as wp

from mmocap_warp.kernels.native import native_sections
from mmocap_warp.kernels.structs import filled

wp.set_module_options({"enable_backward": False})

_native = native_sections(__file__)

LANES = 256
"""Threads of a GPU block."""

CPU_FLAGS = "-march=native -mllvm=-inline-threshold=9000 -fno-slp-vectorize"
"""For kernels that draw: packing their short chains of integers into vectors cost ``raster`` a quarter."""

WORDS = 10240
"""32-bit words that a block shares."""

NUMBERS = 8
"""Counters that a block shares beside them."""

VIEW_LANES = 1024
"""Threads of a GPU that share a view's contour edges, in blocks that share nothing."""

_MOST_BLOCKS = 8  # most blocks that share a view: each of them projects the whole body


def lanes_of(device: wp.Device, lanes: int = LANES) -> int:
    """Lanes of a block on a device, as many as said on a GPU."""
    return 1 if device.is_cpu else lanes


def blocks_of(device: wp.Device, views: int) -> int:
    """Blocks that should share a view when there are so many: enough for two on each of a GPU's multiprocessors."""
    return 1 if device.is_cpu else max(1, min(_MOST_BLOCKS, 2 * device.sm_count // views))


def scratch(device: wp.DeviceLike) -> wp.array[wp.uint32]:
    """What stands for a block's shared memory on the CPU; each thread that launches kernels needs its own."""
    return wp.empty(WORDS + NUMBERS if wp.get_device(device).is_cpu else 1, dtype=wp.uint32, device=device)


@wp.func_native(_native("sync"))
def sync() -> None:
    """Wait for the block's lanes; what they wrote is then seen by all of them."""


@wp.func_native(_native("sync_warp"))
def sync_warp() -> None:
    """Wait for the 32 lanes of a warp; all of them must call."""


@wp.func_native(_native("words", WORDS=WORDS))
def _words(scratch: wp.array[wp.uint32]) -> wp.uint64:
    """The address of a block's shared words; on the CPU they lie in the scratch array."""


@wp.func_native(_native("numbers", NUMBERS=NUMBERS, WORDS=WORDS))
def _numbers(scratch: wp.array[wp.uint32]) -> wp.uint64:
    """The address of a block's shared numbers; on the CPU they lie behind the words."""


@wp.func
def shared_words(scratch: wp.array[wp.uint32]) -> wp.array[wp.uint32]:
    """The block's shared words, (WORDS,) uint32."""
    return wp.array(ptr=_words(scratch), shape=(WORDS,), dtype=wp.uint32)


@wp.func
def shared_numbers(scratch: wp.array[wp.uint32]) -> wp.array[wp.int32]:
    """The block's shared counters, (NUMBERS,) int32."""
    return wp.array(ptr=_numbers(scratch), shape=(NUMBERS,), dtype=wp.int32)


@wp.func_native(_native("warp_sum"))
def warp_sum(value: int) -> int:
    """Sum over the 32 lanes of a warp; all of them must call."""


@wp.func_native(_native("warp_max"))
def warp_max(value: int) -> int:
    """Largest over the 32 lanes of a warp; all of them must call."""


@wp.func_native("return (wp::uint64)(words.data + first);")
def _address(words: wp.array[wp.uint32], first: int) -> wp.uint64:
    """The address of a word."""


@wp.func
def matrix_at(words: wp.array[wp.uint32], first: int, rows: int, columns: int) -> wp.array2d[wp.float32]:
    """A (rows, columns) float32 matrix in an array of words, the shared ones or others, from word ``first`` on."""
    return wp.array(ptr=_address(words, first), shape=(rows, columns), dtype=wp.float32)


@wp.struct
class LaneLayout:
    """A lane's elements of a matrix: every ``row_step``-th row from ``row`` on, and so the columns."""

    row: int
    row_step: int
    column: int
    column_step: int


@wp.func
def lane_layout(lane: int, lanes: int, columns: int) -> LaneLayout:
    """Lay lanes over a matrix in rows as wide as its own; a lane that is left over gets a column beyond the last."""
    layout = LaneLayout()
    layout.column_step = wp.min(lanes, columns)
    layout.row_step = lanes // layout.column_step
    layout.row = lane // layout.column_step
    layout.column = wp.where(layout.row < layout.row_step, lane - layout.row * layout.column_step, columns)
    return layout


@wp.struct
class Batch:
    """Candidates ``first .. first + size - 1`` of the ``total`` that are evaluated, and what their launch works in."""

    first: int
    size: int
    total: int
    scratch: wp.array[wp.uint32]  # see :func:`scratch`


def batch_of(first: int, end: int, total: int, device: wp.DeviceLike) -> Batch:
    """Candidates ``first .. end - 1`` of ``total``, for a thread of their own."""
    return filled(Batch, first=first, size=end - first, total=total, scratch=scratch(device))


@wp.func
def run_of(c: int, batch: Batch, runs: int) -> int:
    """The run of a candidate, where ``runs`` share all candidates evenly, one after the other; -1 if there are none."""
    if runs == 0:
        return -1
    return wp.min(c // wp.max(batch.total // runs, 1), runs - 1)
