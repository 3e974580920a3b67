"""The outline of a posed mesh in a view: its contour edges that no other part of the body covers.

An edge is on a contour where one of its two triangles faces the camera and the other does not. Contours are closed
curves in the image, and a point beside them is covered by the body as often as they wind around it. So a point just
outside an edge tells whether the edge is on the outline of the whole body::

       ____                 a point just outside the edge a: no contour winds around it, a is outline
      /    \\  . a
     |  ____|______         a point just outside the edge b: the trunk's contour winds around it once,
     | |  b .      |        so the body is on both sides of b, and b is no outline
     | |___________|
      \\____/

The number of turns is counted on a ray to the left: contours that cross it upward less those that cross it downward.
Nothing is drawn, and the answer does not depend on pixels. An image is cut into bands of rows, and a ray only meets
the contours of its band.
"""

import warp as wp

from mmocap_warp.kernels.block import CPU_FLAGS, Batch, lanes_of, shared_numbers, shared_words, sync
from mmocap_warp.kernels.contour.moving import Moving, seen_at
from mmocap_warp.kernels.launching import launch
from mmocap_warp.kernels.native import native_sections
from mmocap_warp.kernels.views.projection import NEAR, Pinhole, Views, into_camera, pinhole

wp.set_module_options({"enable_backward": False, "cpu_compiler_flags": CPU_FLAGS})

_native = native_sections(__file__)

BANDS = 64
"""Of an image, in which its contours are sorted."""

_BANDS = wp.constant(BANDS)
_LANES = 512  # lanes of a block: one block has a view, and its steps wait for each other
_COUNTERS = wp.constant(_LANES)  # where a block's counters for the bands begin, behind its lanes' own words
PROBE = wp.constant(0.75)
"""An edge is probed so far outside [px]: rounding moves a contour less, and all that is seen is larger."""


@wp.struct
class Edges:
    """A closed mesh, by its triangles and the two of them at each edge.

    Triangles are counter-clockwise seen from outside; the left one has the edge from its first end to its second.
    """

    face: wp.array[wp.vec3i]  # (face,) vertices
    edge: wp.array[wp.vec4i]  # (edge,) two vertices, the triangles on the left and on the right


@wp.struct
class Outline:
    """Contour edges of candidates in their views, in the order of the mesh's edges; ``size`` is the most in a view."""

    size: int
    late: wp.array2d[wp.float32]  # (candidate, camera) by how much a late view moves with its pose; 0 for one in time
    image: wp.array3d[wp.vec3]  # (candidate, camera, vertex) x, y [px], depth [m]
    facing: wp.array3d[wp.uint8]  # (candidate, camera, face) whether it faces the camera
    found: wp.array3d[wp.int32]  # (candidate, camera, edge) on their way to ``ends``; then see :func:`on_outline`
    count: wp.array2d[wp.int32]  # (candidate, camera) contour edges
    ends: wp.array3d[wp.vec2i]  # (candidate, camera, contour edge) vertices; the body is on the left as one sees it
    room: int  # for lines: contour edges, as often as there are bands that they lie in
    line: wp.array[wp.float32]  # (candidate, camera, 4, line) flat: x and y of the start, y of the end, dx / dy
    band: wp.array3d[
        wp.int32
    ]  # (candidate, camera, band) where its lines begin, and behind the last one where they end


@wp.func_native(_native("project", NEAR=NEAR))
def _project(
    posed: wp.array2d[wp.vec3], outline: Outline, camera: Pinhole, c: int, k: int, lane: int, lanes: int
) -> int:
    """Image coordinates and depths of a lane's vertices, and how many are not before the camera.

    Plain C, as below, because addresses in arrays of many axes would take most of the time.
    """


@wp.func
def _project_moving(
    posed: wp.array2d[wp.vec3], moving: Moving, outline: Outline, camera: Pinhole, c: int, k: int, lane: int, lanes: int
) -> int:
    """As :func:`_project`, for a view that is late."""
    late = moving.late[moving.frame[c], k]
    behind = int(0)
    for v in range(lane, posed.shape[1], lanes):
        p = into_camera(seen_at(posed, moving, late, c, v), camera)
        share = 1.0 / wp.max(p[2], NEAR)
        x = camera.lens[0] * p[0] * share + camera.lens[2]
        outline.image[c, k, v] = wp.vec3(x, camera.lens[1] * p[1] * share + camera.lens[3], p[2])
        behind += wp.where(p[2] < NEAR, 1, 0)
    return behind


