"""Damped Gauss-Newton steps on single frames, each candidate on its own (Levenberg and Marquardt).

A pose that costs less than the best so far is taken, and the damping falls; one that does not is left, the damping
rises, and the next step starts from the best again, shorter. What silhouettes do not see is held by a weak pull to
where the search began. Coordinates at a limit that the step would pass stay there.

The matrix is factored as ``L L^T`` with the gradient as one more row, which so becomes ``L^-1 gradient``; the step
then only takes the way back, through ``L^T``.
"""

import math

import warp as wp

from mmocap_warp.kernels.block import (
    WORDS,
    Batch,
    LaneLayout,
    lane_layout,
    lanes_of,
    matrix_at,
    shared_words,
    sync,
    sync_warp,
)
from mmocap_warp.kernels.contour.normal_equations import Sums
from mmocap_warp.kernels.launching import launch
from mmocap_warp.kernels.native import native_sections

wp.set_module_options({"enable_backward": False})

_native = native_sections(__file__)

MOST_SEARCHED = math.isqrt(WORDS) - 1
"""Coordinates of a system that fits into what a block shares."""

_EASED = wp.constant(0.3)  # factor of the damping after a step that helped
_RAISED = wp.constant(6.0)  # factor of the damping after a step that did not
_LEAST = wp.constant(1.0e-5)
_TILE = wp.constant(16)  # columns of the matrix that a GPU's lanes have side by side
_WARP = wp.constant(32)
_LONGEST = wp.constant(0.3)  # largest step of a coordinate [m, rad]: beyond it the outline has changed too much


@wp.struct
class Descent:
    """Where each candidate's search is, and what it may do."""

    index: wp.array[wp.int32]  # (dof,) the searched coordinates
    gradient: int  # row of the triangle that has the gradient: the last
    pull: wp.array[wp.float32]  # (dof,) one over the variance about the start
    limits: wp.array2d[wp.float32]  # (dof, 2) lowest and highest
    start: wp.array2d[wp.float32]  # (candidate, coordinate) what is pulled to
    pose: wp.array2d[wp.float32]  # (candidate, coordinate) that the sums are of, and then the next one
    best: wp.array2d[wp.float32]  # (candidate, coordinate)
    cost: wp.array[wp.float32]  # (candidate,) of the best; infinite before the first
    tally: wp.array2d[wp.vec4]  # (candidate, camera) of the best: see Residuals.tally
    damping: wp.array[wp.float32]  # (candidate,) share of the diagonal
    triangle: wp.array2d[wp.float32]  # (candidate, element) sums of the best over all views


@wp.func
def _cost_of(sums: Sums, descent: Descent, c: int, words: wp.array[wp.uint32], lane: int, lanes: int) -> float:
    """What the pose costs that was judged."""
    # Each lane reads coordinates of its own: one after the other they would be waited for one after the other.
    n = descent.index.shape[0]
    factors = matrix_at(words, 0, 2, n)
    for d in range(lane, n, lanes):
        i = descent.index[d]
        away = descent.pose[c, i] - descent.start[c, i]
        factors[0, d] = descent.pull[d] * away
        factors[1, d] = away
    sync()
    cost = float(0.0)
    for d in range(n):
        cost += factors[0, d] * factors[1, d]
    for k in range(sums.tally.shape[1]):
        cost += sums.tally[c, k][0]
    return cost


@wp.kernel
def _pass_over(
    sums: Sums,
    descent: Descent,
    batch: Batch,
    lanes: int,
    # out
    count: wp.array2d[wp.int32],  # (candidate, camera)
) -> None:
    own, lane = wp.tid()
    c = batch.first + own
    if not _cost_of(sums, descent, c, shared_words(batch.scratch), lane, lanes) < descent.cost[c]:
        for k in range(lane, count.shape[1], lanes):
            count[c, k] = 0


def pass_over(sums: Sums, batch: Batch, descent: Descent, count: wp.array[wp.int32]) -> None:
    """Empty the outlines (candidate, camera) of a batch's poses that will be left: nobody needs their derivatives."""
    device = descent.pose.device
    lanes = lanes_of(device)
    launch(_pass_over, (batch.size, lanes), [sums, descent, batch, lanes], [count], block_dim=lanes, device=device)


@wp.func
def _take_or_leave(sums: Sums, descent: Descent, c: int, words: wp.array[wp.uint32], lane: int, lanes: int) -> None:
    """Keep the pose that was judged if it costs less than the best one."""
    cameras = sums.tally.shape[1]
    cost = _cost_of(sums, descent, c, words, lane, lanes)
    better = cost < descent.cost[c]
    sync()
    if better:
        size = descent.triangle.shape[1]
        for i in range(lane, size, lanes):
            total = float(0.0)
            for k in range(cameras):
                total += sums.triangle[(c * cameras + k) * size + i]
            descent.triangle[c, i] = total
        for i in range(lane, descent.pose.shape[1], lanes):
            descent.best[c, i] = descent.pose[c, i]
        for k in range(lane, cameras, lanes):
            descent.tally[c, k] = sums.tally[c, k]
    if lane == 0:
        if better:
            descent.cost[c] = cost
        damping = descent.damping[c]
        descent.damping[c] = wp.where(better, wp.max(_EASED * damping, _LEAST), _RAISED * damping)


