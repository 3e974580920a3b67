"""Silhouettes by their contours: edges mark where a row enters and leaves the body, a running sum fills between them.

The idea: an edge whose two triangles both face the camera, or both face away, bounds nothing. What is left, the
contour, has a tenth of the triangles' rows. Going down a facing triangle's outline is its left side: there a row
enters one more layer of the body; going up is its right side: there it leaves one.

    a row of pixels          .    .    [    .    [    .    ]    ]    .          [ ] two layers' left and right sides
    steps, marked by edges   0    0   +1    0   +1    0   -1   -1    0          a byte a pixel, in shared memory
    running sum: layers      0    0    1    1    2    2    1    0    0          a pixel is covered where it is positive
    bits                     0    0    1    1    1    1    1    0    0          32 to a word, counted by popcounts

A block holds the steps of a band of rows in shared memory, then turns them into words and counts these. A byte holds
up to 127 layers. The tie rule (``coverage.py``) makes the sums exact.
"""

import warp as wp

from mmocap_warp.kernels.block import CPU_FLAGS, LANES, WORDS, Batch, blocks_of, lanes_of, run_of, shared_words, sync
from mmocap_warp.kernels.native import native_sections
from mmocap_warp.kernels.silhouettes.counting import Bounds, Canvas, Frozen, add_up, count_word, is_cut, project_piece
from mmocap_warp.kernels.silhouettes.coverage import crossing, edge, faces_camera, first_after, last_before, word_bits
from mmocap_warp.kernels.views.projection import Pinhole, Views, clip, corner, pinhole

wp.set_module_options({"enable_backward": False, "cpu_compiler_flags": CPU_FLAGS})

_native = native_sections(__file__)

_NO_STEPS_OF_EIGHT = wp.constant(wp.uint64(0x8080808080808080))  # eight pixels; a byte holds 128 + its step
_EACH = wp.constant(wp.uint64(0x0101010101010101))
_GATHER = wp.constant(wp.uint64(0x0102040810204080))  # brings the lowest bits of the bytes together in the highest byte


@wp.struct
class Outline:
    """A piece of a mesh: its triangles and their edges."""

    vertex: wp.array[wp.int32]  # (vertex of the piece,)
    triangle: wp.array[wp.vec3i]  # (triangle,)
    edge: wp.array[wp.vec4i]  # (edge,) two vertices, the triangle in which they follow one another, the other or -1


@wp.struct
class Band:
    """Rows that are drawn at a time, columns in fours, and how their steps lie in the block's shared words."""

    first_row: int
    last_row: int
    first_four: int
    last_four: int
    stride: int  # shared words a row: odd, so that lanes on neighbouring rows use different banks


@wp.func
def _first_band(bounds: Bounds) -> Band:
    band = Band()
    band.first_four = (bounds[2] >> 3) << 1  # two fours are read at a time
    band.last_four = ((bounds[3] >> 3) << 1) + 1
    band.stride = (band.last_four - band.first_four + 1) | 1
    band.first_row = bounds[0]
    return band


@wp.func
def _mark(a: wp.vec2i, b: wp.vec2i, layers: int, band: Band, steps: wp.array[wp.uint32]) -> None:
    """Add the side ``a -> b`` of a facing outline, ``layers`` times."""
    top = a
    bottom = b
    step = layers
    if b[1] < a[1]:
        top = b
        bottom = a
        step = -layers
    first = wp.max(first_after(top[1]), band.first_row)
    last = wp.min(last_before(bottom[1]), band.last_row)
    if first > last:
        return
    side = edge(top, bottom)
    for row in range(first, last + 1):
        x = wp.max(crossing(side, row), band.first_four << 2)
        four = x >> 2
        if four <= band.last_four:
            at = (row - band.first_row) * band.stride + four - band.first_four
            steps[at] += wp.uint32(step) << wp.uint32(8 * (x & 3))


@wp.func
def _mark_contour(
    contour: wp.array[wp.vec4i],
    points: wp.array[wp.vec2i],
    facing: wp.array[wp.uint8],
    beyond: int,
    lane: int,
    lanes: int,
    band: Band,
    steps: wp.array[wp.uint32],
) -> None:
    """Mark the edges whose triangles face different ways; ``beyond`` an open border, 1 faces the camera, 0 does not.

    With 0 the layers are those of the triangles that face the camera, with 1 of those that face away. Both are the
    same where the surface is closed.
    """
    for i in range(lane, contour.shape[0], lanes):
        side = contour[i]
        here = int(facing[side[2]])
        there = beyond
        if side[3] >= 0:
            there = int(facing[side[3]])
        if here != there:
            _mark(points[side[0]], points[side[1]], here - there, band, steps)


