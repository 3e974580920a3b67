"""Eigenvectors of a symmetric matrix A by a block of lanes: Jacobi rotations in parallel.

Rotate the plane of two coordinates p and q by the angle that makes the element between them zero::

    [ c -s ] [ pp pq ] [ c  s ]   [ pp - t pq      0     ]
    [ s  c ] [ pq qq ] [-s  c ] = [     0      qq + t pq ]     t = s / c,  cot 2 angle = (qq - pp) / (2 pq)

That also changes the other elements of rows and columns p and q, but the sum of squares beside the diagonal falls by
``2 pq^2``. A sweep does this for every pair once. Sweeps follow until nothing beside the diagonal is left: the diagonal
then holds the eigenvalues, and V, the product of all rotations, an eigenvector in each row. A matrix that is nearly
diagonal at the start takes few sweeps.

Rotations of pairs that share no coordinate can be done at the same time. So a sweep is played like a round-robin
tournament (Brent and Luk 1985): n coordinates meet in n - 1 rounds of n / 2 pairs, here the first two of n = 6::

    0 1 2     pairs 0-5, 1-4, 2-3; then 5 stays     1 2 3     pairs 1-5, 2-0, 3-4
    5 4 3     and the others move on by one         5 0 4

A's elements move on with the coordinates, so that their places tell which pairs they lie between: 2 x 2 elements
between the pairs k and k + 1 are a row over k, those between k and k + 2 the next one. A CPU rotates eight k in one
instruction. The moves are the same after every round (``make_tournament``), and a round makes them as it reads.

A GPU's lane finds a pair's angle; then the lanes share the blocks of 2 x 2 elements, and the rows of V.
"""

import numpy as np
import warp as wp

from mmocap_warp.kernels.block import LaneLayout, lane_layout, matrix_at, sync

wp.set_module_options({"enable_backward": False})

_SWEEPS = wp.constant(16)


@wp.struct
class Tournament:
    """Where A's elements lie, each once, for a number of coordinates; see :func:`make_tournament`."""

    start: wp.array2d[wp.int32]  # (coordinate, coordinate) where the element between two lies before and after a sweep
    moved: wp.array[wp.int32]  # (place,) where the element that a round wants in a place was left by the round before


@wp.struct
class Spectrum:
    """A symmetric matrix A on its way to ``V A V^T``, diagonal; an odd number of coordinates is filled up by zeros."""

    elements: wp.array2d[wp.float32]  # (2, place) of A; a round reads one row and writes the other
    axes: wp.array2d[wp.float32]  # (coordinate, column), V: an eigenvector a row
    rotation: wp.array2d[wp.float32]  # (2, pair) sine and tangent of half the angle, and all pairs once more
    last_sweep: wp.array2d[wp.float32]  # (1, 1) number of the last sweep that met anything large


@wp.func
def even(dofs: int) -> int:
    """A number of coordinates, filled up so that all of them are paired."""
    return dofs + dofs % 2


