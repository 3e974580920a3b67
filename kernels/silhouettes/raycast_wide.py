"""Silhouettes by rays on a GPU: a warp casts 32 x 32 rays, its 32 lanes test 32 boxes or triangles at a time.

The idea: as in ``raycast.py``, only whether a ray hits is asked, and many rays ask together. But the threads of a
warp must all do the same, so the tree is flat and 32 wide, and the lanes vote. Every triangle has a box in the image,
every 32 neighbours, a group, have a box around these. A tile is a word, 32 pixels, of each of 32 rows.

    lane                       0   1   2   3  ...  31
    1. meets the tile:  box of group 0, 1, 2, 3 ...      a vote: groups 1 and 3 are to be visited
    2. meets the tile:  box of triangle 32, 33, 34 ...   of group 1, then 3; a vote: who meets it joins the queue
    3. once 32 wait:    [ 33 | 40 | 41 | 96 | ... ]      each lane sets the bits of the rays that hit its triangle
    4. are all bits of the tile set?                     a vote: then it is done, else on with 2 or 1

Neighbours are near one another because triangles stand in the order of the leaves of a binary tree. The 8 warps of a
block take tile after tile of a view; where there are few views, several blocks share one.
"""

import warp as wp

from mmocap_warp.kernels.block import LANES, Batch, blocks_of, run_of, shared_words, sync, sync_warp, warp_max
from mmocap_warp.kernels.native import native_sections
from mmocap_warp.kernels.silhouettes.counting import (
    Canvas,
    Frozen,
    add_up,
    count_word,
    frozen_word,
    is_cut,
    project_piece,
)
from mmocap_warp.kernels.silhouettes.coverage import drop, faces_camera, first_after, last_before, row_span, word_bits
from mmocap_warp.kernels.views.projection import Pinhole, Views, clip, corner, is_behind, pinhole

wp.set_module_options({"enable_backward": False})

_native = native_sections(__file__)

WIDTH = 32
"""Boxes under a node, and lanes of a warp."""

