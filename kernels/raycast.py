"""Silhouettes by packets of rays: 32 x 8 pixel centres share one traversal of a BVH in image space.

The tree is built once over the rest pose; each candidate and camera refits its boxes around the projected triangles
that face the camera. A packet walks the tree once, marks the pixels that each triangle covers as bits, stops when
all its rays have hit, and is counted against the observed mask in place: no image is ever stored.

A node is ``(skip, first, count, level)``: where to go when its box is missed, and for a leaf its run of triangles.
Nodes stand in depth-first order, so the next node is the first child and a child always has a higher number.
"""

import warp as wp

from mmocap_warp.kernels.coverage import faces_camera, first_pixel, last_pixel, slope, span, word_bits
from mmocap_warp.kernels.projection import SUBPIXEL

wp.set_module_options({"enable_backward": False})

PACKET_ROWS = 8
PacketBits = wp.types.vector(length=PACKET_ROWS, dtype=wp.uint32)

_EMPTY_LOW = wp.constant(2**29)
_EMPTY_HIGH = wp.constant(-(2**29))


@wp.func
def _leaf_box(
    node: wp.vec4i,
    triangle: wp.array[wp.vec3i],
    image: wp.array3d[wp.vec2i],
    c: int,
    k: int,
) -> wp.vec4i:
    box = wp.vec4i(_EMPTY_LOW, _EMPTY_LOW, _EMPTY_HIGH, _EMPTY_HIGH)
    for t in range(node[1], node[1] + node[2]):
        corner = triangle[t]
        p, q, r = image[c, k, corner[0]], image[c, k, corner[1]], image[c, k, corner[2]]
        if faces_camera(p, q, r):
            box = wp.vec4i(
                wp.min(box[0], wp.min(p[0], wp.min(q[0], r[0]))),
                wp.min(box[1], wp.min(p[1], wp.min(q[1], r[1]))),
                wp.max(box[2], wp.max(p[0], wp.max(q[0], r[0]))),
                wp.max(box[3], wp.max(p[1], wp.max(q[1], r[1]))),
            )
    return box


@wp.func
def _refit_node(
    n: int,
    node: wp.array[wp.vec4i],
    triangle: wp.array[wp.vec3i],
    image: wp.array3d[wp.vec2i],
    c: int,
    k: int,
    box: wp.array3d[wp.vec4i],
):
    this = node[n]
    if this[2] > 0:
        box[c, k, n] = _leaf_box(this, triangle, image, c, k)
    else:
        left = box[c, k, n + 1]
        right = box[c, k, node[n + 1][0]]
        box[c, k, n] = wp.vec4i(
            wp.min(left[0], right[0]),
            wp.min(left[1], right[1]),
            wp.max(left[2], right[2]),
            wp.max(left[3], right[3]),
        )


@wp.kernel
def _refit(
    node: wp.array[wp.vec4i],  # (node,)
    triangle: wp.array[wp.vec3i],  # (triangle,) in leaf order
    image: wp.array3d[wp.vec2i],  # (candidate, camera, vertex)
    # out
    box: wp.array3d[wp.vec4i],  # (candidate, camera, node) x_min y_min x_max y_max
):
    c, k = wp.tid()
    last = node.shape[0] - 1
    for i in range(node.shape[0]):
        _refit_node(last - i, node, triangle, image, c, k, box)


@wp.kernel
def _refit_level(
    level: wp.array[wp.int32],  # (node of the level,)
    node: wp.array[wp.vec4i],  # (node,)
    triangle: wp.array[wp.vec3i],  # (triangle,) in leaf order
    image: wp.array3d[wp.vec2i],  # (candidate, camera, vertex)
    # out
    box: wp.array3d[wp.vec4i],  # (candidate, camera, node)
):
    c, k, i = wp.tid()
    _refit_node(level[i], node, triangle, image, c, k, box)


def refit(node, levels, triangle, image, box):
    """Fit the boxes of every candidate and camera around the projected facing triangles [px / SUBPIXEL].

    On the CPU one thread walks the nodes from the last to the first; on a GPU a launch does each of the tree's
    ``levels`` (node numbers, the deepest first).
    """
    candidates, cameras, _ = box.shape
    if box.device.is_cpu:
        wp.launch(_refit, dim=(candidates, cameras), inputs=[node, triangle, image], outputs=[box], device=box.device)
        return
    for level in levels:
        wp.launch(
            _refit_level,
            dim=(candidates, cameras, level.shape[0]),
            inputs=[level, node, triangle, image],
            outputs=[box],
            device=box.device,
        )


