"""Sums of residuals and Jacobians: the normal equations of Gauss and Newton, in a fixed order.

With z a row and its residual behind, one triangle holds all: the sum of ``w z z^T`` is the matrix ``J^T W J``, below it
the gradient ``J^T W r``, and in the corner ``r^T W r``. Views are summed apart, so that there are blocks enough for a
GPU; who reads the sums adds the views in their order.
"""

import warp as wp

from mmocap_warp.kernels.batch import Batch
from mmocap_warp.kernels.block import CPU_FLAGS, WORDS, lane_layout, lanes_of, matrix_at, shared_words, sync
from mmocap_warp.kernels.contour.jacobian import Rows
from mmocap_warp.kernels.contour.outline import Outline
from mmocap_warp.kernels.contour.residuals import Residuals

wp.set_module_options({"enable_backward": False, "cpu_compiler_flags": CPU_FLAGS})

_WORDS = wp.constant(WORDS)


@wp.struct
class Sums:
    """Sums over the outline of each view."""

    triangle: wp.array[wp.float32]  # (candidate, camera, row, column up to the row) flat
    tally: wp.array2d[wp.vec4]  # (candidate, camera) see Residuals.tally


@wp.func
def triangle_words(width: int) -> int:
    """Elements of a triangle of so many rows."""
    return width * (width + 1) // 2


@wp.func_native("""
    for (int s = 0; s < count; ++s) {
        const float weight = weighted.data[first + s][1];
        if (!(weight > 0.0f)) continue;
        const float* z = rows.data + (size_t)(first + s) * width;
        float* sum = triangle.data + at;
        for (int i = 0; i < width; sum += ++i) {
            const float scaled = weight * z[i];
            if (scaled == 0.0f) continue;
            for (int j = 0; j <= i; ++j) sum[j] += scaled * z[j];
        }
    }
""")
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
    ...


@wp.func
def _sum_together(
    residuals: Residuals,
    rows: Rows,
    words: wp.array[wp.uint32],
    c: int,
    k: int,
    first: int,
    count: int,
    triangle: wp.array[wp.float32],
    at: int,
    lane: int,
    lanes: int,
) -> None:
    """As many rows as the block can share at a time; a lane has elements of the triangle of its own."""
    width = rows.width
    layout = lane_layout(lane, lanes, width)
    most = _WORDS // (width + 1)
    shared = matrix_at(words, 0, most, width + 1)  # the row, and its weight behind
    for begin in range(0, count, most):
        held = wp.min(most, count - begin)
        sync()
        for i in range(lane, held * (width + 1), lanes):
            r = i // (width + 1)
            column = i - r * (width + 1)
            weight = residuals.weighted[c, k, begin + r][1]
            value = float(0.0)
            if weight > 0.0:
                value = weight
                if column < width:
                    value = rows.value[(first + begin + r) * width + column]
            shared[r, column] = value
        sync()
        for i in range(layout.row, width, layout.row_step):
            for j in range(layout.column, i + 1, layout.column_step):
                total = float(0.0)
                for r in range(held):
                    total += shared[r, width] * shared[r, i] * shared[r, j]
                triangle[at + i * (i + 1) // 2 + j] += total


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
    own, k, lane = wp.tid()
    c = batch.first + own
    view = c * outline.count.shape[1] + k
    count = outline.count[c, k]
    at = view * triangle_words(rows.width)
    for i in range(lane, triangle_words(rows.width), lanes):
        sums.triangle[at + i] = 0.0
    sync()
    words = shared_words(batch.scratch)
    if lanes == 1:
        _sum_serially(residuals.weighted, rows.value, view * outline.size, count, rows.width, sums.triangle, at)
    else:
        _sum_together(residuals, rows, words, c, k, view * outline.size, count, sums.triangle, at, lane, lanes)
    sync()
    shares = matrix_at(words, 0, lanes, 4)
    share = wp.vec4()
    for s in range(lane, count, lanes):
        share += residuals.tally[c, k, s]
    for i in range(4):
        shares[lane, i] = share[i]
    sync()
    for i in range(lane, 4, lanes):
        total = float(0.0)
        for other in range(lanes):
            total += shares[other, i]
        sums.tally[c, k][i] = total


def sum_normal_equations(outline: Outline, residuals: Residuals, rows: Rows, batch: Batch, sums: Sums) -> None:
    """Sum up a batch's rows and tallies, a block of lanes for each candidate's view."""
    device = outline.image.device
    lanes = lanes_of(device)
    wp.launch(
        _sum_normal_equations,
        dim=(batch.size, outline.count.shape[1], lanes),
        inputs=[outline, residuals, rows, batch, lanes],
        outputs=[sums],
        block_dim=lanes,
        device=device,
    )
