"""Eigenvectors of a symmetric matrix A by a block of lanes: Jacobi rotations in parallel.

Rotate the plane of two coordinates p and q by the angle that makes the element between them zero::

    [ c -s ] [ pp pq ] [ c  s ]   [ pp - t pq      0     ]
    [ s  c ] [ pq qq ] [-s  c ] = [     0      qq + t pq ]     t = s / c,  cot 2 angle = (qq - pp) / (2 pq)

That also changes the other elements of rows and columns p and q, but the sum of squares beside the diagonal falls by
``2 pq^2``. A sweep does this for every pair once. Sweeps follow until nothing beside the diagonal is left: the diagonal
then holds the eigenvalues, and V, the product of all rotations, an eigenvector in each row. A matrix that is nearly
diagonal at the start takes a sweep or two.

Rotations of pairs that share no coordinate can be done at the same time. So a sweep is played like a round-robin
tournament (Brent and Luk 1985): n coordinates meet in n - 1 rounds of n / 2 pairs, here the first two of n = 6::

    0 1 2     pairs 0-5, 1-4, 2-3; then 5 stays     1 2 3     pairs 1-5, 2-0, 3-4
    5 4 3     and the others move on by one         5 0 4

A lane finds a pair's angle; then the lanes share the blocks of 2 x 2 elements between two pairs, and the rows of V.
"""

import warp as wp

from mmocap_warp.kernels.block import LaneLayout, lane_layout, matrix_at, sync

wp.set_module_options({"enable_backward": False})

_SWEEPS = wp.constant(16)
_NEGLIGIBLE = wp.constant(3.0e-8)  # of the larger diagonal element: below what float32 can tell
_CONVERGED = wp.constant(1.0e-4)  # a sweep that meets nothing larger leaves about its square


@wp.struct
class Spectrum:
    """A symmetric matrix A on its way to ``V A V^T``, diagonal; an odd number of coordinates is filled up by zeros."""

    matrix: wp.array2d[wp.float32]  # (coordinate, column), of which what is on or above the diagonal is used
    axes: wp.array2d[wp.float32]  # (coordinate, column), V: an eigenvector a row
    rotation: wp.array2d[wp.float32]  # (pair, 2) sine and tangent of half the angle
    last_sweep: wp.array2d[wp.float32]  # (1, 1) number of the last sweep that met anything large


@wp.func
def even(dofs: int) -> int:
    """A number of coordinates, filled up so that all of them are paired."""
    return dofs + dofs % 2


