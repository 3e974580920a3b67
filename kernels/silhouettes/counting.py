"""What both renderers begin and end with: projecting a block's body, and counting against the mask.

A renderer draws the moving piece of the mesh over the frozen silhouette of the resting piece, which is drawn once for
all candidates of a run. A block of lanes draws one candidate in one camera.
"""

import warp as wp

from mmocap_warp.kernels.block import NUMBERS, shared_numbers, sync, warp_max, warp_sum
from mmocap_warp.kernels.silhouettes.coverage import first_after, last_before
from mmocap_warp.kernels.views.projection import Views, is_behind, pinhole, project

wp.set_module_options({"enable_backward": False})

Bounds = wp.vec4i
"""First and last row, first and last column of what may be covered [px]; none if a first > its last."""

_NOWHERE = wp.constant(-(2**29))
_CUT, _LEFT, _RIGHT, _TOP, _BOTTOM, _MODEL, _OVERLAP = (wp.constant(i) for i in range(7))


@wp.struct
class Canvas:
    """What renderers work in, and what they count; a renderer leaves empty what it has no use for."""

    cell: wp.array3d[wp.vec2i]  # (candidate, camera, vertex) projected vertices
    facing: wp.array3d[wp.uint8]  # (candidate, camera, triangle) whether it shows the camera its outside
    box: wp.array3d[wp.vec4i]  # (candidate, camera, node) of a tree
    group_box: wp.array3d[wp.vec4i]  # (candidate, camera, group) of the wide tree
    count: wp.array2d[wp.vec2i]  # (candidate, camera) |M|, |M and F|


@wp.struct
class Frozen:
    """Silhouettes of the resting piece, drawn and counted; no runs where everything moves."""

    words: wp.array4d[wp.uint32]  # (run, camera, row, word)
    count: wp.array2d[wp.vec2i]  # (run, camera) |M|, |M and F|
    cut: wp.array2d[wp.int32]  # (run, camera) whether the near plane cuts it


@wp.func
def project_piece(
    posed: wp.array[wp.vec3],
    vertex: wp.array[wp.int32],
    views: Views,
    frozen: Frozen,
    run: int,
    k: int,
    lane: int,
    lanes: int,
    scratch: wp.array[wp.uint32],
    points: wp.array[wp.vec2i],
) -> Bounds:
    """Project the vertices and find the pixels that they may cover: all, where the near plane cuts the body."""
    camera = pinhole(views, k)
    numbers = shared_numbers(scratch)
    for i in range(lane, NUMBERS, lanes):
        numbers[i] = wp.where(i >= _LEFT and i <= _BOTTOM, _NOWHERE, 0)
    sync()
    behind = int(0)
    left, right, top, bottom = int(_NOWHERE), int(_NOWHERE), int(_NOWHERE), int(_NOWHERE)
    for i in range(lane, vertex.shape[0], lanes):
        v = vertex[i]
        at = project(posed[v], camera)
        points[v] = at
        if is_behind(at):
            behind = 1
        else:
            left = wp.max(left, -at[0])
            right = wp.max(right, at[0])
            top = wp.max(top, -at[1])
            bottom = wp.max(bottom, at[1])
    behind = warp_max(behind)
    left, right, top, bottom = warp_max(left), warp_max(right), warp_max(top), warp_max(bottom)
    if lane % 32 == 0:
        wp.atomic_max(numbers, _CUT, behind)
        wp.atomic_max(numbers, _LEFT, left)
        wp.atomic_max(numbers, _RIGHT, right)
        wp.atomic_max(numbers, _TOP, top)
        wp.atomic_max(numbers, _BOTTOM, bottom)
    sync()
    width, height = views.size[k][0], views.size[k][1]
    if is_cut(frozen, run, k, scratch):
        return wp.vec4i(0, height - 1, 0, width - 1)
    if numbers[_RIGHT] == _NOWHERE:
        return wp.vec4i(0, -1, 0, -1)
    return wp.vec4i(
        wp.max(first_after(-numbers[_TOP]), 0),
        wp.min(last_before(numbers[_BOTTOM]), height - 1),
        wp.max(first_after(-numbers[_LEFT]), 0),
        wp.min(last_before(numbers[_RIGHT]), width - 1),
    )


@wp.func
def is_cut(frozen: Frozen, run: int, k: int, scratch: wp.array[wp.uint32]) -> bool:
    """Whether the near plane cuts the body, its resting piece included; known once the moving piece is projected."""
    numbers = shared_numbers(scratch)
    if run >= 0:
        return numbers[_CUT] + frozen.cut[run, k] > 0
    return numbers[_CUT] > 0


@wp.func
def frozen_word(frozen: Frozen, run: int, k: int, row: int, word: int) -> wp.uint32:
    """The frozen silhouette's pixels in a word."""
    if run >= 0:
        return frozen.words[run, k, row, word]
    return wp.uint32(0)


@wp.func
def count_word(bits: wp.uint32, views: Views, frozen: Frozen, run: int, k: int, row: int, word: int) -> wp.vec2i:
    """What a word of the moving piece's pixels adds to the frozen silhouette's counts."""
    added = bits & ~frozen_word(frozen, run, k, row, word)
    if views.hidden.shape[0] > 0:
        added = added & ~views.hidden[k, row, word]
    if added == wp.uint32(0):
        return wp.vec2i(0, 0)
    return wp.vec2i(wp.bit_count(added), wp.bit_count(added & views.observed[k, row, word]))


@wp.func
def add_up(
    mine: wp.vec2i,
    frozen: Frozen,
    run: int,
    c: int,
    k: int,
    lane: int,
    block: int,
    blocks: int,
    scratch: wp.array[wp.uint32],
    count: wp.array2d[wp.vec2i],
) -> None:
    """Sum what the lanes of a block counted, and what is frozen, into ``count[c, k]``.

    Where several blocks share a view, each adds what it counted to a count that begins at zero.
    """
    numbers = shared_numbers(scratch)
    model, overlap = warp_sum(mine[0]), warp_sum(mine[1])
    if lane % 32 == 0:
        wp.atomic_add(numbers, _MODEL, model)
        wp.atomic_add(numbers, _OVERLAP, overlap)
    sync()
    if lane == 0:
        total = wp.vec2i(numbers[_MODEL], numbers[_OVERLAP])
        if run >= 0 and block == 0:
            total += frozen.count[run, k]
        if blocks > 1:
            wp.atomic_add(count, c, k, total)
        else:
            count[c, k] = total
