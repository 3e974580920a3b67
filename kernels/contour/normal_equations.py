"""Sums of residuals and Jacobians: the normal equations of Gauss and Newton, in a fixed order.

With z a row and its residual behind, one triangle holds all: the sum of ``w z z^T`` is the matrix ``J^T W J``, below it
the gradient ``J^T W r``, and in the corner ``r^T W r``. Views are summed apart, so that there are blocks enough for a
GPU; who reads the sums adds the views in their order.
"""

import math

import warp as wp

from mmocap_warp.kernels.block import CPU_FLAGS, Batch, lanes_of, matrix_at, shared_words, sync
from mmocap_warp.kernels.contour.jacobian import Rows
from mmocap_warp.kernels.contour.outline import Outline
from mmocap_warp.kernels.contour.residuals import Residuals
from mmocap_warp.kernels.launching import launch
from mmocap_warp.kernels.native import native_sections

wp.set_module_options({"enable_backward": False, "cpu_compiler_flags": CPU_FLAGS})

_native = native_sections(__file__)


@wp.struct
class Sums:
    """Sums over the outline of each view."""

    triangle: wp.array[wp.float32]  # (candidate, camera, row, column up to the row) flat
    tally: wp.array2d[wp.vec4]  # (candidate, camera) see Residuals.tally


@wp.func
def triangle_words(width: int) -> int:
    """Elements of a triangle of so many rows."""
    return width * (width + 1) // 2


# ``sum += w z z^T`` for each row z with weight w: z is scaled by w once, and added to the triangle row by row. Rows
# without weight and zeros in a row, such as coordinates that do not move an edge, cost next to nothing.
@wp.func_native(_native("sum_serially"))
def _sum_serially(
    weighted: wp.array3d[wp.vec2],
    rows: wp.array[wp.float32],
    first: int,
    count: int,
    width: int,
    triangle: wp.array[wp.float32],
    at: int,
) -> None:
    """A row after the other, each added to the whole triangle: in plain C, because compilers turn it into vectors."""


# ``sum += w z z^T`` by the lanes of a GPU's block:
# 1. A lane finds its tile: tile number ``tile`` of the triangle in rows of tiles, two by two elements each. At the
#    triangle's end a tile hangs over its edge; its missing row or column repeats the last one and is not written.
# 2. Lanes copy as many rows z as the shared memory holds, and their weights; rows without weight become zeros.
# 3. Each lane goes through these rows and adds its four products, in the order of the rows: the sum is the same however
#    many lanes there are. Sums of each portion are added to the whole afterwards, which loses less by rounding.
# 4. Steps 2 and 3 are repeated until all rows are done. Then each lane writes its tile.
@wp.func_native(_native("sum_together"))
def _sum_together(
    weighted: wp.array3d[wp.vec2],
    rows: wp.array[wp.float32],
    words: wp.array[wp.uint32],
    first: int,
    count: int,
    width: int,
    triangle: wp.array[wp.float32],
    at: int,
    tile: int,
    lane: int,
    lanes: int,
) -> None:
    """As many rows as the block can share at a time; a lane has a tile of the triangle, two by two elements.

    Rows that do not count are zeros there, whatever they hold.
    """


@wp.kernel
def _sum_tallies(
    outline: Outline,
    residuals: Residuals,
    batch: Batch,
    lanes: int,
    # out
    sums: Sums,
) -> None:
    own, k, lane = wp.tid()
    c = batch.first + own
    shares = matrix_at(shared_words(batch.scratch), 0, lanes, 4)
    share = wp.vec4()
    for s in range(lane, outline.count[c, k], lanes):
        share += residuals.tally[c, k, s]
    for i in range(4):
        shares[lane, i] = share[i]
    sync()
    for i in range(lane, 4, lanes):
        total = float(0.0)
        for other in range(lanes):
            total += shares[other, i]
        sums.tally[c, k][i] = total


def sum_tallies(outline: Outline, residuals: Residuals, batch: Batch, sums: Sums) -> None:
    """Sum up what a batch's outlines cost."""
    device = outline.image.device
    lanes = lanes_of(device)
    dim = (batch.size, outline.count.shape[1], lanes)
    launch(_sum_tallies, dim, [outline, residuals, batch, lanes], [sums], block_dim=lanes, device=device)


@wp.kernel
def _sum_normal_equations(
    outline: Outline,
    residuals: Residuals,
    rows: Rows,
    batch: Batch,
    lanes: int,
    # out
    sums: Sums,
) -> None:
    own, k, thread = wp.tid()
    c = batch.first + own
    block = thread // lanes
    lane = thread - block * lanes
    view = c * outline.count.shape[1] + k
    count = outline.count[c, k]
    at = view * triangle_words(rows.width)
    words = shared_words(batch.scratch)
    first = view * outline.size
    if lanes == 1:
        for i in range(triangle_words(rows.width)):
            sums.triangle[at + i] = 0.0
        _sum_serially(residuals.weighted, rows.value, first, count, rows.width, sums.triangle, at)
    else:
        _sum_together(
            residuals.weighted, rows.value, words, first, count, rows.width, sums.triangle, at, thread, lane, lanes
        )


def sum_normal_equations(outline: Outline, residuals: Residuals, rows: Rows, batch: Batch, sums: Sums) -> None:
    """Sum up a batch's rows, with lanes enough for a candidate's view that each has one tile at most."""
    device = outline.image.device
    lanes = lanes_of(device)
    half = (rows.width + 1) // 2
    blocks = 1 if lanes == 1 else math.ceil(triangle_words(half) / lanes)
    dim = (batch.size, outline.count.shape[1], blocks * lanes)
    launch(_sum_normal_equations, dim, [outline, residuals, rows, batch, lanes], [sums], block_dim=lanes, device=device)