@wp.func
def _cast_packet(
    word: int,
    row_min: int,
    rows: int,
    width: int,
    node: wp.array[wp.vec4i],
    triangle: wp.array[wp.vec3i],
    image: wp.array3d[wp.vec2i],
    box: wp.array3d[wp.vec4i],
    c: int,
    k: int,
) -> PacketBits:
    """The pixels of a packet that the body covers; bit ``x`` of element ``y``."""
    x_min = word * 32 * SUBPIXEL
    x_max = x_min + 31 * SUBPIXEL
    y_min = row_min * SUBPIXEL
    y_max = (row_min + rows - 1) * SUBPIXEL
    all_hit = word_bits(0, width - 1, word)
    bits = PacketBits()
    n = int(0)
    while n < node.shape[0]:
        b = box[c, k, n]
        this = node[n]
        if b[0] > x_max or b[2] < x_min or b[1] > y_max or b[3] < y_min:
            n = this[0]
        elif this[2] == 0:
            n += 1
        else:
            for t in range(this[1], this[1] + this[2]):
                corner = triangle[t]
                p, q, r = image[c, k, corner[0]], image[c, k, corner[1]], image[c, k, corner[2]]
                if faces_camera(p, q, r):
                    low = wp.max(first_pixel(wp.min(p[1], wp.min(q[1], r[1]))) - row_min, 0)
                    high = wp.min(last_pixel(wp.max(p[1], wp.max(q[1], r[1]))) - row_min, rows - 1)
                    if low <= high:
                        pq, qr, rp = slope(p, q), slope(q, r), slope(r, p)
                        for y in range(low, high + 1):
                            s = span(p, q, r, pq, qr, rp, row_min + y, width)
                            bits[y] = bits[y] | word_bits(s[0], s[1], word)
            full = all_hit
            for y in range(rows):
                full = full & bits[y]
            n = wp.where(full == all_hit, node.shape[0], this[0])
    return bits


@wp.func
def _count_packet(
    bits: PacketBits,
    word: int,
    row_min: int,
    rows: int,
    observed: wp.array3d[wp.uint32],
    k: int,
) -> wp.vec2i:
    model = int(0)
    overlap = int(0)
    for y in range(rows):
        model += wp.bit_count(bits[y])
        overlap += wp.bit_count(bits[y] & observed[k, row_min + y, word])
    return wp.vec2i(model, overlap)


@wp.kernel
def _cast(
    node: wp.array[wp.vec4i],  # (node,)
    triangle: wp.array[wp.vec3i],  # (triangle,)
    image: wp.array3d[wp.vec2i],  # (candidate, camera, vertex)
    box: wp.array3d[wp.vec4i],  # (candidate, camera, node)
    size: wp.array[wp.vec2i],  # (camera,) width height [px]
    observed: wp.array3d[wp.uint32],  # (camera, row, word)
    # out
    count: wp.array2d[wp.vec2i],  # (candidate, camera) |M|, |M and F|
):
    c, k = wp.tid()
    width, height = size[k][0], size[k][1]
    root = box[c, k, 0]
    word_first = wp.max(first_pixel(root[0]), 0) // 32
    word_last = wp.min(last_pixel(root[2]), width - 1) // 32
    packet_first = wp.max(first_pixel(root[1]), 0) // PACKET_ROWS
    packet_last = wp.min(last_pixel(root[3]), height - 1) // PACKET_ROWS
    total = wp.vec2i(0, 0)
    if root[0] <= root[2] and last_pixel(root[2]) >= 0 and last_pixel(root[3]) >= 0:
        for packet in range(packet_first, packet_last + 1):
            row_min = packet * PACKET_ROWS
            rows = wp.min(PACKET_ROWS, height - row_min)
            for word in range(word_first, word_last + 1):
                bits = _cast_packet(word, row_min, rows, width, node, triangle, image, box, c, k)
                total += _count_packet(bits, word, row_min, rows, observed, k)
    count[c, k] = total


@wp.kernel
def _cast_each(
    node: wp.array[wp.vec4i],  # (node,)
    triangle: wp.array[wp.vec3i],  # (triangle,)
    image: wp.array3d[wp.vec2i],  # (candidate, camera, vertex)
    box: wp.array3d[wp.vec4i],  # (candidate, camera, node)
    size: wp.array[wp.vec2i],  # (camera,) width height [px]
    observed: wp.array3d[wp.uint32],  # (camera, row, word)
    # out
    count: wp.array2d[wp.vec2i],  # (candidate, camera), zeroed
):
    c, k, packet, word = wp.tid()
    width, height = size[k][0], size[k][1]
    row_min = packet * PACKET_ROWS
    rows = wp.min(PACKET_ROWS, height - row_min)
    if rows > 0 and word * 32 < width:
        bits = _cast_packet(word, row_min, rows, width, node, triangle, image, box, c, k)
        found = _count_packet(bits, word, row_min, rows, observed, k)
        if found[0] > 0:
            wp.atomic_add(count, c, k, found)


def cast(node, triangle, image, box, size, observed, count):
    """Count pixels: ``count[c, k] = (|M|, |M and F|)`` of candidate ``c``'s silhouette M and camera ``k``'s mask F.

    On the CPU one thread casts all packets of a candidate and camera, on a GPU each packet has its own.
    """
    inputs = [node, triangle, image, box, size, observed]
    if count.device.is_cpu:
        wp.launch(_cast, dim=count.shape, inputs=inputs, outputs=[count], device=count.device)
        return
    _, rows, words = observed.shape
    count.zero_()
    packets = (rows + PACKET_ROWS - 1) // PACKET_ROWS
    wp.launch(_cast_each, dim=(*count.shape, packets, words), inputs=inputs, outputs=[count], device=count.device)
