"""How far the masks' contours lie from the outline of a posed body, along its normals.

Each outline edge looks in and out along its normal for the nearest place where the mask ends: where the signed
distance to the mask's contour, negative inside, turns positive on the way out. Residuals count outward [px]. Their
weights make a Huber estimate, and the scale of all is in millimetres at the body, so that near and far cameras and
small and large images mean the same.
"""

import warp as wp

from mmocap_warp.kernels.block import CPU_FLAGS, VIEW_LANES, Batch, lanes_of
from mmocap_warp.kernels.contour.outline import Outline, is_outline, on_outline
from mmocap_warp.kernels.launching import launch
from mmocap_warp.kernels.views.projection import Views

wp.set_module_options({"enable_backward": False, "cpu_compiler_flags": CPU_FLAGS})

FARTHEST = 8
"""Signed distances are cut off so many pixels from a contour, half a pixel less."""

_BLOCK = 64  # threads of a block: few, so that a few views fill a whole GPU too
_SURE = wp.constant(FARTHEST - 1.0)  # what is far from a mask has a larger distance [px]
_BORDER = wp.constant(1.0)  # width of an image's rim in which an outline means nothing [px]
_GAP = wp.constant(2.0)  # between a mask and what is in front of it there may be pixels of neither [px]


@wp.struct
class Fields:
    """Signed distances to the masks' contours [px], negative inside, in a box around the foreground of each view."""

    value: wp.array[wp.float32]  # flat: the boxes' rows
    box: wp.array2d[wp.vec4i]  # (frame, camera) x, y, width, height [px]; no width without foreground
    start: wp.array2d[wp.int32]  # (frame, camera) where a box begins in ``value``
    frame: wp.array[wp.int32]  # (candidate,) the frame that each candidate is judged against
    larger: wp.array[wp.float32]  # (camera,) by how much masks reach beyond what they show, all around [px]
    hidden: wp.array4d[wp.uint32]  # (frame, camera, row, word) what is in front; no frames where nothing is in any


@wp.struct
class Matching:
    """How residuals are looked for and weighed; lengths are at the body [m]."""

    reach: float  # how far from the outline a mask's contour is looked for
    huber: float  # residuals above count linearly
    sigma: float  # standard deviation of a residual
    apart: float  # px of outline that err as one
    deep: float  # outline that is farther outside of the mask is exposed: a limb where nobody is


@wp.struct
class Residuals:
    """Of each contour edge; all zero where it is not outline or meets no contour."""

    normal: wp.array3d[wp.vec2]  # (candidate, camera, contour edge) outward
    weighted: wp.array3d[wp.vec2]  # (candidate, camera, contour edge) residual [px], weight [1/px^2]
    tally: wp.array3d[wp.vec4]  # (candidate, camera, contour edge) cost; length, that matched [px]; exposed [m]


@wp.func
def _distance(fields: Fields, start: int, box: wp.vec4i, point: wp.vec2) -> float:
    """Signed distance at a point of the image, bilinear; beyond its box that of the nearest point in it."""
    x = wp.clamp(point[0] - float(box[0]), 0.0, float(box[2]) - 1.001)
    y = wp.clamp(point[1] - float(box[1]), 0.0, float(box[3]) - 1.001)
    column = int(x)
    row = int(y)
    fx = x - float(column)
    fy = y - float(row)
    at = start + row * box[2] + column
    upper = fields.value[at] * (1.0 - fx) + fields.value[at + 1] * fx
    below = fields.value[at + box[2]] * (1.0 - fx) + fields.value[at + box[2] + 1] * fx
    return upper * (1.0 - fy) + below * fy


@wp.func
def _end_of_mask(fields: Fields, start: int, box: wp.vec4i, middle: wp.vec2, normal: wp.vec2, reach: float) -> float:
    """Where along its normal, nearest to an outline's middle, a mask ends [px]; infinite if not within reach.

    One pixel at a time, outward and inward in turn.
    """
    inner = _distance(fields, start, box, middle)
    outer = inner
    step = int(0)
    nearest = float(wp.inf)
    while nearest == wp.inf and float(step) < reach:
        t = float(step)
        next_outer = _distance(fields, start, box, middle + (t + 1.0) * normal)
        if outer < 0.0 and next_outer >= 0.0:
            nearest = t + outer / (outer - next_outer)
        next_inner = _distance(fields, start, box, middle - (t + 1.0) * normal)
        if next_inner < 0.0 and inner >= 0.0:
            found = -t - inner / (inner - next_inner)
            if -found < nearest:
                nearest = found
        outer = next_outer
        inner = next_inner
        step += 1
    return wp.where(wp.abs(nearest) <= reach, nearest, wp.inf)