@wp.func
def _set_up(
    descent: Descent, c: int, system: wp.array2d[wp.float32], layout: LaneLayout, lane: int, lanes: int
) -> None:
    """The damped matrix and the gradient below it, with the pull; coordinates that a limit stops are left out."""
    n = descent.index.shape[0]
    for i in range(layout.row, n + 1, layout.row_step):
        row = wp.where(i < n, i, descent.gradient)
        for j in range(layout.column, wp.min(i + 1, n), layout.column_step):
            system[i, j] = descent.triangle[c, row * (row + 1) // 2 + j]
    sync()
    for i in range(lane, n, lanes):
        value = descent.best[c, descent.index[i]]
        system[i, i] = (system[i, i] + descent.pull[i]) * (1.0 + descent.damping[c])
        gradient = system[n, i] - descent.pull[i] * (value - descent.start[c, descent.index[i]])
        system[n, i] = gradient
        stopped = (value <= descent.limits[i, 0] and gradient < 0.0) or (
            value >= descent.limits[i, 1] and gradient > 0.0
        )
        system[i, n] = wp.where(stopped, 1.0, 0.0)
    sync()
    for i in range(layout.row, n + 1, layout.row_step):
        for j in range(layout.column, wp.min(i + 1, n), layout.column_step):
            left_out = system[j, n] > 0.0
            if i < n:
                left_out = left_out or system[i, n] > 0.0
            if left_out:
                system[i, j] = wp.where(i == j, 1.0, 0.0)
    sync()


@wp.func_native(_native("product"))
def _product(a: float, b: float) -> float:
    """Rounded before it is taken off anything, on a GPU as on the CPU."""


@wp.func
def _factor(n: int, system: wp.array2d[wp.float32], lane: int, lanes: int) -> None:
    """Cholesky's L in place of the matrix; the row below becomes ``L^-1`` times what it was.

    A lane for each row takes all earlier columns off an element at once, in the same order on a CPU as on a GPU. To
    write all elements again after each column took a GPU four times as long. The diagonal goes into the last column.
    """
    for p in range(n):
        for i in range(p + lane, n + 1, lanes):
            rest = system[i, p]
            for q in range(p):
                rest -= _product(system[i, q], system[p, q])
            system[i, p] = rest
        sync()
        pivot = wp.sqrt(wp.max(system[p, p], 1.0e-12))
        for i in range(p + 1 + lane, n + 1, lanes):
            system[i, p] = system[i, p] / pivot
        if lane == 0:
            system[p, n] = pivot
        sync()


@wp.func
def _way_back(n: int, system: wp.array2d[wp.float32], lane: int, lanes: int) -> None:
    """The row below becomes the solution; one warp does it, whose lanes need not wait for the whole block."""
    if lane < _WARP:
        for back in range(n):
            p = n - 1 - back
            solved = system[n, p] / system[p, n]
            sync_warp()
            for j in range(lane, p + 1, wp.min(lanes, _WARP)):
                system[n, j] = wp.where(j == p, solved, system[n, j] - solved * system[p, j])
            sync_warp()
    sync()


@wp.kernel
def _descend(
    sums: Sums,
    batch: Batch,
    lanes: int,
    steps: bool,
    # in and out
    descent: Descent,
) -> None:
    own, lane = wp.tid()
    c = batch.first + own
    words = shared_words(batch.scratch)
    _take_or_leave(sums, descent, c, words, lane, lanes)
    sync()
    if steps:
        n = descent.index.shape[0]
        system = matrix_at(words, 0, n + 1, n + 1 + n % 2)  # an odd length of rows puts a column into all banks
        layout = lane_layout(lane, lanes, _TILE)
        _set_up(descent, c, system, layout, lane, lanes)
        _factor(n, system, lane, lanes)
        _way_back(n, system, lane, lanes)
        longest = float(0.0)
        for i in range(n):
            longest = wp.max(longest, wp.abs(system[n, i]))
        share = wp.min(1.0, _LONGEST / wp.max(longest, 1.0e-9))
        for i in range(lane, n, lanes):
            moved = descent.best[c, descent.index[i]] + share * system[n, i]
            descent.pose[c, descent.index[i]] = wp.clamp(moved, descent.limits[i, 0], descent.limits[i, 1])


def descend(sums: Sums, batch: Batch, descent: Descent, steps: bool) -> None:
    """Take a batch's judged poses or leave them, and where ``steps``, go on to the next: a block of lanes each.

    There may be up to ``MOST_SEARCHED`` searched coordinates.
    """
    device = descent.pose.device
    lanes = lanes_of(device)
    launch(_descend, (batch.size, lanes), [sums, batch, lanes, steps], [descent], block_dim=lanes, device=device)