@wp.func
def row_words(dofs: int) -> int:
    """Columns of a spectrum's matrices: four quarters, and one more, so that a column is spread over memory banks."""
    return 4 * ((dofs + 3) // 4) + 1


@wp.func
def spectrum_words(dofs: int) -> int:
    """32-bit words of a spectrum."""
    return even(dofs) * (2 * row_words(dofs) + 1) + 1


@wp.func
def spectrum_at(words: wp.array[wp.uint32], dofs: int) -> Spectrum:
    """The spectrum in the first of some words."""
    n = even(dofs)
    size = n * row_words(dofs)
    spectrum = Spectrum()
    spectrum.matrix = matrix_at(words, 0, n, row_words(dofs))
    spectrum.axes = matrix_at(words, size, n, row_words(dofs))
    spectrum.rotation = matrix_at(words, 2 * size, n // 2, 2)
    spectrum.last_sweep = matrix_at(words, 2 * size + n, 1, 1)
    return spectrum


@wp.func
def _paired(round: int, k: int, players: int) -> wp.vec2i:
    """Pair ``k`` of a round among an even number of players: the last stays, the others move on."""
    others = players - 1
    if k == 0:
        return wp.vec2i(round, others)
    a = round + k
    if a >= others:
        a -= others
    b = round - k
    if b < 0:
        b += others
    return wp.vec2i(wp.min(a, b), wp.max(a, b))


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __fdividef(1.0f, x);
#else
    return 1.0f / x;
#endif
""")
def _reciprocal(x: float) -> float:
    """``1 / x``; on a GPU good to the last two bits, in a fraction of a division's time."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return rsqrtf(x);
#else
    return 1.0f / sqrtf(x);
#endif
""")
def _reciprocal_root(x: float) -> float:
    """``1 / sqrt(x)``, as :func:`_reciprocal`."""
    ...


@wp.func
def _find_rotation(round: int, k: int, sweep: int, spectrum: Spectrum) -> None:
    """Choose the rotation that makes the element within a pair zero, and rotate it and its two diagonal elements."""
    pair = _paired(round, k, 2 * spectrum.rotation.shape[0])
    p = pair[0]
    q = pair[1]
    pp = spectrum.matrix[p, p]
    pq = spectrum.matrix[p, q]
    qq = spectrum.matrix[q, q]
    largest = wp.max(wp.abs(pp), wp.abs(qq))
    if wp.abs(pq) <= _NEGLIGIBLE * largest:
        spectrum.rotation[k, 0] = 0.0
        spectrum.rotation[k, 1] = 0.0
        return
    if wp.abs(pq) > _CONVERGED * largest:
        spectrum.last_sweep[0, 0] = float(sweep)
    cot_twice = 0.5 * (qq - pp) * _reciprocal(pq)
    sin_twice = _reciprocal_root(cot_twice * cot_twice + 1.0)
    cos_squared = 0.5 + 0.5 * wp.abs(cot_twice) * sin_twice
    secant = _reciprocal_root(cos_squared)
    s = wp.where(cot_twice < 0.0, -0.5, 0.5) * sin_twice * secant
    spectrum.rotation[k, 0] = s
    spectrum.rotation[k, 1] = s * _reciprocal(1.0 + cos_squared * secant)
    moved = s * secant * pq
    spectrum.matrix[p, p] = pp - moved
    spectrum.matrix[p, q] = 0.0
    spectrum.matrix[q, q] = qq + moved


@wp.func
def _rotated(p: float, q: float, s: float, tau: float) -> wp.vec2:
    """Two elements after a rotation, as corrections: small ones round far less than products with a cosine do."""
    return wp.vec2(p - s * (q + tau * p), q + s * (p - tau * q))


@wp.func
def _above(matrix: wp.array2d[wp.float32], i: int, j: int) -> float:
    return matrix[wp.min(i, j), wp.max(i, j)]


@wp.func
def _set_above(matrix: wp.array2d[wp.float32], i: int, j: int, value: float) -> None:
    matrix[wp.min(i, j), wp.max(i, j)] = value


@wp.func
def _rotate_between(
    p: wp.vec2i, q: wp.vec2i, s_p: float, tau_p: float, s_q: float, tau_q: float, spectrum: Spectrum
) -> None:
    """Rotate the four elements between two pairs by both pairs' rotations."""
    left = _rotated(_above(spectrum.matrix, p[0], q[0]), _above(spectrum.matrix, p[1], q[0]), s_p, tau_p)
    right = _rotated(_above(spectrum.matrix, p[0], q[1]), _above(spectrum.matrix, p[1], q[1]), s_p, tau_p)
    first = _rotated(left[0], right[0], s_q, tau_q)
    second = _rotated(left[1], right[1], s_q, tau_q)
    _set_above(spectrum.matrix, p[0], q[0], first[0])
    _set_above(spectrum.matrix, p[0], q[1], first[1])
    _set_above(spectrum.matrix, p[1], q[0], second[0])
    _set_above(spectrum.matrix, p[1], q[1], second[1])


@wp.func
def _rotate_matrix(round: int, layout: LaneLayout, spectrum: Spectrum) -> None:
    """Rotate what lies between the pairs: between pair k and those after it in a circle, up to halfway round."""
    pairs = spectrum.rotation.shape[0]
    for ahead in range(1 + layout.row, pairs // 2 + 1, layout.row_step):
        for k in range(layout.column, pairs, layout.column_step):
            m = k + ahead
            if m >= pairs:
                m -= pairs
            s_k = spectrum.rotation[k, 0]
            s_m = spectrum.rotation[m, 0]
            counted = 2 * ahead == pairs and k >= ahead  # halfway round, two pairs are each after the other
            if not counted and (s_k != 0.0 or s_m != 0.0):
                p = _paired(round, k, 2 * pairs)
                q = _paired(round, m, 2 * pairs)
                _rotate_between(p, q, s_k, spectrum.rotation[k, 1], s_m, spectrum.rotation[m, 1], spectrum)


@wp.func
def _four(matrix: wp.array2d[wp.float32], i: int, j: int, apart: int) -> wp.vec4:
    return wp.vec4(matrix[i, j], matrix[i, j + apart], matrix[i, j + 2 * apart], matrix[i, j + 3 * apart])


@wp.func
def _set_four(matrix: wp.array2d[wp.float32], i: int, j: int, apart: int, values: wp.vec4) -> None:
    matrix[i, j] = values[0]
    matrix[i, j + apart] = values[1]
    matrix[i, j + 2 * apart] = values[2]
    matrix[i, j + 3 * apart] = values[3]


@wp.func
def _rotate_axes(round: int, layout: LaneLayout, spectrum: Spectrum) -> None:
    """Rotate rows, in four columns at a time: one element alone would have a lane wait for memory."""
    pairs = spectrum.rotation.shape[0]
    quarter = spectrum.axes.shape[1] // 4
    for k in range(layout.row, pairs, layout.row_step):
        s = spectrum.rotation[k, 0]
        tau = spectrum.rotation[k, 1]
        if s != 0.0:
            pair = _paired(round, k, 2 * pairs)
            for i in range(layout.column, quarter, layout.column_step):
                p = _four(spectrum.axes, pair[0], i, quarter)
                q = _four(spectrum.axes, pair[1], i, quarter)
                _set_four(spectrum.axes, pair[0], i, quarter, p - s * (q + tau * p))
                _set_four(spectrum.axes, pair[1], i, quarter, q + s * (p - tau * q))


@wp.func
def diagonalize(spectrum: Spectrum, lane: int, lanes: int) -> None:
    """Rotate ``matrix`` until it is diagonal, and the rows of ``axes`` with it; all ``lanes`` of a block must call."""
    pairs = spectrum.rotation.shape[0]
    pair_layout = lane_layout(lane, lanes, pairs)
    row_layout = lane_layout(lane, lanes, spectrum.axes.shape[1] // 4)
    if lane == 0:
        spectrum.last_sweep[0, 0] = 0.0
    sync()
    sweep = int(1)
    while sweep <= _SWEEPS:
        for round in range(2 * pairs - 1):
            for k in range(lane, pairs, lanes):
                _find_rotation(round, k, sweep, spectrum)
            sync()
            _rotate_matrix(round, pair_layout, spectrum)
            _rotate_axes(round, row_layout, spectrum)
            sync()
        # All lanes have passed the sweep's last barrier, and none can write a number below the next sweep's.
        sweep = wp.where(int(spectrum.last_sweep[0, 0]) < sweep, _SWEEPS + 1, sweep + 1)


def lanes_worth(dofs: int) -> int:
    """Lanes that a matrix keeps busy, in whole warps: fewer wait less for each other."""
    pairs = (dofs + 1) // 2
    at_once = pairs * ((pairs + 1) // 2)  # as many quarters of rows as meetings of pairs
    return 32 * -(-at_once // 32)