@wp.func
def _is_behind(
    fields: Fields, frame: int, k: int, size: wp.vec2i, middle: wp.vec2, normal: wp.vec2, way: float
) -> bool:
    """Whether something is in front of an outline's middle, or of its way outward of so many pixels."""
    step = int(0)
    while float(step) <= way:
        point = middle + float(step) * normal
        column = int(wp.round(point[0]))
        row = int(wp.round(point[1]))
        if column < 0 or row < 0 or column >= size[0] or row >= size[1]:
            return False
        if ((fields.hidden[frame, k, row, column // 32] >> wp.uint32(column % 32)) & wp.uint32(1)) != wp.uint32(0):
            return True
        step += 1
    return False


@wp.func
def _is_far(fields: Fields, start: int, box: wp.vec4i, point: wp.vec2, far: float) -> bool:
    """Whether a point is outside of a mask and farther from it than so many pixels.

    Distances are cut off: rings of points around it, whose discs leave no gap between them, see what is farther away.
    """
    if _distance(fields, start, box, point) <= wp.min(far, _SURE):
        return False
    seen = float(_SURE)
    while far - seen > 0.1:
        radius = wp.min(seen + 0.95 * _SURE, wp.max(far - 0.95 * _SURE, 1.0))
        points = int(wp.ceil(2.0 * wp.pi * radius / (0.6 * _SURE)))
        for i in range(points):
            angle = 2.0 * wp.pi * float(i) / float(points)
            beside = point + radius * wp.vec2(wp.cos(angle), wp.sin(angle))
            if _distance(fields, start, box, beside) <= _SURE:
                return False
        seen = radius + 0.95 * _SURE
    return True


@wp.func
def _huber(residual: float, corner: float) -> float:
    """A residual's square, or what goes on linearly above the corner."""
    size = wp.abs(residual)
    return wp.where(size <= corner, size * size, corner * (2.0 * size - corner))


@wp.kernel
def _find_residuals(
    outline: Outline,
    fields: Fields,
    views: Views,
    matching: Matching,
    batch: Batch,
    lanes: int,
    # out
    residuals: Residuals,
) -> None:
    own, k, lane = wp.tid()
    c = batch.first + own
    frame = fields.frame[c]
    box = fields.box[frame, k]
    start = fields.start[frame, k]
    size = views.size[k]
    for s in range(lane, outline.count[c, k], lanes):
        residuals.weighted[c, k, s] = wp.vec2(0.0, 0.0)
        residuals.tally[c, k, s] = wp.vec4(0.0, 0.0, 0.0, 0.0)
    if box[2] <= 0:
        return
    alone = lanes == 1  # on a CPU, which is faster by judging all edges first
    edges = outline.count[c, k]
    if alone:
        edges = on_outline(outline, c, k, size, _BORDER)
    for i in range(lane, edges, lanes):
        s = i
        if alone:
            s = outline.found[c, k, i]
        ends = outline.ends[c, k, s]
        a = outline.image[c, k, ends[0]]
        b = outline.image[c, k, ends[1]]
        along = wp.vec2(b[0] - a[0], b[1] - a[1])
        middle = wp.vec2(0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]))
        length = wp.length(along)
        inside = (
            middle[0] > _BORDER
            and middle[1] > _BORDER
            and middle[0] < float(size[0] - 1) - _BORDER
            and middle[1] < float(size[1] - 1) - _BORDER
        )
        if alone or (inside and length > 1.0e-6):
            normal = wp.vec2(-along[1], along[0]) / length
            if alone or is_outline(outline, c, k, size[1], middle, normal):
                px = 2.0 * views.lens[k][0] / (a[2] + b[2])  # of a metre at the edge
                reach = matching.reach * px
                corner = matching.huber * px
                found = _end_of_mask(fields, start, box, middle, normal, reach)
                # With what is in front a mask ends where both do. Up to there nothing says where the outline is, and
                # only an outline beyond it counts.
                if fields.hidden.shape[0] > 0 and found >= 0.0:
                    if _is_behind(fields, frame, k, size, middle, normal, wp.min(found, reach) + _GAP):
                        continue
                matched = wp.abs(found) <= reach
                share = length / (matching.sigma * matching.sigma * px * px * matching.apart)
                residual = wp.where(matched, found - fields.larger[k], reach)
                exposed = wp.where(_is_far(fields, start, box, middle, matching.deep * px), length / px, 0.0)
                cost = share * _huber(residual, corner)
                residuals.normal[c, k, s] = normal
                if matched:
                    weight = share / wp.max(wp.abs(residual) / corner, 1.0)
                    residuals.weighted[c, k, s] = wp.vec2(residual, weight)
                    residuals.tally[c, k, s] = wp.vec4(cost, length, length, exposed)
                else:
                    residuals.tally[c, k, s] = wp.vec4(cost, length, 0.0, exposed)


def find_residuals(
    outline: Outline, fields: Fields, views: Views, matching: Matching, batch: Batch, residuals: Residuals
) -> None:
    """Match a batch's outlines with the masks' contours."""
    device = outline.image.device
    lanes = lanes_of(device, VIEW_LANES)
    dim = (batch.size, outline.count.shape[1], lanes)
    inputs = [outline, fields, views, matching, batch, lanes]
    launch(_find_residuals, dim, inputs, [residuals], block_dim=_BLOCK, device=device)
