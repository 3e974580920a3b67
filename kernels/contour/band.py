"""A clip's damped step: a symmetric matrix whose blocks couple a frame with the next two, put together and solved.

Two frames make a block, so that a block is coupled with its neighbours only. Every other block is eliminated, then
every other one of those that remain, until one is left (cyclic reduction): blocks of one round do not wait for each
other. All is summed in a fixed order and in double precision.
"""

from typing import Any

import warp as wp

from mmocap_warp.kernels.block import lanes_of, sync

wp.set_module_options({"enable_backward": False})

_POINT_ROWS = wp.constant(12)  # rows of a joint's four points
_ROWS_A_THREAD = wp.constant(3)


@wp.struct
class Course:
    """How a body's points move in consecutive frames, of which the first are held."""

    coordinate: wp.array[wp.int32]  # (dof,) the searched coordinates
    below: wp.array2d[wp.int32]  # (joint, joint) 1 where a joint carries another one, or is it
    slides: wp.array[wp.int32]  # (joint,) 1 where it slides along its axes
    point: wp.array2d[wp.vec3d]  # (frame, point) four of each joint [m]
    axes: wp.array2d[wp.mat33d]  # (frame, joint) in the rows: what its angles turn about
    weight: wp.array3d[wp.float64]  # (frame, frames apart, joint) of the penalty, by the earlier of two frames
    pull: wp.array2d[wp.float64]  # (frame, row) the direction in which the penalty falls
    slope: wp.array3d[wp.float64]  # (frame, row, dof) half the points' derivatives, three rows each


@wp.struct
class Band:
    """The system of the frames that are not held, and its solution."""

    own: wp.array3d[wp.float64]  # (frame, dof, dof) what each frame by itself adds
    right: wp.array2d[wp.float64]  # (frame, dof) and on the right hand
    # (block, column, row): column c of a block has its own rows, those of the blocks before and after that it is still
    # coupled with, and the right hand; once it is eliminated, these multiplied by the inverse of its factor
    panel: wp.array3d[wp.float64]
    solution: wp.array2d[wp.float64]  # (block, column)
    # (block, row, column) what is left of a block's covariance once its neighbours are known, as a product with its
    # transpose; how the block follows that before and that after; and its solution where these are zero
    given: wp.array3d[wp.float64]
    covariance: wp.array3d[wp.float64]  # (block, row, column) of a block with itself, that before and that after


@wp.kernel
def _differentiate_points(
    # in and out
    course: Course,
) -> None:
    f, p, d = wp.tid()
    j = p // 4
    c = course.coordinate[d]
    slope = wp.vec3d()
    if c < 3:
        slope[c] = wp.float64(1.0)
    else:
        joint = (c - 3) // 3
        if course.below[joint, j] > 0:
            slope = course.axes[f, joint][(c - 3) % 3]
            if course.slides[joint] == 0:
                slope = wp.cross(slope, course.point[f, p] - course.point[f, 4 * joint])
    for i in range(_ROWS_A_THREAD):
        course.slope[f, 3 * p + i, d] = wp.float64(0.5) * slope[i]  # a joint's error is the mean over its four points


