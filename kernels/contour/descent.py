"""Damped Gauss-Newton steps on single frames, each candidate on its own (Levenberg and Marquardt).

A pose that costs less than the best so far is taken, and the damping falls; one that does not is left, the damping
rises, and the next step starts from the best again, shorter. What silhouettes do not see is held by a weak pull to
where the search began. Coordinates at a limit that the step would pass stay there.

The matrix is factored as ``L L^T`` with the gradient as one more row, which so becomes ``L^-1 gradient``; the step
then only takes the way back, through ``L^T``.
"""

import math

import warp as wp

from mmocap_warp.kernels.batch import Batch
from mmocap_warp.kernels.block import WORDS, lanes_of, matrix_at, shared_words, sync
from mmocap_warp.kernels.contour.normal_equations import Sums

wp.set_module_options({"enable_backward": False})

MOST_SEARCHED = math.isqrt(WORDS) - 1
"""Coordinates of a system that fits into what a block shares."""

_EASED = wp.constant(0.3)  # damping after a step that helped, as a share
_RAISED = wp.constant(6.0)  # after one that did not
_LEAST = wp.constant(1.0e-5)
_LONGEST = wp.constant(0.3)  # of a step in any coordinate [m, rad]: beyond it the outline is another


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
def _pull_cost(descent: Descent, c: int) -> float:
    cost = float(0.0)
    for d in range(descent.index.shape[0]):
        i = descent.index[d]
        away = descent.pose[c, i] - descent.start[c, i]
        cost += descent.pull[d] * away * away
    return cost


@wp.func
def _take_or_leave(sums: Sums, descent: Descent, c: int, lane: int, lanes: int) -> None:
    """Keep the pose that was judged if it costs less than the best one."""
    cameras = sums.tally.shape[1]
    cost = _pull_cost(descent, c)
    for k in range(cameras):
        cost += sums.tally[c, k][0]
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
def _set_up(descent: Descent, c: int, system: wp.array2d[wp.float32], lane: int, lanes: int) -> None:
    """The damped matrix and the gradient below it, with the pull; coordinates that a limit stops are left out."""
    n = descent.index.shape[0]
    for i in range(lane, n + 1, lanes):
        row = wp.where(i < n, i, descent.gradient)
        for j in range(wp.min(i + 1, n)):
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
    for i in range(lane, n + 1, lanes):
        for j in range(wp.min(i + 1, n)):
            left_out = system[j, n] > 0.0
            if i < n:
                left_out = left_out or system[i, n] > 0.0
            if left_out:
                system[i, j] = wp.where(i == j, 1.0, 0.0)
    sync()


@wp.func
def _factor(n: int, system: wp.array2d[wp.float32], lane: int, lanes: int) -> None:
    """Cholesky's L in place of the matrix; the row below becomes ``L^-1`` times what it was."""
    for p in range(n):
        pivot = wp.sqrt(wp.max(system[p, p], 1.0e-12))
        sync()
        for i in range(p + lane, n + 1, lanes):
            system[i, p] = wp.where(i == p, pivot, system[i, p] / pivot)
        sync()
        for i in range(p + 1 + lane, n + 1, lanes):
            factor = system[i, p]
            if factor != 0.0:
                for j in range(p + 1, wp.min(i + 1, n)):
                    system[i, j] -= factor * system[j, p]
        sync()


@wp.func
def _way_back(n: int, system: wp.array2d[wp.float32], lane: int, lanes: int) -> None:
    """The row below becomes the solution."""
    for back in range(n):
        p = n - 1 - back
        solved = system[n, p] / system[p, p]
        sync()
        for j in range(lane, p + 1, lanes):
            system[n, j] = wp.where(j == p, solved, system[n, j] - solved * system[p, j])
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
    _take_or_leave(sums, descent, c, lane, lanes)
    sync()
    if steps:
        n = descent.index.shape[0]
        system = matrix_at(shared_words(batch.scratch), 0, n + 1, n + 1)
        _set_up(descent, c, system, lane, lanes)
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
    wp.launch(
        _descend,
        dim=(batch.size, lanes),
        inputs=[sums, batch, lanes, steps],
        outputs=[descent],
        block_dim=lanes,
        device=device,
    )
