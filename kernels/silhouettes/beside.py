"""What masks show beside a posed body, and where the other masks agree that something is, in double precision.

Pixels of a mask are looked at in cells, as far apart as the body's distance allows. Those that are deep beside the skin
are found row by row; rays through some of them are followed past the body.
"""

from typing import Any

import warp as wp

from mmocap_warp.kernels.block import lanes_of, sync
from mmocap_warp.kernels.launching import launch

wp.set_module_options({"enable_backward": False})

MOST_LOOKS = 32767
"""Looks that marks can tell apart."""
LANES = 256
"""Threads that sum up the skin's points on a GPU."""


@wp.struct
class Sight:
    """What each view sees."""

    word: wp.array3d[wp.uint32]  # (camera, row, word) masks, 32 pixels a word
    possible: wp.array3d[wp.uint32]  # (camera, row, word) these, and what may be in front of them
    shows: wp.array[wp.int32]  # (camera,) 0 where a mask is empty
    size: wp.array[wp.vec2i]  # (camera,) width and height [px]
    turn: wp.array[wp.mat33d]  # (camera,) from the world to pixels times depth
    shift: wp.array[wp.vec3d]  # (camera,)
    focal: wp.array[wp.float64]  # (camera,) [px]
    origin: wp.array[wp.vec3d]  # (camera,) where its rays begin [m]
    into_world: wp.array[wp.mat33d]  # (camera,) from pixels to a ray's direction, for a metre of depth


@wp.struct
class Look:
    """A body, what is looked for beside it, and what is found."""

    posed: wp.array2d[wp.vec3]  # (1, vertex) its skin [m]
    corner: wp.array[wp.vec3i]  # (point on a face,) vertices that it lies between
    share: wp.array[wp.vec3d]  # (point on a face,) of each
    cell: wp.float64  # cells are at most so far apart [m]
    deep: wp.float64  # mask farther than this from all points is beside the body [m]
    least: wp.float64  # a view with less of it decides nothing [m^2]
    most: wp.float64  # a view with more of it shows somebody else [m^2]
    reach: wp.float64  # rays are followed so far before and behind the body's middle [m]
    stride: wp.float64  # between the points of a ray [m]
    point: wp.array[wp.vec3d]  # (point,) the vertices, then the points on faces [m]
    pixel: wp.array2d[wp.vec2d]  # (camera, point) NaN behind the camera
    partial: wp.array[wp.vec3d]  # (lane,) sums of points
    depth: wp.array[wp.float64]  # (camera,) of the points' middle [m]
    scale: wp.array[wp.float64]  # (camera,) [px/m] there
    step: wp.array[wp.int32]  # (camera,) pixels from a cell to the next; 0 for a view that is left out
    radius: wp.array[wp.int32]  # (camera,) how deep is deep [cells]
    number: wp.array[wp.int32]  # (1,) of the look, from 1 to MOST_LOOKS; marks and this are zeroed then
    mark: wp.array2d[wp.int16]  # (camera, cell) the look's number where the skin is, and minus that beside it
    in_row: wp.array2d[wp.int32]  # (camera, row of cells) how many of these
    count: wp.array[wp.int32]  # (camera,) how many there are
    place: wp.array2d[wp.vec3d]  # (camera, ray) [m]
    nearest: wp.array2d[wp.int32]  # (camera, ray) every fourth point of the skin; -1 where nothing is agreed on
    apart: wp.array2d[wp.float64]  # (camera, ray) square of how far that is [m^2]


@wp.kernel
def _place_points(
    sight: Sight,
    # in and out
    look: Look,
) -> None:
    p = wp.tid()
    vertices = look.posed.shape[1]
    place = wp.vec3d()
    if p < vertices:
        place = wp.vec3d(look.posed[0, p])
    else:
        for i in range(3):
            place += look.share[p - vertices][i] * wp.vec3d(look.posed[0, look.corner[p - vertices][i]])
    look.point[p] = place
    for k in range(sight.turn.shape[0]):
        seen = sight.turn[k] * place + sight.shift[k]
        depth = wp.where(seen[2] > wp.float64(0.0), seen[2], wp.float64(wp.nan))
        look.pixel[k, p] = wp.vec2d(seen[0] / depth, seen[1] / depth)


