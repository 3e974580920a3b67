r"""Silhouettes by packets of rays on the CPU: up to 256 x 128 pixels share one traversal of a BVH.

The idea: a silhouette only asks whether a pixel's ray hits anything. All rays of a packet ask the tree together: a
box that the packet misses is skipped with all that is below it, a triangle sets the bits of all rays that hit it, row
by row, and the packet is done as soon as all of its bits are set. A body hardly ever fills a packet: it
is the boxes that save work, see ``docs/performance.md``.

    the image                 the tree                       bits of one row of the packet
    +--------+                     root                      before        ....11111.......
    | packet |   .---.            /    \                     a triangle    ........1111....
    |    .---|.  | B |       box A     box B: missed,        after         ....11111111....
    |    | A ||  '---'      /     \    skip to what
    +----|---+|         triangles  ... comes after it
         '----'

The tree is built once over the rest pose. Each candidate and camera fits its boxes anew, in the image, around the
projected triangles that face the camera. What a packet hit is counted against the observed mask in place: no image is
ever stored.

A node is ``(skip, first, count)``: where to go when its box is missed, and for a leaf its run of triangles. Nodes
stand in depth-first order, so the next node is the first child, and boxes can be fitted from the last to the first.

A GPU's threads would each go their own way through such a tree: ``raycast_wide.py`` is for them.
"""

import warp as wp

from mmocap_warp.kernels.block import CPU_FLAGS, Batch, run_of, shared_words
from mmocap_warp.kernels.silhouettes.counting import (
    Canvas,
    Frozen,
    add_up,
    count_word,
    frozen_word,
    is_cut,
    project_piece,
)
from mmocap_warp.kernels.silhouettes.coverage import drop, faces_camera, last_before, row_span, word_bits
from mmocap_warp.kernels.views.projection import Pinhole, Views, clip, corner, is_behind, pinhole

wp.set_module_options({"enable_backward": False, "cpu_compiler_flags": CPU_FLAGS})

_ROWS = wp.constant(128)  # most rows of a packet of rays
_WORDS = wp.constant(8)  # most words of 32 rays in a row of a packet
_ALL = wp.constant(wp.uint32(0xFFFFFFFF))
_EMPTY_LOW = wp.constant(2**29)
_EMPTY_HIGH = wp.constant(-(2**29))


@wp.struct
class Tree:
    """A piece of a mesh, its triangles in a BVH; see :func:`mmocap_warp.silhouettes.silhouettes.build_bvh`."""

    vertex: wp.array[wp.int32]  # (vertex of the piece,)
    node: wp.array[wp.vec3i]  # (node,)
    triangle: wp.array[wp.vec3i]  # (triangle,) in leaf order


@wp.func
def _leaf_box(
    node: wp.vec3i, tree: Tree, points: wp.array[wp.vec2i], cut: bool, facing: wp.array[wp.uint8]
) -> wp.vec4i:
    """The box of a leaf's visible triangles, which are noted: those that face the camera, or all where it is cut."""
    box = wp.vec4i(_EMPTY_LOW, _EMPTY_LOW, _EMPTY_HIGH, _EMPTY_HIGH)
    for t in range(node[1], node[1] + node[2]):
        v = tree.triangle[t]
        p = points[v[0]]
        q = points[v[1]]
        r = points[v[2]]
        is_visible = cut or faces_camera(p, q, r)
        facing[t] = wp.uint8(is_visible)
        if cut and (is_behind(p) or is_behind(q) or is_behind(r)):
            box = wp.vec4i(_EMPTY_HIGH, _EMPTY_HIGH, _EMPTY_LOW, _EMPTY_LOW)  # clipped points may lie anywhere
        elif is_visible:
            box = wp.vec4i(
                wp.min(box[0], wp.min(p[0], wp.min(q[0], r[0]))),
                wp.min(box[1], wp.min(p[1], wp.min(q[1], r[1]))),
                wp.max(box[2], wp.max(p[0], wp.max(q[0], r[0]))),
                wp.max(box[3], wp.max(p[1], wp.max(q[1], r[1]))),
            )
    return box


@wp.func
def _refit(
    tree: Tree, points: wp.array[wp.vec2i], cut: bool, facing: wp.array[wp.uint8], box: wp.array[wp.vec4i]
) -> None:
    """Fit the boxes of a candidate and camera around its triangles, from the last node to the first."""
    for i in range(tree.node.shape[0]):
        n = tree.node.shape[0] - 1 - i
        node = tree.node[n]
        if node[2] > 0:
            box[n] = _leaf_box(node, tree, points, cut, facing)
        else:
            left = box[n + 1]
            right = box[tree.node[n + 1][0]]
            box[n] = wp.vec4i(
                wp.min(left[0], right[0]),
                wp.min(left[1], right[1]),
                wp.max(left[2], right[2]),
                wp.max(left[3], right[3]),
            )


@wp.struct
class Packet:
    """Rays through some rows of a few words of pixels."""

    word: int
    words: int
    first_row: int
    rows: int


@wp.func
def _hit(a: wp.vec2i, b: wp.vec2i, c: wp.vec2i, packet: Packet, bits: wp.array[wp.uint32]) -> None:
    """Mark the rays that hit a projected triangle."""
    left = packet.word * 32
    right = left + packet.words * 32 - 1
    if wp.max(a[0], wp.max(b[0], c[0])) < left * 16 or wp.min(a[0], wp.min(b[0], c[0])) >= right * 16:
        return
    d = drop(a, b, c, packet.first_row, packet.first_row + packet.rows - 1)
    for row in range(d.first, d.last + 1):
        s = row_span(d, row)
        first = wp.max(s[0], left)
        last = wp.min(s[1], right)
        if first <= last:
            at = (row - packet.first_row) * packet.words - packet.word
            for word in range(first >> 5, (last >> 5) + 1):
                bits[at + word] |= word_bits(first, last, word)


