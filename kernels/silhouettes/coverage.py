r"""Which pixel centres of a row a projected triangle covers: the tie rule that all renderers share.

The idea: a row of pixel centres meets two edges of a triangle, and the triangle covers what lies between. Where an
edge meets the row, the first pixel on its right, or on it, is found by rounding up.

          top +
             / \            x = x_top + (row - y_top) * dx / dy      where an edge meets the row
    row . . /o o\. . .      p = ceil(x)                              the first pixel on its right, or on it
           /   __+ middle
          /__--             the row's pixels: p(left edge), ..., p(right edge) - 1
         + bottom

Vertices lie in the middle of the cells of a grid whose corners are the pixel centres (see ``projection.py``), so a
vertex is never level with a pixel centre. Where an edge passes exactly through one, **the pixel belongs to the side
on the right**. So triangles that share an edge share no pixel and leave none out, and the pixels of a closed surface
are those of its facing triangles alone: a ray enters it as often as it leaves it.
"""

import warp as wp

from mmocap_warp.kernels.views.projection import SUBPIXEL

wp.set_module_options({"enable_backward": False})

_SHIFT = wp.constant(SUBPIXEL.bit_length() - 1)
_WITHIN = wp.constant(SUBPIXEL - 1)
_PIXEL = wp.constant(1.0 / SUBPIXEL)
_ONES = wp.constant(wp.uint32(0xFFFFFFFF))

# An edge of height dy cells meets a row at a multiple of 1 / (2 SUBPIXEL dy) px. In float32, a short edge's meeting
# point errs by less than 1.2e-5 px and is an integer or at least 3.0e-5 px away from one: half of that tells them
# apart. For any other edge float64 errs by less than 1e-9 px, and 1.4e-8 px are to be told apart.
_SHORT = wp.constant(1024)  # an edge that spans fewer cells is short
_TIE = wp.constant(1.5e-5)
_TIE_FAR = wp.constant(wp.float64(7.0e-9))
_PIXEL_FAR = wp.constant(wp.float64(1.0 / SUBPIXEL))


@wp.struct
class Edge:
    """An edge that runs down the image."""

    top: wp.vec2i
    step: wp.vec2i  # from its upper end to its lower
    is_short: bool
    whole: int  # the pixel column of its top, of which it then
    base: float  # lies this much to the right [px]
    start: float  # row of its top [cells]
    slope: float  # pixels to the right a cell down


@wp.func
def edge(top: wp.vec2i, bottom: wp.vec2i) -> Edge:
    """The edge between two points, the upper one first."""
    found = Edge()  # not e: Warp would take e.top for an attribute of its constant e, until the function is compiled
    found.top = top
    found.step = bottom - top
    found.is_short = wp.max(wp.abs(found.step[0]), found.step[1]) < _SHORT
    found.whole = top[0] >> _SHIFT
    found.base = (float(top[0] & _WITHIN) + 0.5) * _PIXEL - _TIE
    found.start = float(top[1]) + 0.5
    found.slope = float(found.step[0]) / float(wp.max(found.step[1], 1)) * _PIXEL
    return found


@wp.func
def first_after(cell: int) -> int:
    """The first row (or column) of pixel centres after the middle of a cell."""
    return (cell >> _SHIFT) + 1


@wp.func
def last_before(cell: int) -> int:
    """The last row (or column) of pixel centres before the middle of a cell."""
    return cell >> _SHIFT


@wp.func(inline=False)  # rare: its instructions would only be in the way
def _crossing_far(top: wp.vec2i, step: wp.vec2i, row: int) -> int:
    slope = wp.float64(step[0]) / wp.float64(step[1])
    down = wp.float64(row * SUBPIXEL - top[1]) - wp.float64(0.5)
    return int(wp.ceil((wp.float64(top[0]) + wp.float64(0.5) + down * slope) * _PIXEL_FAR - _TIE_FAR))


@wp.func
def crossing(side: Edge, row: int) -> int:
    """The first pixel of a row on the right of an edge that meets the row, or on it."""
    if side.is_short:
        return side.whole + int(wp.ceil(side.base + (float(row) * float(SUBPIXEL) - side.start) * side.slope))
    return _crossing_far(side.top, side.step, row)


@wp.func
def span(a: Edge, b: Edge, row: int) -> wp.vec2i:
    """First and last pixel of a row between two edges that meet it; none if first > last."""
    p = crossing(a, row)
    q = crossing(b, row)
    return wp.vec2i(wp.min(p, q), wp.max(p, q) - 1)


@wp.func
def faces_camera(a: wp.vec2i, b: wp.vec2i, c: wp.vec2i) -> bool:
    """Whether a projected triangle turns its outside to the camera.

    Its corners then turn counter-clockwise as the eye sees them, a negative area, because y points down.
    """
    right = wp.int64(b[0] - a[0]) * wp.int64(c[1] - a[1])
    left = wp.int64(b[1] - a[1]) * wp.int64(c[0] - a[0])
    return right < left


@wp.struct
class Drop:
    """A triangle as it is drawn: down its long edge, beside the upper and then the lower of the other two."""

    long_side: Edge
    upper_side: Edge
    lower_side: Edge
    first: int  # row
    turn: int  # last row of the upper edge
    last: int  # row


@wp.func
def drop(a: wp.vec2i, b: wp.vec2i, c: wp.vec2i, first: int, last: int) -> Drop:
    """A triangle within rows ``first .. last``; it has none if its ``first`` > ``last``."""
    # Sorted by choosing, not by branching: which corner is on top is anyone's guess.
    swap = b[1] < a[1]
    upper = wp.where(swap, b, a)
    lower = wp.where(swap, a, b)
    above = c[1] < upper[1]
    top = wp.where(above, c, upper)
    rest = wp.where(above, upper, c)
    below = lower[1] < rest[1]
    middle = wp.where(below, lower, rest)
    bottom = wp.where(below, rest, lower)
    d = Drop()
    d.first = wp.max(first_after(top[1]), first)
    d.turn = last_before(middle[1])
    d.last = wp.min(last_before(bottom[1]), last)
    if d.first <= d.last:
        d.long_side = edge(top, bottom)
        d.upper_side = edge(top, middle)
        d.lower_side = edge(middle, bottom)
    return d


@wp.func
def row_span(d: Drop, row: int) -> wp.vec2i:
    """First and last pixel of one of a triangle's rows; none if first > last."""
    if row <= d.turn:
        return span(d.long_side, d.upper_side, row)
    return span(d.long_side, d.lower_side, row)


@wp.func
def word_bits(first: int, last: int, word: int) -> wp.uint32:
    """The bits of pixels ``first .. last`` that fall into a 32-pixel word."""
    low = wp.max(first - word * 32, 0)
    high = wp.min(last - word * 32, 31)
    if low > high:
        return wp.uint32(0)
    return (_ONES << wp.uint32(low)) & (_ONES >> wp.uint32(31 - high))