@wp.func
def line_start(outline: Outline, c: int, k: int) -> int:
    """Where the lines of a candidate's view begin."""
    return (c * outline.count.shape[1] + k) * 4 * outline.room


@wp.func
def _band_of(y: float, height: int) -> int:
    """The band in which a place of an image of so many rows is; the first or the last one for places beyond it."""
    return int(wp.clamp(y * float(_BANDS) / float(height), 0.0, float(_BANDS - 1)))


# A ray goes from the point to the left. An edge that it crosses counts one up or one down, by the direction in which
# the edge crosses the ray's height: no edge counts twice at a corner, because an end belongs to one of its edges
# only.
@wp.func_native(_native("turns_around"))
def _turns_around(line: wp.array[wp.float32], first: int, room: int, begin: int, end: int, x: float, y: float) -> int:
    """How often contours wind around a point."""


@wp.func
def is_outline(outline: Outline, c: int, k: int, height: int, middle: wp.vec2, outward: wp.vec2) -> bool:
    """Whether a contour edge, by its middle and its outward normal, has nothing of the body outside of it.

    The image has ``height`` rows, and the middle is in it.
    """
    probe = middle + PROBE * outward
    first = line_start(outline, c, k)
    band = _band_of(probe[1], height)
    begin = outline.band[c, k, band]
    end = outline.band[c, k, band + 1]
    if begin > end:  # not sorted
        begin = 0
        end = outline.count[c, k]
    return _turns_around(outline.line, first, outline.room, begin, end, probe[0], probe[1]) == 0


@wp.func_native(_native("on_outline", BANDS=BANDS, PROBE=PROBE))
def on_outline(outline: Outline, c: int, k: int, image: wp.vec2i, rim: float) -> int:
    """As :func:`is_outline`, on a CPU: how many of a view's contour edges pass; they are the first in ``found``.

    Edges of no length, and those within the ``rim`` [px] of an ``image`` of some size, do not pass.
    """


@wp.func_native(_native("face_camera"))
def _face_camera(face: wp.array[wp.vec3i], outline: Outline, c: int, k: int, lane: int, lanes: int) -> None:
    """Which triangles of a view face the camera: their area in the image is negative, because y goes down."""


# An edge is written before it is known whether it belongs to the contour, and overwritten by the next one if it does
# not: that needs no branch. It belongs to the contour if one of its two triangles faces the camera and the other does
# not.
@wp.func_native(_native("find_share"))
def _find_share(edge: wp.array[wp.vec4i], outline: Outline, c: int, k: int, first: int, end: int) -> int:
    """Find the contour edges among a lane's share of all; those whose left triangle is hidden as ``-1 - edge``."""


@wp.func
def _keep(edges: Edges, outline: Outline, c: int, k: int, found: int, s: int) -> None:
    """Write a contour edge in the direction in which its visible triangle has it."""
    edge = edges.edge[wp.where(found < 0, -1 - found, found)]
    start = wp.where(found < 0, edge[1], edge[0])
    end = wp.where(found < 0, edge[0], edge[1])
    outline.ends[c, k, s] = wp.vec2i(start, end)


@wp.func
def _write_line(outline: Outline, c: int, k: int, s: int, at: int) -> None:
    """Write a contour edge as a line."""
    ends = outline.ends[c, k, s]
    a = outline.image[c, k, ends[0]]
    b = outline.image[c, k, ends[1]]
    line = line_start(outline, c, k) + at
    rise = b[1] - a[1]
    outline.line[line] = a[0]
    outline.line[line + outline.room] = a[1]
    outline.line[line + 2 * outline.room] = b[1]
    outline.line[line + 3 * outline.room] = wp.where(rise == 0.0, 0.0, (b[0] - a[0]) / rise)


@wp.func
def _bands_of(outline: Outline, c: int, k: int, s: int, height: int) -> wp.vec2i:
    """The first and the last band that a contour edge lies in."""
    ends = outline.ends[c, k, s]
    one = _band_of(outline.image[c, k, ends[0]][1], height)
    other = _band_of(outline.image[c, k, ends[1]][1], height)
    return wp.vec2i(wp.min(one, other), wp.max(one, other))