@wp.func
def row_words(dofs: int) -> int:
    """Columns of V: whole vectors of a CPU, and one more, so that a column is spread over a GPU's memory banks."""
    return 8 * ((dofs + 7) // 8) + 1


@wp.func
def pair_words(dofs: int) -> int:
    """Words of a row over the pairs: whole vectors of a CPU."""
    return 8 * ((dofs + 15) // 16)


@wp.func
def places(dofs: int) -> int:
    """Words of A: for each pair two diagonal elements and the one between; then rows of 2 x 2 blocks between pairs."""
    return pair_words(dofs) * (3 + 4 * (even(dofs) // 4))


@wp.func
def spectrum_words(dofs: int) -> int:
    """32-bit words of a spectrum."""
    return 2 * places(dofs) + even(dofs) * row_words(dofs) + 4 * pair_words(dofs) + 1


@wp.func
def spectrum_at(words: wp.array[wp.uint32], dofs: int) -> Spectrum:
    """The spectrum in the first of some words."""
    axes = 2 * places(dofs)
    rotation = axes + even(dofs) * row_words(dofs)
    spectrum = Spectrum()
    spectrum.elements = matrix_at(words, 0, 2, places(dofs))
    spectrum.axes = matrix_at(words, axes, even(dofs), row_words(dofs))
    spectrum.rotation = matrix_at(words, rotation, 2, 2 * pair_words(dofs))
    spectrum.last_sweep = matrix_at(words, rotation + 4 * pair_words(dofs), 1, 1)
    return spectrum


def make_tournament(dofs: int, device: wp.DeviceLike) -> Tournament:
    """The tables of a tournament of ``dofs`` coordinates."""
    n, width = even(dofs), pair_words(dofs)
    pairs = n // 2
    seat = np.full((n, n), -1)  # place of the element between two seats: seat k is pair k's first, pairs + k its second
    k = np.arange(pairs)
    seat[k, k], seat[pairs + k, pairs + k], seat[k, pairs + k] = k, width + k, 2 * width + k
    for ahead in range(1, pairs // 2 + 1):
        first = k[:ahead] if 2 * ahead == pairs else k  # halfway round, two pairs are each after the other
        second = (first + ahead) % pairs
        for block in range(4):
            row = 3 + 4 * (ahead - 1) + block
            seat[first + block // 2 * pairs, second + block % 2 * pairs] = row * width + first
    seat = np.maximum(seat, seat.T)
    sat_at = np.argsort(_seated(n, n - 2))  # seats in a sweep's last round, after which everyone sits as before it
    came_from = sat_at[_seated(n, 0)]
    moved = np.zeros(places(dofs), np.int32)
    moved[seat] = seat[np.ix_(came_from, came_from)]
    tournament = Tournament()
    tournament.start = wp.array(seat[np.ix_(sat_at, sat_at)], dtype=wp.int32, device=device)
    tournament.moved = wp.array(moved, dtype=wp.int32, device=device)
    return tournament


def _seated(players: int, round: int) -> np.ndarray:
    """Who sits where in a round: pair k is ``round + k`` and ``round - k``, but the last player always plays first."""
    k = np.arange(players // 2)
    others = players - 1
    second = (round - k) % others
    second[0] = others
    return np.concatenate([(round + k) % others, second])


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const int first = lane, step = lanes;
    auto reciprocal = [](float x) { return __fdividef(1.0f, x); };  // good to the last two bits, in less time
    auto reciprocal_root = [](float x) { return rsqrtf(x); };
#else
    #pragma clang fp contract(off)
    const int first = 0, step = 1;
    auto reciprocal = [](float x) { return 1.0f / x; };
    auto reciprocal_root = [](float x) { return 1.0f / sqrtf(x); };
#endif
    const float negligible = 3.0e-8f;  // of the larger diagonal element: below what float32 can tell
    const float converged = 1.0e-4f;  // a sweep that meets nothing larger leaves about its square
    const int width = spectrum.rotation.shape[1] / 2, others = 2 * pairs - 1;
    const int* __restrict__ place = tournament.moved.data;
    const float* __restrict__ old = spectrum.elements.data + (now ^ 1) * spectrum.elements.shape[1];
    float* __restrict__ element = spectrum.elements.data + now * spectrum.elements.shape[1];
    float* __restrict__ sine = spectrum.rotation.data;
    float* __restrict__ tangent = spectrum.rotation.data + 2 * width;
    int large = 0;
    for (int k = first; k < pairs; k += step) {
        const float pp = old[place[k]], qq = old[place[width + k]], pq = old[place[2 * width + k]];
        const float size = fabsf(pq);
        const float largest = fabsf(pp) > fabsf(qq) ? fabsf(pp) : fabsf(qq);
        const bool rotates = size > negligible * largest;
        large |= rotates & (size > converged * largest);
        const float cot_twice = 0.5f * (qq - pp) * reciprocal(pq);
        const float sin_twice = reciprocal_root(cot_twice * cot_twice + 1.0f);
        const float cos_squared = 0.5f + 0.5f * fabsf(cot_twice) * sin_twice;
        const float secant = reciprocal_root(cos_squared);
        // Where pp = qq, the coordinate with the lower number turns towards the other, whichever of them sits first.
        const bool is_swapped = (k > 0) & (round >= k) & (round + k < others);
        const bool is_negative = is_swapped ? cot_twice <= 0.0f : cot_twice < 0.0f;
        const float s = (is_negative ? -0.5f : 0.5f) * sin_twice * secant;
        const float change = s * secant * pq;
        const float tau = s * reciprocal(1.0f + cos_squared * secant);
        sine[k] = rotates ? s : 0.0f;
        tangent[k] = rotates ? tau : 0.0f;
        sine[pairs + k] = rotates ? s : 0.0f;
        tangent[pairs + k] = rotates ? tau : 0.0f;
        element[k] = rotates ? pp - change : pp;
        element[width + k] = rotates ? qq + change : qq;
        element[2 * width + k] = rotates ? 0.0f : pq;
    }
    if (large) spectrum.last_sweep.data[0] = sweep;
""")
def _find_rotations(
    pairs: int, round: int, sweep: int, now: int, lane: int, lanes: int, tournament: Tournament, spectrum: Spectrum
) -> None:
    """Choose the rotations that make the elements within pairs zero, and rotate these and the diagonal."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    typedef float Numbers;
    const int first = column, end = pairs, step = columns;
#else
    #pragma clang fp contract(off)
    typedef float Numbers __attribute__((vector_size(32), aligned(4)));
    const int first = 0, end = pairs, step = 8;  // the row is filled up to whole vectors
#endif
    const int width = spectrum.rotation.shape[1] / 2, row = (3 + 4 * (ahead - 1)) * width;
    const int* __restrict__ place = tournament.moved.data + row;
    const float* __restrict__ old = spectrum.elements.data + (now ^ 1) * spectrum.elements.shape[1];
    float* __restrict__ element = spectrum.elements.data + now * spectrum.elements.shape[1] + row;
    auto move = [&](int k) {
        Numbers found;
        for (int i = 0; i < sizeof(Numbers) / sizeof(float); ++i) ((float*)&found)[i] = old[place[k + i]];
        return found;
    };
    auto rotation_of = [&](int k) { return *(const Numbers*)(spectrum.rotation.data + k); };
    for (int k = first; k < end; k += step) {
        const Numbers s = rotation_of(k), tau = rotation_of(2 * width + k);
        const Numbers s_m = rotation_of(k + ahead), tau_m = rotation_of(2 * width + k + ahead);
        const Numbers pp = move(k), pq = move(width + k), qp = move(2 * width + k), qq = move(3 * width + k);
        // Corrections: small ones round far less than products with a cosine do.
        const Numbers left_p = pp - s * (qp + tau * pp), left_q = qp + s * (pp - tau * qp);
        const Numbers right_p = pq - s * (qq + tau * pq), right_q = qq + s * (pq - tau * qq);
        *(Numbers*)(element + k) = left_p - s_m * (right_p + tau_m * left_p);
        *(Numbers*)(element + width + k) = right_p + s_m * (left_p - tau_m * right_p);
        *(Numbers*)(element + 2 * width + k) = left_q - s_m * (right_q + tau_m * left_q);
        *(Numbers*)(element + 3 * width + k) = right_q + s_m * (left_q - tau_m * right_q);
    }
""")
def _rotate_blocks(
    pairs: int, ahead: int, now: int, column: int, columns: int, tournament: Tournament, spectrum: Spectrum
) -> None:
    """Rotate the 2 x 2 elements between each pair k and the pair ``k + ahead``, by k's rotation and by the other's."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    typedef float Numbers;
    const int first = column, end = axes.shape[1] / 4, step = columns;
    const int many = 4, apart = end;  // four at a time: one element alone would have a lane wait for memory
#else
    #pragma clang fp contract(off)
    typedef float Numbers __attribute__((vector_size(32), aligned(4)));
    const int first = 0, end = axes.shape[1] - 1, step = 8;
    const int many = 1, apart = 0;
#endif
    float* p = axes.data + first_row * axes.shape[1];
    float* q = axes.data + second_row * axes.shape[1];
    for (int i = first; i < end; i += step) {
        Numbers old_p[many], old_q[many];
        for (int c = 0; c < many; ++c) {
            old_p[c] = *(Numbers*)(p + i + c * apart);
            old_q[c] = *(Numbers*)(q + i + c * apart);
        }
        for (int c = 0; c < many; ++c) {
            *(Numbers*)(p + i + c * apart) = old_p[c] - s * (old_q[c] + tau * old_p[c]);
            *(Numbers*)(q + i + c * apart) = old_q[c] + s * (old_p[c] - tau * old_q[c]);
        }
    }
""")
def _rotate_two_rows(
    axes: wp.array2d[wp.float32], first_row: int, second_row: int, s: float, tau: float, column: int, columns: int
) -> None:
    """Rotate two rows of V."""
    ...


@wp.func
def _rotate_axes(pairs: int, round: int, layout: LaneLayout, spectrum: Spectrum) -> None:
    """Rotate the rows of V, in coordinates' order."""
    others = 2 * pairs - 1
    for k in range(layout.row, pairs, layout.row_step):
        s = spectrum.rotation[0, k]
        if s != 0.0:
            first = round + k
            if first >= others:
                first -= others
            second = round - k
            if second < 0:
                second += others
            if k == 0:
                second = others
            _rotate_two_rows(
                spectrum.axes, first, second, s, spectrum.rotation[1, k], layout.column, layout.column_step
            )


@wp.func
def diagonalize(tournament: Tournament, spectrum: Spectrum, lane: int, lanes: int) -> int:
    """Rotate A until it is diagonal, and the rows of ``axes`` with it; all ``lanes`` of a block must call.

    A lies in row 0 of ``elements``, and the result in the row that is returned.
    """
    pairs = spectrum.axes.shape[0] // 2
    pair_layout = lane_layout(lane, lanes, pairs)
    row_layout = lane_layout(lane, lanes, spectrum.axes.shape[1] // 4)
    if lane == 0:
        spectrum.last_sweep[0, 0] = 0.0
    sync()
    now = int(0)
    sweep = int(1)
    while sweep <= _SWEEPS:
        for round in range(2 * pairs - 1):
            now = 1 - now
            _find_rotations(pairs, round, sweep, now, lane, lanes, tournament, spectrum)
            sync()
            for ahead in range(1 + pair_layout.row, pairs // 2 + 1, pair_layout.row_step):
                _rotate_blocks(pairs, ahead, now, pair_layout.column, pair_layout.column_step, tournament, spectrum)
            _rotate_axes(pairs, round, row_layout, spectrum)
            sync()
        # All lanes have passed the sweep's last barrier, and none can write a number below the next sweep's.
        sweep = wp.where(int(spectrum.last_sweep[0, 0]) < sweep, _SWEEPS + 1, sweep + 1)
    return now


def lanes_worth(dofs: int) -> int:
    """Lanes that a matrix keeps busy, in whole warps: fewer wait less for each other."""
    pairs = (dofs + 1) // 2
    at_once = pairs * ((pairs + 1) // 2)  # as many quarters of rows as meetings of pairs
    return 32 * -(-at_once // 32)
