"""Sums of residuals and Jacobians: the normal equations of Gauss and Newton, in a fixed order.

With z a row and its residual behind, one triangle holds all: the sum of ``w z z^T`` is the matrix ``J^T W J``, below it
the gradient ``J^T W r``, and in the corner ``r^T W r``. Views are summed apart, so that there are blocks enough for a
GPU; who reads the sums adds the views in their order.
"""

import math

import warp as wp

from mmocap_warp.kernels.batch import Batch
from mmocap_warp.kernels.block import CPU_FLAGS, lanes_of, matrix_at, shared_words, sync
from mmocap_warp.kernels.contour.jacobian import Rows
from mmocap_warp.kernels.contour.outline import Outline
from mmocap_warp.kernels.contour.residuals import Residuals

wp.set_module_options({"enable_backward": False, "cpu_compiler_flags": CPU_FLAGS})


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


# ``sum += w z z^T`` by the lanes of a GPU's block:
# 1. A lane finds its tile: tile number ``tile`` of the triangle in rows of tiles, two by two elements each. At the
#    triangle's end a tile hangs over its edge; its missing row or column repeats the last one and is not written.
# 2. Lanes copy as many rows z as the shared memory holds, and their weights; rows without weight become zeros.
# 3. Each lane goes through these rows and adds its four products, in the order of the rows: the sum is the same however
#    many lanes there are. Sums of each portion are added to the whole afterwards, which loses less by rounding.
# 4. Steps 2 and 3 are repeated until all rows are done. Then each lane writes its tile.
@wp.func_native("""
#if defined(__CUDA_ARCH__)
    // 40 KB hold so many rows at a time, and their weights behind them.
    const int most = words.shape[0] / (width + 1);
    float* row = (float*)words.data;
    float* weight = row + most * width;
    const float* from = rows.data + (size_t)first * width;
    int down = 0;
    while ((down + 1) * (down + 2) / 2 <= tile) ++down;
    const int i = 2 * down, j = 2 * (tile - down * (down + 1) / 2);
    const bool mine = i < width;
    const int below = i + 1 < width ? i + 1 : i, beside = j + 1 < width ? j + 1 : j;
    float sum00 = 0.0f, sum01 = 0.0f, sum10 = 0.0f, sum11 = 0.0f;
    for (int begin = 0; begin < count; begin += most) {
        const int held = count - begin < most ? count - begin : most;
        __syncthreads();
        for (int r = lane; r < held; r += lanes) weight[r] = __ldg(&weighted.data[first + begin + r][1]);
        __syncthreads();
        #pragma unroll 8
        for (int w = lane; w < held * width; w += lanes) {
            const float value = __ldg(from + (size_t)begin * width + w);
            row[w] = weight[w / width] > 0.0f ? value : 0.0f;
        }
        __syncthreads();
        if (!mine) continue;
        float total00 = 0.0f, total01 = 0.0f, total10 = 0.0f, total11 = 0.0f;
        #pragma unroll 4
        for (int r = 0; r < held; ++r) {
            const float* z = row + r * width;
            const float upper = weight[r] * z[i], lower = weight[r] * z[below], left = z[j], right = z[beside];
            total00 += upper * left;
            total01 += upper * right;
            total10 += lower * left;
            total11 += lower * right;
        }
        sum00 += total00;
        sum01 += total01;
        sum10 += total10;
        sum11 += total11;
    }
    if (!mine) return;
    float* to = triangle.data + at + i * (i + 1) / 2;
    to[j] = sum00;
    if (j < beside && beside <= i) to[beside] = sum01;
    if (i == below) return;
    to += i + 1;  // the next row
    to[j] = sum10;
    if (j < beside) to[beside] = sum11;
#endif
""")
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
    ...


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
    sync()
    if block == 0:
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
    """Sum up a batch's rows and tallies, with lanes enough for a candidate's view that each has one tile at most."""
    device = outline.image.device
    lanes = lanes_of(device)
    half = (rows.width + 1) // 2
    blocks = 1 if lanes == 1 else math.ceil(triangle_words(half) / lanes)
    wp.launch(
        _sum_normal_equations,
        dim=(batch.size, outline.count.shape[1], blocks * lanes),
        inputs=[outline, residuals, rows, batch, lanes],
        outputs=[sums],
        block_dim=lanes,
        device=device,
    )