@wp.kernel
def _put_together(
    course: Course,
    held: int,
    frames: int,
    # in and out
    band: Band,
) -> None:
    i, column, row = wp.tid()
    size = band.panel.shape[1]
    n = size // 2
    f = 2 * i + column // n
    a = column % n
    part = row // size  # the block itself, the one before, the one after, the right hand
    at = row % size
    other = 2 * (i + wp.where(part == 2, 1, -part)) + at // n
    total = wp.float64(0.0)
    if f < frames and part == 3:
        total = band.right[f, a]
        for r in range(course.slope.shape[1]):
            total += course.slope[held + f, r, a] * course.pull[held + f, r]
    elif f < frames and other >= 0 and other < frames:
        b = at % n
        apart = wp.abs(f - other)
        if apart == 0:
            total = band.own[f, a, b]
        if apart <= 2:
            first = held + wp.min(f, other)
            for r in range(course.slope.shape[1]):
                weighted = course.weight[first, apart, r // _POINT_ROWS] * course.slope[held + other, r, b]
                total += course.slope[held + f, r, a] * weighted
    elif f >= frames and part == 0 and at == column:
        total = wp.float64(1.0)  # the last block may have one frame
    band.panel[i, column, row] = total


@wp.kernel
def _eliminate(
    first: int,
    apart: int,
    lanes: int,
    # in and out
    band: Band,
) -> None:
    own, lane = wp.tid()
    i = first + 2 * apart * own
    rows = band.panel.shape[2]
    for p in range(band.panel.shape[1]):
        for row in range(p + lane, rows, lanes):
            rest = band.panel[i, p, row]
            for q in range(p):
                rest -= band.panel[i, q, row] * band.panel[i, q, p]
            band.panel[i, p, row] = rest
        sync()
        pivot = wp.sqrt(band.panel[i, p, p])  # which stays as it is, squared
        for row in range(p + 1 + lane, rows, lanes):
            band.panel[i, p, row] = band.panel[i, p, row] / pivot
        sync()


@wp.kernel
def _take_off(
    apart: int,
    blocks: int,
    # in and out
    band: Band,
) -> None:
    own, column, row = wp.tid()
    i = 2 * apart * own
    size = band.panel.shape[1]
    part = row // size
    total = wp.float64(0.0)
    if part == 0 or part == 3:
        total = band.panel[i, column, row]
    for side in range(2):
        other = i + (2 * side - 1) * apart
        if other >= 0 and other < blocks and (part == 0 or part == 1 + side or part == 3):
            mine = (2 - side) * size  # where that block has its rows of this one
            theirs = wp.where(part == 0, mine + row, row)
            for p in range(size):
                total -= band.panel[other, p, mine + column] * band.panel[other, p, theirs]
    band.panel[i, column, row] = total


@wp.kernel
def _condition(
    lanes: int,
    # in and out
    band: Band,
) -> None:
    i, lane = wp.tid()
    size = band.panel.shape[1]
    for column in range(lane, 3 * size + 1, lanes):
        for back in range(size):
            p = size - 1 - back
            rest = wp.where(column == p, wp.float64(1.0), wp.float64(0.0))
            if column >= size:
                rest = wp.where(column < 3 * size, -band.panel[i, p, column], band.panel[i, p, column])
            for q in range(p + 1, size):
                rest -= band.panel[i, p, q] * band.given[i, q, column]
            band.given[i, p, column] = rest / wp.sqrt(band.panel[i, p, p])


@wp.kernel
def _follow(
    first: int,
    apart: int,
    blocks: int,
    # in and out
    band: Band,
) -> None:
    own, row = wp.tid()
    i = first + 2 * apart * own
    size = band.panel.shape[1]
    total = band.given[i, row, 3 * size]
    for side in range(2):
        other = i + (2 * side - 1) * apart
        if other >= 0 and other < blocks:
            for q in range(size):
                total += band.given[i, row, (1 + side) * size + q] * band.solution[other, q]
    band.solution[i, row] = total


@wp.func
def _of_neighbours(band: Band, left: int, right: int, apart: int, row: int, column: int) -> wp.float64:
    """Of the covariance of two blocks, one after the other; the one of them that was eliminated first has it."""
    size = band.panel.shape[1]
    if (row < size) == (column < size):
        return band.covariance[wp.where(row < size, left, right), row % size, column % size]
    before = wp.min(row, column)
    after = wp.max(row, column) - size
    if (left // apart) % 2 == 1:
        return band.covariance[left, before, 2 * size + after]
    return band.covariance[right, after, size + before]


@wp.kernel
def _join_neighbours(
    first: int,
    apart: int,
    blocks: int,
    # in and out
    band: Band,
) -> None:
    own, row, column = wp.tid()
    i = first + 2 * apart * own
    size = band.panel.shape[1]
    total = wp.float64(0.0)
    for q in range(2 * size):
        other = i + wp.where(q < size, -apart, apart)
        if other < blocks and (column < size or i + apart < blocks):
            shared = _of_neighbours(band, i - apart, i + apart, 2 * apart, q, column)
            total += band.given[i, row, size + q] * shared
    band.covariance[i, row, size + column] = total


@wp.kernel
def _join_own(
    first: int,
    apart: int,
    blocks: int,
    # in and out
    band: Band,
) -> None:
    own, row, column = wp.tid()
    i = first + 2 * apart * own
    size = band.panel.shape[1]
    total = wp.float64(0.0)
    for q in range(size):
        total += band.given[i, row, q] * band.given[i, column, q]
    for side in range(2):
        other = i + (2 * side - 1) * apart
        if other >= 0 and other < blocks:
            for q in range((1 + side) * size, (2 + side) * size):
                total += band.covariance[i, row, q] * band.given[i, column, q]
    band.covariance[i, row, column] = total
    n = size // 2
    f = 2 * i + row // n
    if row // n == column // n and f < band.own.shape[0]:
        band.own[f, row % n, column % n] = total


def _launch(kernel: Any, dim: tuple[int, ...], inputs: list[int], band: Any) -> None:
    """Inputs end with lanes where a block of them works on each of ``dim``."""
    wp.launch(kernel, dim, inputs, [band], block_dim=lanes_of(band.panel.device), device=band.panel.device)


def put_together(course: Any, held: int, frames: int, band: Any) -> None:
    """The matrix ``sum_r slope^T weight slope + own`` of frames behind those that are held, and its right hand."""
    device, blocks = band.panel.device, (frames + 1) // 2
    points = (held + frames, course.point.shape[1], course.coordinate.shape[0])
    wp.launch(_differentiate_points, points, [], [course], device=device)
    wp.launch(_put_together, (blocks, *band.panel.shape[1:]), [course, held, frames], [band], device=device)


def _rounds(frames: int) -> list[tuple[int, int, int]]:
    """Of the blocks that each round eliminates the first, how far apart they are coupled, and how many there are."""
    rounds, apart, blocks = [], 1, (frames + 1) // 2
    while apart < blocks:
        rounds.append((apart, apart, (blocks - 1 - apart) // (2 * apart) + 1))
        apart *= 2
    return [*rounds, (0, blocks, 1)]


def factor(frames: int, band: Any) -> None:
    """Eliminate the blocks of a band of so many frames; NaN where the matrix is not positive definite."""
    blocks, lanes = (frames + 1) // 2, lanes_of(band.panel.device)
    for first, apart, gone in _rounds(frames):
        _launch(_eliminate, (gone, lanes), [first, apart, lanes], band)
        if first:
            remain = (blocks - 1) // (2 * apart) + 1
            _launch(_take_off, (remain, *band.panel.shape[1:]), [apart, blocks], band)
    _launch(_condition, (blocks, lanes), [lanes], band)


def solve(frames: int, band: Any) -> None:
    """Fill the solution of a band that is factored."""
    for first, apart, gone in reversed(_rounds(frames)):
        _launch(_follow, (gone, band.panel.shape[1]), [first, apart, (frames + 1) // 2], band)


def invert(frames: int, band: Any) -> None:
    """Put the inverse's blocks (frame, dof, dof) on the diagonal into ``own``, of a band that is factored.

    Going back, a block's part of the inverse follows from those of its neighbours (Takahashi, Fagan and Chin, 1973).
    """
    size = band.panel.shape[1]
    for first, apart, gone in reversed(_rounds(frames)):
        inputs = [first, apart, (frames + 1) // 2]
        if first:
            _launch(_join_neighbours, (gone, size, 2 * size), inputs, band)
        _launch(_join_own, (gone, size, size), inputs, band)