@wp.kernel
def _measure_views(
    sight: Sight,
    lanes: int,
    # in and out
    look: Look,
) -> None:
    lane = wp.tid()
    total = wp.vec3d()
    for p in range(lane, look.point.shape[0], lanes):
        total += look.point[p]
    look.partial[lane] = total
    if lane == 0:
        look.number[0] += 1
    sync()
    middle = wp.vec3d()
    for other in range(lanes):
        middle += look.partial[other]
    middle = middle / wp.float64(look.point.shape[0])
    for k in range(lane, sight.turn.shape[0], lanes):
        depth = (sight.turn[k] * middle + sight.shift[k])[2]
        look.depth[k] = depth
        look.scale[k] = wp.where(depth > wp.float64(0.0), sight.focal[k] / depth, wp.float64(0.0))
        look.step[k] = 0
        look.count[k] = 0
        if depth > wp.float64(0.0) and sight.shows[k] > 0:
            look.step[k] = wp.max(1, int(look.cell * look.scale[k]))
            look.radius[k] = wp.max(1, int(wp.rint(look.deep * look.scale[k] / wp.float64(look.step[k]))))


@wp.func
def _cells(sight: Sight, look: Look, k: int) -> wp.vec2i:
    """Columns and rows of a view's cells; none where it is left out."""
    step = look.step[k]
    size = sight.size[k]
    return wp.where(step > 0, (size + wp.vec2i(step - 1, step - 1)) / wp.max(step, 1), wp.vec2i(0, 0))


@wp.kernel
def _mark_skin(
    sight: Sight,
    # in and out
    look: Look,
) -> None:
    k, p = wp.tid()
    cells = _cells(sight, look, k)
    if cells[0] > 0:
        x = wp.rint(look.pixel[k, p][0] / wp.float64(look.step[k]))
        y = wp.rint(look.pixel[k, p][1] / wp.float64(look.step[k]))
        within = x >= wp.float64(0.0) and y >= wp.float64(0.0)
        if within and x < wp.float64(cells[0]) and y < wp.float64(cells[1]):
            look.mark[k, int(y) * cells[0] + int(x)] = wp.int16(look.number[0])


@wp.func
def _is_near(look: Look, k: int, column: int, row: int, cells: wp.vec2i) -> bool:
    """Whether a point of the skin lies in a disc of cells around one; rows near the middle are looked at first."""
    radius = look.radius[k]
    for dy in range(radius + 1):
        wide = int(wp.rint(wp.sqrt(float(radius * radius - dy * dy))))
        for side in range(2):
            y = row + (1 - 2 * side) * dy
            if y >= 0 and y < cells[1]:
                for x in range(wp.max(column - wide, 0), wp.min(column + wide, cells[0] - 1) + 1):
                    if int(look.mark[k, y * cells[0] + x]) == look.number[0]:
                        return True
    return False