@wp.func
def _mark_outline(a: wp.vec2i, b: wp.vec2i, c: wp.vec2i, band: Band, steps: wp.array[wp.uint32]) -> None:
    """Mark a triangle, whichever way it faces."""
    layers = wp.where(faces_camera(a, b, c), 1, -1)
    _mark(a, b, layers, band, steps)
    _mark(b, c, layers, band, steps)
    _mark(c, a, layers, band, steps)


@wp.func
def _mark_clipped(
    posed: wp.array[wp.vec3],
    triangle: wp.array[wp.vec3i],
    camera: Pinhole,
    points: wp.array[wp.vec2i],
    lane: int,
    lanes: int,
    band: Band,
    steps: wp.array[wp.uint32],
) -> None:
    """Mark what the near plane leaves of every triangle."""
    for t in range(lane, triangle.shape[0], lanes):
        v = triangle[t]
        left = clip(v, points, posed, camera)
        _mark_outline(corner(left, 0), corner(left, 1), corner(left, 2), band, steps)
        _mark_outline(corner(left, 0), corner(left, 2), corner(left, 3), band, steps)


@wp.func
def _face(
    triangle: wp.array[wp.vec3i], lane: int, lanes: int, points: wp.array[wp.vec2i], facing: wp.array[wp.uint8]
) -> None:
    """Find out which triangles face the camera."""
    for t in range(lane, triangle.shape[0], lanes):
        v = triangle[t]
        facing[t] = wp.uint8(faces_camera(points[v[0]], points[v[1]], points[v[2]]))
    sync()


@wp.func
def _fill(word: int, row: int, layers: int, band: Band, steps: wp.array[wp.uint32]) -> wp.vec2i:
    """A word's 32 pixels as bits, and the number of layers at its last one; ``layers`` are before its first.

    Eight pixels at a time: as the digits of a number to base 256, steps turn into running sums when multiplied by
    1 + 256 + ... + 256^7, and adding 127 to every sum sets a digit's highest bit where it is not 0.
    """
    pixels = wp.uint64(0)
    inside = wp.uint64(layers)
    at = (row - band.first_row) * band.stride - band.first_four
    for eight in range(wp.max(word * 4, band.first_four >> 1), wp.min(word * 4 + 3, band.last_four >> 1) + 1):
        both = (wp.uint64(steps[at + 2 * eight + 1]) << wp.uint64(32)) | wp.uint64(steps[at + 2 * eight])
        sums = (both - _NO_STEPS_OF_EIGHT + inside) * _EACH
        inside = sums >> wp.uint64(56)
        covered = ((sums + _EACH * wp.uint64(127)) >> wp.uint64(7)) & _EACH
        pixels = pixels | (((covered * _GATHER) >> wp.uint64(56)) << wp.uint64(8 * (eight & 3)))
    return wp.vec2i(int(pixels), int(inside))


@wp.func_native(_native("clear"))
def _clear(words: int, lane: int, lanes: int, steps: wp.array[wp.uint32]) -> None:
    """Forget all steps. Straight through memory, which Warp's arrays do not let a compiler see: twice as fast."""


@wp.func
def _mark_piece(
    posed: wp.array[wp.vec3],
    piece: Outline,
    camera: Pinhole,
    points: wp.array[wp.vec2i],
    facing: wp.array[wp.uint8],
    beyond: int,
    cut: bool,
    lane: int,
    lanes: int,
    band: Band,
    steps: wp.array[wp.uint32],
) -> None:
    _clear((band.last_row - band.first_row + 1) * band.stride, lane, lanes, steps)
    if cut:
        _mark_clipped(posed, piece.triangle, camera, points, lane, lanes, band, steps)
    else:
        _mark_contour(piece.edge, points, facing, beyond, lane, lanes, band, steps)
    sync()