@wp.func
def _hit_clipped(
    v: wp.vec3i,
    posed: wp.array[wp.vec3],
    points: wp.array[wp.vec2i],
    camera: Pinhole,
    packet: Packet,
    bits: wp.array[wp.uint32],
) -> None:
    """Mark the rays that hit what the near plane leaves of a triangle."""
    left = clip(v, points, posed, camera)
    _hit(corner(left, 0), corner(left, 1), corner(left, 2), packet, bits)
    _hit(corner(left, 0), corner(left, 2), corner(left, 3), packet, bits)


@wp.func
def _cast(
    packet: Packet,
    tree: Tree,
    posed: wp.array[wp.vec3],
    points: wp.array[wp.vec2i],
    facing: wp.array[wp.uint8],
    box: wp.array[wp.vec4i],
    camera: Pinhole,
    cut: bool,
    bits: wp.array[wp.uint32],
) -> None:
    """Cast a packet's rays that have not hit yet.

    The nodes lie in depth-first order. So the walk goes on to the next node where a box is entered, and skips all that
    is below where it is not: no stack is needed. It ends as soon as all rays have hit something.
    """
    first_column = packet.word * 32
    last_column = first_column + packet.words * 32 - 1
    last_row = packet.first_row + packet.rows - 1
    rays = packet.rows * packet.words
    n = int(0)
    while n < tree.node.shape[0]:
        b = box[n]
        node = tree.node[n]
        # The box lies beside the packet: skip what is below it.
        if (
            last_before(b[0]) >= last_column
            or last_before(b[2]) < first_column
            or last_before(b[1]) >= last_row
            or last_before(b[3]) < packet.first_row
        ):
            n = node[0]
        # An inner node: enter it.
        elif node[2] == 0:
            n += 1
        # A leaf: mark the rays that hit its visible triangles.
        else:
            for t in range(node[1], node[1] + node[2]):
                if facing[t] != wp.uint8(0):
                    v = tree.triangle[t]
                    if cut:
                        _hit_clipped(v, posed, points, camera, packet, bits)
                    else:
                        _hit(points[v[0]], points[v[1]], points[v[2]], packet, bits)
            # Stop if the rays of all words have hit.
            hit = int(0)
            while hit < rays and bits[hit] == _ALL:
                hit += 1
            n = wp.where(hit == rays, tree.node.shape[0], node[0])


@wp.kernel
def _raycast(
    posed: wp.array2d[wp.vec3],  # (candidate, vertex) [m]
    tree: Tree,  # of the moving piece
    views: Views,
    frozen: Frozen,
    batch: Batch,
    # out
    canvas: Canvas,
) -> None:
    own, k = wp.tid()
    c = batch.first + own
    run = run_of(c, batch, frozen.words.shape[0])
    scratch = batch.scratch
    bits = shared_words(scratch)
    points = canvas.cell[c, k]
    facing = canvas.facing[c, k]
    box = canvas.box[c, k]
    bounds = project_piece(posed[c], tree.vertex, views, frozen, run, k, 0, 1, scratch, points)
    cut = is_cut(frozen, run, k, scratch)
    total = wp.vec2i(0, 0)
    if bounds[0] <= bounds[1] and bounds[2] <= bounds[3]:
        camera = pinhole(views, k)
        width = views.size[k][0]
        _refit(tree, points, cut, facing, box)
        # Packet after packet: begin with what the frozen rest covers, cast, and count.
        packet = Packet()
        for first_row in range(bounds[0], bounds[1] + 1, _ROWS):
            packet.first_row = first_row
            packet.rows = wp.min(_ROWS, bounds[1] - first_row + 1)
            for word in range(bounds[2] >> 5, (bounds[3] >> 5) + 1, _WORDS):
                packet.word = word
                packet.words = wp.min(_WORDS, (bounds[3] >> 5) + 1 - word)
                for row in range(packet.rows):
                    for w in range(packet.words):
                        bits[row * packet.words + w] = frozen_word(frozen, run, k, first_row + row, word + w)
                _cast(packet, tree, posed[c], points, facing, box, camera, cut, bits)
                for row in range(packet.rows):
                    for w in range(packet.words):
                        hits = bits[row * packet.words + w] & word_bits(0, width - 1, word + w)
                        total += count_word(hits, views, frozen, run, k, first_row + row, word + w)
    add_up(total, frozen, run, c, k, 0, 0, 1, scratch, canvas.count)


def raycast(posed: wp.array[wp.vec3], tree: Tree, views: Views, frozen: Frozen, batch: Batch, canvas: Canvas) -> None:
    """Count pixels: ``count[c, k] = (|M|, |M and F|)`` of candidate ``c``'s silhouette M and camera ``k``'s mask F.

    ``posed`` is (candidate, vertex) [m]; ``tree`` holds the moving piece, ``frozen`` the silhouettes of the rest.
    """
    wp.launch(
        _raycast, (batch.size, views.size.shape[0]), [posed, tree, views, frozen, batch], [canvas], device=posed.device
    )