@wp.kernel
def _find_cells(
    sight: Sight,
    # in and out
    look: Look,
) -> None:
    k, row = wp.tid()
    cells = _cells(sight, look, k)
    found = int(0)
    if row < cells[1]:
        step = look.step[k]
        for w in range(sight.word.shape[2]):
            word = sight.word[k, row * step, w]
            if word != wp.uint32(0):
                for column in range((32 * w + step - 1) // step, wp.min((32 * w + 31) // step + 1, cells[0])):
                    if (word >> wp.uint32(column * step - 32 * w)) & wp.uint32(1) != wp.uint32(0):
                        if not _is_near(look, k, column, row, cells):
                            look.mark[k, row * cells[0] + column] = wp.int16(-look.number[0])
                            found += 1
    look.in_row[k, row] = found
    if found > 0:
        wp.atomic_add(look.count, k, found)


@wp.func
def _area(look: Look, k: int, cells: int) -> wp.float64:
    across = wp.float64(look.step[k]) / look.scale[k]
    return wp.float64(cells) * (across * across)


@wp.func
def _counts(look: Look, k: int) -> bool:
    """Whether a view has no more beside the body than limbs."""
    return look.step[k] > 0 and _area(look, k, look.count[k]) <= look.most


@wp.func
def _nth_cell(sight: Sight, look: Look, k: int, number: int) -> wp.vec3d:
    """The pixel of a cell beside the body, by its number."""
    cells = _cells(sight, look, k)
    row = int(0)
    left = number
    while left >= look.in_row[k, row]:
        left -= look.in_row[k, row]
        row += 1
    column = int(-1)
    while left >= 0:
        column += 1
        if int(look.mark[k, row * cells[0] + column]) == -look.number[0]:
            left -= 1
    step = look.step[k]
    return wp.vec3d(wp.float64(step * column), wp.float64(step * row), wp.float64(1.0))


@wp.func
def _disagree(sight: Sight, look: Look, own: int, point: wp.vec3d, most: int) -> bool:
    """Whether more other views that count than ``most`` show nothing at a point of the world."""
    against = int(0)
    for k in range(sight.turn.shape[0]):
        if k != own and _counts(look, k):
            seen = sight.turn[k] * point + sight.shift[k]
            if seen[2] > wp.float64(0.0):
                x = wp.rint(seen[0] / seen[2])
                y = wp.rint(seen[1] / seen[2])
                within = x >= wp.float64(0.0) and y >= wp.float64(0.0)
                if within and x < wp.float64(sight.size[k][0]) and y < wp.float64(sight.size[k][1]):
                    word = sight.possible[k, int(y), int(x) // 32]
                    if (word >> wp.uint32(int(x) % 32)) & wp.uint32(1) == wp.uint32(0):
                        against += 1
                        if against > most:
                            return True
    return False


@wp.kernel
def _follow_rays(
    sight: Sight,
    least_views: int,
    # in and out
    look: Look,
) -> None:
    k, i = wp.tid()
    look.nearest[k, i] = -1
    every = (look.count[k] + look.place.shape[1] - 1) // look.place.shape[1]
    others = int(-1)
    for other in range(sight.turn.shape[0]):
        others += wp.where(_counts(look, other), 1, 0)
    most = others - wp.max(2, others - wp.where(others >= least_views, 1, 0))
    if i * every < look.count[k] and most >= 0 and _counts(look, k) and _area(look, k, look.count[k]) >= look.least:
        direction = sight.into_world[k] * _nth_cell(sight, look, k, i * every)
        first = wp.max(look.depth[k] - look.reach, look.stride)
        steps = int(wp.ceil((look.depth[k] + look.reach - first) / look.stride))
        hits = int(0)
        for n in range(steps):
            point = sight.origin[k] + (first + wp.float64(n) * look.stride) * direction
            if not _disagree(sight, look, k, point, most):
                hits += 1
        wanted = (hits + 1) // 2
        n = int(0)
        while wanted > 0:
            look.place[k, i] = sight.origin[k] + (first + wp.float64(n) * look.stride) * direction
            if not _disagree(sight, look, k, look.place[k, i], most):
                wanted -= 1
            n += 1
        if hits > 0:
            least = wp.float64(wp.inf)
            for p in range(0, look.point.shape[0], 4):
                square = wp.length_sq(look.place[k, i] - look.point[p])
                if square < least:
                    least = square
                    look.nearest[k, i] = p // 4
            look.apart[k, i] = least


def find_cells(sight: Any, look: Any) -> None:
    """Find each view's cells around which a disc has no point of the skin, whose pixels are known."""
    device = look.point.device
    launch(_mark_skin, look.pixel.shape, [sight], [look], device=device)
    launch(_find_cells, look.in_row.shape, [sight], [look], device=device)


def follow_rays(sight: Any, look: Any, least_views: int) -> None:
    """The middle one of the points along rays through cells at which the other views that count show something.

    All but one of these must where there are ``least_views``, and two at least.
    """
    launch(_follow_rays, look.place.shape, [sight, least_views], [look], device=look.point.device)


def place_points(sight: Any, look: Any) -> None:
    """Place the points of the posed skin in the world and in the views, and measure these at their middle."""
    device = look.point.device
    lanes = lanes_of(device, LANES)
    launch(_place_points, look.point.shape, [sight], [look], device=device)
    launch(_measure_views, lanes, [sight, lanes], [look], block_dim=lanes, device=device)