@wp.kernel(launch_bounds=(LANES, 3))
def _raster(
    posed: wp.array2d[wp.vec3],  # (candidate, vertex) [m]
    piece: Outline,  # that moves
    views: Views,
    frozen: Frozen,
    batch: Batch,
    blocks: int,
    lanes: int,
    # out
    canvas: Canvas,
) -> None:
    own, k, block, lane = wp.tid()
    c = batch.first + own
    run = run_of(c, batch, frozen.words.shape[0])
    scratch = batch.scratch
    steps = shared_words(scratch)
    points = canvas.cell[c, k]
    facing = canvas.facing[c, k]
    bounds = project_piece(posed[c], piece.vertex, views, frozen, run, k, lane, lanes, scratch, points)
    cut = is_cut(frozen, run, k, scratch)
    camera = pinhole(views, k)
    width = views.size[k][0]
    total = wp.vec2i(0, 0)
    if bounds[0] <= bounds[1] and bounds[2] <= bounds[3]:
        _face(piece.triangle, lane, lanes, points, facing)
        rows = (bounds[1] - bounds[0]) // blocks + 1
        end = wp.min(bounds[0] + (block + 1) * rows - 1, bounds[1])
        band = _first_band(bounds)
        band.first_row += block * rows
        while band.first_row <= end:
            band.last_row = wp.min(band.first_row + WORDS // band.stride - 1, end)
            _mark_piece(posed[c], piece, camera, points, facing, 0, cut, lane, lanes, band, steps)
            for row in range(band.first_row + lane, band.last_row + 1, lanes):
                inside = int(0)
                for word in range(band.first_four >> 3, (band.last_four >> 3) + 1):
                    filled = _fill(word, row, inside, band, steps)
                    inside = filled[1]
                    pixels = wp.uint32(filled[0]) & word_bits(0, width - 1, word)
                    total += count_word(pixels, views, frozen, run, k, row, word)
            sync()
            band.first_row = band.last_row + 1
    add_up(total, frozen, run, c, k, lane, block, blocks, scratch, canvas.count)


def raster(
    posed: wp.array[wp.vec3], piece: Outline, views: Views, frozen: Frozen, batch: Batch, canvas: Canvas
) -> None:
    """Count pixels: ``count[c, k] = (|M|, |M and F|)`` of candidate ``c``'s silhouette M and camera ``k``'s mask F.

    ``posed`` is (candidate, vertex) [m]; ``piece`` is what moves, ``frozen`` holds the silhouettes of the rest. Where
    a block a view would leave most of a GPU idle, several share it, a stretch of its rows each.
    """
    cameras = views.size.shape[0]
    lanes, blocks = lanes_of(posed.device), blocks_of(posed.device, batch.size * cameras)
    if blocks > 1:
        canvas.count.zero_()
    dim = (batch.size, cameras, blocks, lanes)
    inputs = [posed, piece, views, frozen, batch, blocks, lanes]
    wp.launch(_raster, dim, inputs, [canvas], block_dim=lanes, device=posed.device)


@wp.kernel
def _freeze(
    posed: wp.array2d[wp.vec3],  # (run, vertex) [m]
    piece: Outline,  # that rests
    views: Views,
    batch: Batch,
    lanes: int,
    # out
    canvas: Canvas,
    frozen: Frozen,
) -> None:
    own, k, lane = wp.tid()
    c = batch.first + own
    scratch = batch.scratch
    steps = shared_words(scratch)
    none = Frozen()
    points = canvas.cell[c, k]
    facing = canvas.facing[c, k]
    bounds = project_piece(posed[c], piece.vertex, views, none, -1, k, lane, lanes, scratch, points)
    is_open = is_cut(none, -1, k, scratch)
    if lane == 0:
        frozen.cut[c, k] = int(is_open)
    camera = pinhole(views, k)
    width = views.size[k][0]
    words = frozen.words[c, k]
    for row in range(lane, words.shape[0], lanes):
        for word in range(words.shape[1]):
            words[row, word] = wp.uint32(0)
    sync()
    total = wp.vec2i(0, 0)
    if bounds[0] <= bounds[1] and bounds[2] <= bounds[3]:
        _face(piece.triangle, lane, lanes, points, facing)
        band = _first_band(bounds)
        while band.first_row <= bounds[1]:
            band.last_row = wp.min(band.first_row + WORDS // band.stride - 1, bounds[1])
            for beyond in range(2):
                _mark_piece(posed[c], piece, camera, points, facing, beyond, is_open, lane, lanes, band, steps)
                for row in range(band.first_row + lane, band.last_row + 1, lanes):
                    inside = int(0)
                    for word in range(band.first_four >> 3, (band.last_four >> 3) + 1):
                        filled = _fill(word, row, inside, band, steps)
                        inside = filled[1]
                        pixels = wp.uint32(filled[0]) & word_bits(0, width - 1, word) & ~words[row, word]
                        words[row, word] = words[row, word] | pixels
                        total += count_word(pixels, views, none, -1, k, row, word)
                sync()
            band.first_row = band.last_row + 1
    add_up(total, none, -1, c, k, lane, 0, 1, scratch, frozen.count)


def freeze(
    posed: wp.array[wp.vec3], piece: Outline, views: Views, batch: Batch, canvas: Canvas, frozen: Frozen
) -> None:
    """Draw a resting piece into ``frozen.words`` and count it, a silhouette a run; ``posed`` is (run, vertex) [m].

    Triangles that face away are drawn too. As long as the whole body is seen, the others cover them; where the moving
    piece is cut by the near plane, they count.
    """
    lanes = lanes_of(posed.device)
    dim = (batch.size, views.size.shape[0], lanes)
    wp.launch(_freeze, dim, [posed, piece, views, batch, lanes], [canvas, frozen], block_dim=lanes, device=posed.device)