@wp.func
def _sort_lines(
    outline: Outline, c: int, k: int, count: int, height: int, words: wp.array[wp.uint32], lane: int, lanes: int
) -> None:
    """Write a view's lines, band by band; the order within a band does not matter to the number of turns.

    Where there is too little room, because edges are long, all lines are written once, and bands are said to end
    before they begin.
    """
    for band in range(lane, _BANDS, lanes):
        words[_COUNTERS + band] = wp.uint32(0)
    sync()
    for s in range(lane, count, lanes):
        bands = _bands_of(outline, c, k, s, height)
        for band in range(bands[0], bands[1] + 1):
            wp.atomic_add(words, _COUNTERS + band, wp.uint32(1))
    sync()
    total = int(0)
    for band in range(_BANDS):
        total += int(words[_COUNTERS + band])
    fits = total <= outline.room
    sync()
    if lane == 0:
        begin = int(0)
        for band in range(_BANDS):
            lines = int(words[_COUNTERS + band])
            words[_COUNTERS + band] = wp.uint32(begin)
            outline.band[c, k, band] = wp.where(fits, begin, _BANDS - band)
            begin += lines
        outline.band[c, k, _BANDS] = wp.where(fits, begin, 0)
    sync()
    for s in range(lane, count, lanes):
        if fits:
            bands = _bands_of(outline, c, k, s, height)
            for band in range(bands[0], bands[1] + 1):
                _write_line(outline, c, k, s, int(wp.atomic_add(words, _COUNTERS + band, wp.uint32(1))))
        else:
            _write_line(outline, c, k, s, s)


@wp.func_native(_native("sort_lines", BANDS=BANDS))
def _sort_lines_alone(outline: Outline, c: int, k: int, count: int, height: int) -> None:
    """As :func:`_sort_lines`, by the one lane of a CPU's block."""


@wp.kernel
def _find_contours(
    edges: Edges,
    posed: wp.array2d[wp.vec3],  # (candidate, vertex)
    moving: Moving,
    views: Views,
    batch: Batch,
    lanes: int,
    # out
    outline: Outline,
) -> None:
    own, k, lane = wp.tid()
    c = batch.first + own
    words = shared_words(batch.scratch)
    numbers = shared_numbers(batch.scratch)
    if lane == 0:
        numbers[0] = 0
    sync()
    camera = pinhole(views, k)
    late = moving.late[moving.frame[c], k]
    behind = int(0)
    if late == 0.0:
        behind = _project(posed, outline, camera, c, k, lane, lanes)
    else:
        behind = _project_moving(posed, moving, outline, camera, c, k, lane, lanes)
    if behind > 0:
        wp.atomic_add(numbers, 0, behind)
    sync()
    # Once a triangle and not at each of its edges: roundings must not open a contour at a triangle seen from its side.
    _face_camera(edges.face, outline, c, k, lane, lanes)
    sync()
    total = edges.edge.shape[0]
    first = lane * total // lanes
    end = (lane + 1) * total // lanes
    found = _find_share(edges.edge, outline, c, k, first, end)
    words[lane] = wp.uint32(found)
    sync()
    before = int(0)
    all = int(0)
    for other in range(lanes):
        if other == lane:
            before = all
        all += int(words[other])
    usable = numbers[0] == 0 and all <= outline.size
    if lane == 0:
        outline.count[c, k] = wp.where(usable, all, 0)
        outline.late[c, k] = wp.where(late == 0.0, 0.0, 1.0 + late * moving.own)
    if usable:
        for i in range(found):
            _keep(edges, outline, c, k, outline.found[c, k, first + i], before + i)
        sync()
        height = views.size[k][1]
        if lanes > 1:
            _sort_lines(outline, c, k, all, height, words, lane, lanes)
        else:
            _sort_lines_alone(outline, c, k, all, height)


def find_contours(
    edges: Edges, posed: wp.array[wp.vec3], moving: Moving, views: Views, batch: Batch, outline: Outline
) -> None:
    """Project a batch's ``posed`` (candidate, vertex) [m] and find its contour edges in every view: a block each.

    A view has none where a vertex is not before the camera, or where there are more than ``outline.size``.
    """
    lanes = lanes_of(posed.device, _LANES)
    dim = (batch.size, outline.count.shape[1], lanes)
    inputs = [edges, posed, moving, views, batch, lanes]
    launch(_find_contours, dim, inputs, [outline], block_dim=lanes, device=posed.device)
