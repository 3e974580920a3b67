"""Which pixel centres of a row a projected triangle covers: the tie rule that all renderers share.

A triangle faces the camera when its corners turn counter-clockwise on screen as the eye sees them, which is a
negative area here, because y points down. Only such triangles count: the surface is closed, so wherever the body
covers a pixel, a facing triangle does. **A pixel whose centre lies exactly on an edge is covered.**
"""

import warp as wp

from mmocap_warp.kernels.projection import BEHIND, SUBPIXEL

wp.set_module_options({"enable_backward": False})

# An edge crosses a row of pixel centres at a multiple of 1 / (SUBPIXEL * dy) px, where dy < 2^20 steps: exactly on
# an integer or at least 5e-8 px away from it, while the float64 estimate below errs by less than 1e-10 px.
_TIE = wp.constant(wp.float64(1.0e-9))
_PIXEL = wp.constant(wp.float64(1.0 / SUBPIXEL))
_HALF_OPEN = wp.constant(SUBPIXEL - 1)
_FAR = wp.constant(wp.float64(1.0e9))
_ONES = wp.constant(wp.uint32(0xFFFFFFFF))


@wp.func
def faces_camera(a: wp.vec2i, b: wp.vec2i, c: wp.vec2i) -> bool:
    """Whether a projected triangle turns its outside to the camera and lies wholly in front of it."""
    if a[0] == BEHIND or b[0] == BEHIND or c[0] == BEHIND:
        return False
    right = wp.int64(b[0] - a[0]) * wp.int64(c[1] - a[1])
    left = wp.int64(b[1] - a[1]) * wp.int64(c[0] - a[0])
    return right < left


@wp.func
def first_pixel(steps: int) -> int:
    """The first pixel centre at or after a grid position."""
    return wp.floordiv(steps + _HALF_OPEN, SUBPIXEL)


@wp.func
def last_pixel(steps: int) -> int:
    """The last pixel centre at or before a grid position."""
    return wp.floordiv(steps, SUBPIXEL)


@wp.func
def slope(a: wp.vec2i, b: wp.vec2i) -> wp.float64:
    """``dx / dy`` of an edge; 0 where it is horizontal, because such an edge bounds no row."""
    dy = b[1] - a[1]
    if dy == 0:
        return wp.float64(0.0)
    return wp.float64(b[0] - a[0]) / wp.float64(dy)


@wp.func
def crossing(a: wp.vec2i, slope: wp.float64, row: int) -> wp.float64:
    """Where the line through ``a`` crosses a row of pixel centres [px]."""
    return (wp.float64(a[0]) + wp.float64(row * SUBPIXEL - a[1]) * slope) * _PIXEL


@wp.func
def span(
    a: wp.vec2i,
    b: wp.vec2i,
    c: wp.vec2i,
    slope_ab: wp.float64,
    slope_bc: wp.float64,
    slope_ca: wp.float64,
    row: int,
    width: int,
) -> wp.vec2i:
    """First and last pixel of a row that a facing triangle covers, within the image; empty if first > last.

    The row must lie within the triangle's own rows. An edge that runs down the image bounds it on the left.
    """
    left = -_FAR
    right = _FAR
    if b[1] > a[1]:
        left = wp.max(left, crossing(a, slope_ab, row))
    elif b[1] < a[1]:
        right = wp.min(right, crossing(a, slope_ab, row))
    if c[1] > b[1]:
        left = wp.max(left, crossing(b, slope_bc, row))
    elif c[1] < b[1]:
        right = wp.min(right, crossing(b, slope_bc, row))
    if a[1] > c[1]:
        left = wp.max(left, crossing(c, slope_ca, row))
    elif a[1] < c[1]:
        right = wp.min(right, crossing(c, slope_ca, row))
    first = wp.max(0, int(wp.ceil(left - _TIE)))
    last = wp.min(width - 1, int(wp.floor(right + _TIE)))
    return wp.vec2i(first, last)


@wp.func
def word_bits(first: int, last: int, word: int) -> wp.uint32:
    """The bits of pixels ``first .. last`` that fall into a 32-pixel word."""
    low = wp.max(first - word * 32, 0)
    high = wp.min(last - word * 32, 31)
    if low > high:
        return wp.uint32(0)
    return (_ONES << wp.uint32(low)) & (_ONES >> wp.uint32(31 - high))
