"""What masks show beside a posed body, and where the other masks agree that something is.

On the CPU, in double precision: there is little of it, and it is wanted where the host decides.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Sight:
    """What each view sees."""

    word: wp.array3d[wp.uint32]  # (camera, row, word) masks, 32 pixels a word
    possible: wp.array3d[wp.uint32]  # (camera, row, word) these, and what may be in front of them
    size: wp.array[wp.vec2i]  # (camera,) width and height [px]
    turn: wp.array[wp.mat33d]  # (camera,) from the world to pixels times depth
    shift: wp.array[wp.vec3d]  # (camera,)
    origin: wp.array[wp.vec3d]  # (camera,) where its rays begin [m]
    into_world: wp.array[wp.mat33d]  # (camera,) from pixels to a ray's direction, for a metre of depth


@wp.func
def _shows(sight: Sight, k: int, column: int, row: int) -> bool:
    return (sight.possible[k, row, column // 32] >> wp.uint32(column % 32)) & wp.uint32(1) != wp.uint32(0)


@wp.func
def _is_near(mark: wp.array[wp.uint8], first: int, last: int, at: int, columns: int, reach: wp.array[wp.int32]) -> bool:
    """Whether a point of the skin lies in a disc of cells around one; rows near the middle are looked at first."""
    column = at % columns
    for dy in range(reach.shape[0]):
        for side in range(2):
            middle = at + (1 - 2 * side) * dy * columns
            if reach[dy] >= 0 and middle >= 0 and first + middle < last:
                for i in range(
                    middle - wp.min(reach[dy], column), middle + wp.min(reach[dy], columns - 1 - column) + 1
                ):
                    if mark[first + i] != wp.uint8(0):
                        return True
    return False


@wp.func
def _set(
    mark: wp.array[wp.uint8], first: int, skin: wp.array[wp.vec2d], apart: int, columns: int, rows: int, value: int
) -> None:
    """Set the marks of the cells that points of an image are in."""
    for i in range(skin.shape[0]):
        x = wp.rint(skin[i][0] / wp.float64(apart))
        y = wp.rint(skin[i][1] / wp.float64(apart))
        if x >= wp.float64(0.0) and y >= wp.float64(0.0) and x < wp.float64(columns) and y < wp.float64(rows):
            mark[first + int(y) * columns + int(x)] = wp.uint8(value)


@wp.kernel
def _find_cells(
    sight: Sight,
    skin: wp.array2d[wp.vec2d],  # (camera, point) [px]
    step: wp.array[wp.int32],  # (camera,) pixels from a cell to the next; 0 for a view that is left out
    reach: wp.array2d[wp.int32],  # (camera, rows from its middle) half the width of a disc [cells]; -1 beyond it
    room: int,  # cells that a view has at most
    # in and out
    mark: wp.array[wp.uint8],  # (camera, cell) flat: where the skin is; zero before and after
    # out
    cell: wp.array2d[wp.vec2i],  # (camera, found) column and row [cells], row by row, as many as there is room for
    count: wp.array[wp.int32],  # (camera,)
) -> None:
    k = wp.tid()
    found = int(0)
    apart = step[k]
    if apart > 0:
        columns = (sight.size[k][0] + apart - 1) // apart
        rows = (sight.size[k][1] + apart - 1) // apart
        first = k * room
        _set(mark, first, skin[k], apart, columns, rows, 1)
        for row in range(rows):
            for w in range(sight.word.shape[2]):
                word = sight.word[k, row * apart, w]
                if word != wp.uint32(0):
                    for column in range((32 * w + apart - 1) // apart, wp.min((32 * w + 31) // apart + 1, columns)):
                        if (word >> wp.uint32(column * apart - 32 * w)) & wp.uint32(1) != wp.uint32(0):
                            at = row * columns + column
                            if not _is_near(mark, first, first + columns * rows, at, columns, reach[k]):
                                if found < cell.shape[1]:
                                    cell[k, found] = wp.vec2i(column, row)
                                found += 1
        _set(mark, first, skin[k], apart, columns, rows, 0)
    count[k] = found


def find_cells(sight: Any, skin: Any, step: Any, reach: Any, mark: Any, cell: Any, count: Any) -> None:
    """Cells of each view's mask around which a disc of cells has no point of the skin."""
    inputs = [sight, skin, step, reach, mark.shape[0] // count.shape[0]]
    wp.launch(_find_cells, count.shape, inputs, [mark, cell, count], device="cpu")


@wp.func
def _disagree(sight: Sight, other: wp.array[wp.int32], point: wp.vec3d, most: int) -> bool:
    """Whether more views than ``most`` show nothing at a point of the world; all of them if that is negative."""
    against = int(0)
    if most < 0:
        return True
    for i in range(other.shape[0]):
        k = other[i]
        seen = sight.turn[k] * point + sight.shift[k]
        if seen[2] > wp.float64(0.0):
            x = wp.rint(seen[0] / seen[2])
            y = wp.rint(seen[1] / seen[2])
            within = x >= wp.float64(0.0) and y >= wp.float64(0.0)
            if within and x < wp.float64(sight.size[k][0]) and y < wp.float64(sight.size[k][1]):
                if not _shows(sight, k, int(x), int(y)):
                    against += 1
                    if against > most:
                        return True
    return False


@wp.kernel
def _follow_rays(
    sight: Sight,
    k: int,
    pixel: wp.array[wp.vec2i],  # (ray,) of view k
    other: wp.array[wp.int32],  # views that are asked
    most: int,
    first: wp.float64,
    step: wp.float64,
    steps: int,
    skin: wp.array[wp.vec3d],  # (point,) [m]
    # out
    place: wp.array[wp.vec3d],  # (ray,) [m]
    nearest: wp.array[wp.int32],  # (ray,) point of the skin; -1 where nothing is agreed on
    apart: wp.array[wp.float64],  # (ray,) square of how far that is [m^2]
) -> None:
    i = wp.tid()
    direction = sight.into_world[k] * wp.vec3d(wp.float64(pixel[i][0]), wp.float64(pixel[i][1]), wp.float64(1.0))
    hits = int(0)
    for n in range(steps):
        point = sight.origin[k] + (first + wp.float64(n) * step) * direction
        if not _disagree(sight, other, point, most):
            hits += 1
    nearest[i] = -1
    wanted = (hits + 1) // 2
    n = int(0)
    while wanted > 0:
        place[i] = sight.origin[k] + (first + wp.float64(n) * step) * direction
        if not _disagree(sight, other, place[i], most):
            wanted -= 1
        n += 1
    if hits > 0:
        least = wp.float64(wp.inf)
        for p in range(skin.shape[0]):
            square = wp.length_sq(place[i] - skin[p])
            if square < least:
                least = square
                nearest[i] = p
        apart[i] = least


def follow_rays(
    sight: Any, k: int, pixel: Any, other: Any, most: int, depths: tuple[float, float, int], skin: Any, out: list[Any]
) -> None:
    """The middle one of the points along each ray at which all but ``most`` other views show something.

    ``depths`` are the first, the step between them [m] and their number.
    """
    inputs = [sight, k, pixel, other, most, *depths, skin]
    wp.launch(_follow_rays, pixel.shape, inputs, out, device="cpu")
