"""Silhouettes by packets of rays on a GPU: a warp casts a packet, its 32 lanes test 32 boxes or triangles at a time.

The tree has two levels, 32 wide: boxes of single triangles, in the order of the binary tree's leaves, and boxes of 32
of these. A packet's warp tests the upper boxes, then those under each one that it meets, collects the triangles that
it may hit, and marks the pixels of 32 triangles at once. It stops when all its rays have hit. See ``raycast.py``.
"""

import warp as wp

from mmocap_warp.kernels.block import LANES, shared_words, sync, sync_warp, warp_max
from mmocap_warp.kernels.silhouettes.counting import (
    Cameras,
    Frozen,
    add_up,
    count_word,
    frozen_word,
    is_cut,
    pinhole,
    project_body,
)
from mmocap_warp.kernels.silhouettes.coverage import (
    drop,
    faces_camera,
    first_after,
    is_behind,
    last_before,
    row_span,
    word_bits,
)
from mmocap_warp.kernels.views.near_plane import clip, corner
from mmocap_warp.kernels.views.projection import Pinhole

wp.set_module_options({"enable_backward": False})

WIDTH = 32
"""Boxes under a node, and lanes of a warp."""

_ROWS = wp.constant(32)  # of a packet
_QUEUE = wp.constant(2 * WIDTH)  # triangles that wait to be marked, a warp
_BITS = wp.constant(LANES // WIDTH * 2 * WIDTH)  # where the packets' pixels begin in the shared words
_FAR = wp.constant(2**29)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __ballot_sync(0xFFFFFFFFu, vote);
#else
    return vote ? 1u : 0u;
#endif
""")
def _ballot(vote: bool) -> wp.uint32:
    """The votes of a warp's lanes as bits; all of them must call."""
    ...


@wp.func
def _below(votes: wp.uint32, lane: int) -> int:
    """How many lanes before this one voted yes."""
    return wp.bit_count(votes & ((wp.uint32(1) << wp.uint32(lane)) - wp.uint32(1)))


@wp.struct
class Packet:
    """Rays through a few rows of a word of pixels, and where their hits are kept in the block's shared words."""

    word: int
    first_row: int
    rows: int
    start: int


@wp.func
def _box_of(
    t: int,
    triangle: wp.array[wp.vec3i],
    points: wp.array[wp.vec2i],
    cut: bool,
) -> wp.vec4i:
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
def _meets(box: wp.vec4i, packet: Packet) -> bool:
    left = packet.word * 32
    return (
        box[0] <= left + 31
        and box[1] >= left
        and box[2] < packet.first_row + packet.rows
        and box[3] >= packet.first_row
    )


@wp.func
def _mark(a: wp.vec2i, b: wp.vec2i, c: wp.vec2i, packet: Packet, shared: wp.array[wp.uint32]):
    """Mark the rays that hit a projected triangle."""
    d = drop(a, b, c, packet.first_row, packet.first_row + packet.rows - 1)
    for row in range(d.first, d.last + 1):
        s = row_span(d, row)
        shared[packet.start + row - packet.first_row] |= word_bits(s[0], s[1], packet.word)


@wp.func
def _mark_clipped(
    v: wp.vec3i,
    posed: wp.array[wp.vec3],
    points: wp.array[wp.vec2i],
    camera: Pinhole,
    packet: Packet,
    shared: wp.array[wp.uint32],
):
    """Mark the rays that hit what the near plane leaves of a triangle."""
    left = clip(v, points, posed, camera)
    _mark(corner(left, 0), corner(left, 1), corner(left, 2), packet, shared)
    _mark(corner(left, 0), corner(left, 2), corner(left, 3), packet, shared)


@wp.func
def _cast(
    packet: Packet,
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
):
    """Cast a packet's rays that have not hit yet, with a warp.

    Groups whose boxes it meets wait in ``to_visit``; their triangles whose boxes it meets wait in the queue, until 32
    of them, or the last, are marked.
    """
    groups = (triangle.shape[0] + WIDTH - 1) // WIDTH
    all_hit = word_bits(0, width - 1, packet.word)
    waiting = int(0)
    to_visit = wp.uint32(0)
    first = int(-WIDTH)
    while True:
        if to_visit == wp.uint32(0) and first + WIDTH < groups:
            first += WIDTH
            met = bool(False)
            if first + lane < groups:
                met = _meets(group_box[first + lane], packet)
            to_visit = _ballot(met)
        if to_visit != wp.uint32(0):
            lowest = to_visit & (~to_visit + wp.uint32(1))
            to_visit = to_visit ^ lowest
            t = (first + wp.bit_count(lowest - wp.uint32(1))) * WIDTH + lane
            hit = _meets(box[t], packet)
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
                    _mark_clipped(v, posed, points, camera, packet, shared)
                else:
                    _mark(points[v[0]], points[v[1]], points[v[2]], packet, shared)
            waiting = wp.max(waiting - WIDTH, 0)
            left_over = wp.uint32(0)
            if lane < waiting:
                left_over = shared[queue + WIDTH + lane]
            sync_warp()
            if lane < waiting:
                shared[queue + lane] = left_over
            missed = lane < packet.rows and (shared[packet.start + lane] & all_hit) != all_hit
            if _ballot(missed) == wp.uint32(0):
                break
        if is_last and waiting == 0:
            break


@wp.kernel(launch_bounds=(LANES, 3))
def _raycast_wide(
    posed: wp.array2d[wp.vec3],  # (candidate, vertex) [m]
    vertex: wp.array[wp.int32],  # (moved vertex,)
    triangle: wp.array[wp.vec3i],  # (moved triangle,) in leaf order
    cameras: Cameras,
    frozen: Frozen,
    parts: int,
    scratch: wp.array[wp.uint32],
    # out
    image: wp.array3d[wp.vec2i],  # (candidate, camera, vertex) cells
    box: wp.array3d[wp.vec4i],  # (candidate, camera, moved triangle) columns and rows
    group_box: wp.array3d[wp.vec4i],  # (candidate, camera, group) columns and rows
    count: wp.array2d[wp.vec2i],  # (candidate, camera) |M|, |M and F|
):
    c, k, part, thread = wp.tid()
    shared = shared_words(scratch)
    points = image[c, k]
    boxes = box[c, k]
    group_boxes = group_box[c, k]
    bounds = project_body(posed[c], vertex, cameras, frozen, c, k, thread, LANES, scratch, points)
    cut = is_cut(frozen, c, k, scratch)
    camera = pinhole(cameras, k)
    width = cameras.size[k][0]
    warp = thread // WIDTH
    lane = thread % WIDTH
    groups = (triangle.shape[0] + WIDTH - 1) // WIDTH
    total = wp.vec2i(0, 0)
    if bounds[0] <= bounds[1] and bounds[2] <= bounds[3]:
        for group in range(warp, groups, LANES // WIDTH):
            own = _box_of(group * WIDTH + lane, triangle, points, cut)
            boxes[group * WIDTH + lane] = own
            left = -warp_max(-own[0])
            right = warp_max(own[1])
            top = -warp_max(-own[2])
            bottom = warp_max(own[3])
            if lane == 0:
                group_boxes[group] = wp.vec4i(left, right, top, bottom)
        sync()
        first_word = bounds[2] >> 5
        words = (bounds[3] >> 5) - first_word + 1
        packets = ((bounds[1] - bounds[0]) // _ROWS + 1) * words
        packet = Packet()
        packet.start = _BITS + warp * WIDTH
        for i in range(warp + part * (LANES // WIDTH), packets, parts * (LANES // WIDTH)):
            packet.word = first_word + i % words
            packet.first_row = bounds[0] + i // words * _ROWS
            packet.rows = wp.min(_ROWS, bounds[1] - packet.first_row + 1)
            if lane < packet.rows:
                shared[packet.start + lane] = frozen_word(frozen, c, k, packet.first_row + lane, packet.word)
            _cast(
                packet, warp * _QUEUE, lane, triangle, posed[c], points, boxes, group_boxes, camera, width, cut, shared
            )
            sync_warp()
            if lane < packet.rows:
                hits = shared[packet.start + lane] & word_bits(0, width - 1, packet.word)
                total += count_word(hits, cameras, frozen, c, k, packet.first_row + lane, packet.word)
    add_up(total, frozen, c, k, thread, part, parts, scratch, count)


def raycast_wide(posed, vertex, triangle, cameras, frozen, parts, scratch, image, box, group_box, count):
    """The same as :func:`~mmocap_warp.kernels.silhouettes.raycast.raycast`, on a GPU.

    ``parts`` blocks share a candidate's view, where a block each would leave most of the chip idle. ``box`` has room
    for whole groups of ``WIDTH`` triangles.
    """
    if parts > 1:
        count.zero_()
    wp.launch(
        _raycast_wide,
        dim=(*count.shape, parts, LANES),
        inputs=[posed, vertex, triangle, cameras, frozen, parts, scratch],
        outputs=[image, box, group_box, count],
        block_dim=LANES,
        device=count.device,
    )