_ROWS = wp.constant(32)  # rows of a tile
_QUEUE = wp.constant(2 * WIDTH)  # triangles of a warp that wait to be marked
_BITS = wp.constant(LANES // WIDTH * 2 * WIDTH)  # where the tiles' pixels begin in the shared words
_FAR = wp.constant(2**29)


@wp.func_native(_native("ballot"))
def _ballot(vote: bool) -> wp.uint32:
    """The votes of a warp's lanes as bits; all of them must call."""


@wp.func
def _below(votes: wp.uint32, lane: int) -> int:
    """How many lanes before this one voted yes."""
    return wp.bit_count(votes & ((wp.uint32(1) << wp.uint32(lane)) - wp.uint32(1)))


@wp.struct
class Leaves:
    """A piece of a mesh, its triangles in the order of a binary tree's leaves, where neighbours are near."""

    vertex: wp.array[wp.int32]  # (vertex of the piece,)
    triangle: wp.array[wp.vec3i]  # (triangle,)


@wp.struct
class Tile:
    """Rays through a few rows of a word of pixels, and where their hits are kept in the block's shared words."""

    word: int
    first_row: int
    rows: int
    start: int


@wp.func
def _box_of(t: int, triangle: wp.array[wp.vec3i], points: wp.array[wp.vec2i], cut: bool) -> wp.vec4i:
    """First and last column and row [px] of a triangle that can be seen; none for others."""
    none = wp.vec4i(_FAR, -_FAR, _FAR, -_FAR)
    if t >= triangle.shape[0]:
        return none
    v = triangle[t]
    p = points[v[0]]
    q = points[v[1]]
    r = points[v[2]]
    if cut:
        if is_behind(p) or is_behind(q) or is_behind(r):
            return wp.vec4i(-_FAR, _FAR, -_FAR, _FAR)  # what is left of it may lie anywhere
    elif not faces_camera(p, q, r):
        return none
    return wp.vec4i(
        first_after(wp.min(p[0], wp.min(q[0], r[0]))),
        last_before(wp.max(p[0], wp.max(q[0], r[0]))),
        first_after(wp.min(p[1], wp.min(q[1], r[1]))),
        last_before(wp.max(p[1], wp.max(q[1], r[1]))),
    )


@wp.func
def _meets(box: wp.vec4i, tile: Tile) -> bool:
    left = tile.word * 32
    return box[0] <= left + 31 and box[1] >= left and box[2] < tile.first_row + tile.rows and box[3] >= tile.first_row


@wp.func
def _mark(a: wp.vec2i, b: wp.vec2i, c: wp.vec2i, tile: Tile, shared: wp.array[wp.uint32]) -> None:
    """Mark the rays that hit a projected triangle."""
    d = drop(a, b, c, tile.first_row, tile.first_row + tile.rows - 1)
    for row in range(d.first, d.last + 1):
        s = row_span(d, row)
        shared[tile.start + row - tile.first_row] |= word_bits(s[0], s[1], tile.word)


@wp.func
def _mark_clipped(
    v: wp.vec3i,
    posed: wp.array[wp.vec3],
    points: wp.array[wp.vec2i],
    camera: Pinhole,
    tile: Tile,
    shared: wp.array[wp.uint32],
) -> None:
    """Mark the rays that hit what the near plane leaves of a triangle."""
    left = clip(v, points, posed, camera)
    _mark(corner(left, 0), corner(left, 1), corner(left, 2), tile, shared)
    _mark(corner(left, 0), corner(left, 2), corner(left, 3), tile, shared)


@wp.func
def _cast(
    tile: Tile,
    queue: int,
    lane: int,
    triangle: wp.array[wp.vec3i],
    posed: wp.array[wp.vec3],
    points: wp.array[wp.vec2i],
    box: wp.array[wp.vec4i],
    group_box: wp.array[wp.vec4i],
    camera: Pinhole,
    width: int,
    cut: bool,
    shared: wp.array[wp.uint32],
) -> None:
    """Cast a tile's rays that have not hit yet, with a warp.

    Groups whose boxes it meets wait in ``to_visit``; their triangles whose boxes it meets wait in the queue, until 32
    of them, or the last, are marked.
    """
    groups = (triangle.shape[0] + WIDTH - 1) // WIDTH
    all_hit = word_bits(0, width - 1, tile.word)
    waiting = int(0)
    to_visit = wp.uint32(0)
    first = int(-WIDTH)
    while True:
        if to_visit == wp.uint32(0) and first + WIDTH < groups:
            first += WIDTH
            met = bool(False)
            if first + lane < groups:
                met = _meets(group_box[first + lane], tile)
            to_visit = _ballot(met)
        if to_visit != wp.uint32(0):
            lowest = to_visit & (~to_visit + wp.uint32(1))
            to_visit = to_visit ^ lowest
            t = (first + wp.bit_count(lowest - wp.uint32(1))) * WIDTH + lane
            hit = _meets(box[t], tile)
            hits = _ballot(hit)
            if hit:
                shared[queue + waiting + _below(hits, lane)] = wp.uint32(t)
            waiting += wp.bit_count(hits)
        is_last = to_visit == wp.uint32(0) and first + WIDTH >= groups
        if waiting >= WIDTH or (is_last and waiting > 0):
            sync_warp()
            if lane < waiting:
                v = triangle[int(shared[queue + lane])]
                if cut:
                    _mark_clipped(v, posed, points, camera, tile, shared)
                else:
                    _mark(points[v[0]], points[v[1]], points[v[2]], tile, shared)
            waiting = wp.max(waiting - WIDTH, 0)
            left_over = wp.uint32(0)
            if lane < waiting:
                left_over = shared[queue + WIDTH + lane]
            sync_warp()
            if lane < waiting:
                shared[queue + lane] = left_over
            missed = lane < tile.rows and (shared[tile.start + lane] & all_hit) != all_hit
            if _ballot(missed) == wp.uint32(0):
                break
        if is_last and waiting == 0:
            break


@wp.kernel(launch_bounds=(LANES, 3))
def _raycast_wide(
    posed: wp.array2d[wp.vec3],  # (candidate, vertex) [m]
    leaves: Leaves,  # of the moving piece
    views: Views,
    frozen: Frozen,
    batch: Batch,
    blocks: int,
    # out
    canvas: Canvas,
) -> None:
    own, k, block, thread = wp.tid()
    c = batch.first + own
    run = run_of(c, batch, frozen.words.shape[0])
    shared = shared_words(batch.scratch)
    triangle = leaves.triangle
    points = canvas.cell[c, k]
    box = canvas.box[c, k]
    group_box = canvas.group_box[c, k]
    bounds = project_piece(posed[c], leaves.vertex, views, frozen, run, k, thread, LANES, batch.scratch, points)
    cut = is_cut(frozen, run, k, batch.scratch)
    camera = pinhole(views, k)
    width = views.size[k][0]
    warp = thread // WIDTH
    lane = thread % WIDTH
    groups = (triangle.shape[0] + WIDTH - 1) // WIDTH
    total = wp.vec2i(0, 0)
    if bounds[0] <= bounds[1] and bounds[2] <= bounds[3]:
        for group in range(warp, groups, LANES // WIDTH):
            mine = _box_of(group * WIDTH + lane, triangle, points, cut)
            box[group * WIDTH + lane] = mine
            left = -warp_max(-mine[0])
            right = warp_max(mine[1])
            top = -warp_max(-mine[2])
            bottom = warp_max(mine[3])
            if lane == 0:
                group_box[group] = wp.vec4i(left, right, top, bottom)
        sync()
        first_word = bounds[2] >> 5
        words = (bounds[3] >> 5) - first_word + 1
        tiles = ((bounds[1] - bounds[0]) // _ROWS + 1) * words
        tile = Tile()
        tile.start = _BITS + warp * WIDTH
        for i in range(warp + block * (LANES // WIDTH), tiles, blocks * (LANES // WIDTH)):
            tile.word = first_word + i % words
            tile.first_row = bounds[0] + i // words * _ROWS
            tile.rows = wp.min(_ROWS, bounds[1] - tile.first_row + 1)
            if lane < tile.rows:
                shared[tile.start + lane] = frozen_word(frozen, run, k, tile.first_row + lane, tile.word)
            _cast(tile, warp * _QUEUE, lane, triangle, posed[c], points, box, group_box, camera, width, cut, shared)
            sync_warp()
            if lane < tile.rows:
                hits = shared[tile.start + lane] & word_bits(0, width - 1, tile.word)
                total += count_word(hits, views, frozen, run, k, tile.first_row + lane, tile.word)
    add_up(total, frozen, run, c, k, thread, block, blocks, batch.scratch, canvas.count)


def raycast_wide(
    posed: wp.array[wp.vec3], leaves: Leaves, views: Views, frozen: Frozen, batch: Batch, canvas: Canvas
) -> None:
    """The same as :func:`~mmocap_warp.kernels.silhouettes.raycast.raycast`, on a GPU.

    ``canvas.box`` has room for whole groups of ``WIDTH`` triangles.
    """
    cameras = views.size.shape[0]
    blocks = blocks_of(posed.device, batch.size * cameras)
    if blocks > 1:
        canvas.count.zero_()
    dim = (batch.size, cameras, blocks, LANES)
    inputs = [posed, leaves, views, frozen, batch, blocks]
    wp.launch(_raycast_wide, dim, inputs, [canvas], block_dim=LANES, device=posed.device)
