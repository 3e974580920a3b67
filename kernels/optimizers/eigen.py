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

On a GPU a block's lanes share the 2 x 2 elements and the rows of V. Finding an angle takes longest, so the first warp
finds those of the next round meanwhile: it rotates the few elements they depend on for itself. Lanes then wait for each
other once a round.
"""

import numpy as np
import warp as wp

from mmocap_warp.kernels.block import matrix_at

wp.set_module_options({"enable_backward": False})

_SWEEPS = wp.constant(16)

MOST_LANES = 512
"""Lanes that are ever worth it."""


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
    rotation: wp.array2d[wp.float32]  # (2, pair) sine and tangent of half the angle, twice: see who writes them
    last_sweep: wp.array2d[wp.float32]  # (1, 1) number of the last sweep that met anything large, for a block's lanes


@wp.func
def even(dofs: int) -> int:
    """A number of coordinates, filled up so that all of them are paired."""
    return dofs + dofs % 2


@wp.func
def row_words(dofs: int) -> int:
    """Words from a row of V to the next: whole vectors of a CPU, and then as many as make quarters of rows, which a
    GPU's lanes share, follow each other in its 32 memory banks."""
    quarter = 2 * ((dofs + 7) // 8)
    return 4 * quarter + (32 * quarter - 3 * quarter) % 32


@wp.func
def pair_words(dofs: int) -> int:
    """Words of a row over the pairs: whole vectors of a CPU."""
    return 8 * ((dofs + 15) // 16)


@wp.func
def places(dofs: int) -> int:
    """Words of A on a CPU, and enough for a GPU: see :func:`make_tournament`."""
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
    """The tables of a tournament of ``dofs`` coordinates.

    A CPU has, in rows over the pairs, two diagonal elements, the one between, and four rows for each distance of pairs.
    A GPU has all 2 x 2 blocks first, in four rows over the blocks, and keeps nothing between the rows.
    """
    n, width = even(dofs), pair_words(dofs)
    pairs = n // 2
    blocks = pairs * (pairs - 1) // 2
    # Where the element between two seats lies: seat k is the first of pair k, seat pairs + k its second.
    seat = np.full((n, n), -1)
    k = np.arange(pairs)
    is_cpu = wp.get_device(device).is_cpu
    within = [width * row if is_cpu else 4 * blocks + pairs * row for row in range(3)]
    seat[k, k], seat[pairs + k, pairs + k], seat[k, pairs + k] = (row + k for row in within)
    for ahead in range(1, pairs // 2 + 1):
        first = k[:ahead] if 2 * ahead == pairs else k  # halfway round, two pairs are each after the other
        second = (first + ahead) % pairs
        for block in range(4):
            row = (3 + 4 * (ahead - 1) + block) * width if is_cpu else block * blocks + (ahead - 1) * pairs
            seat[first + block // 2 * pairs, second + block % 2 * pairs] = row + first
    seat = np.maximum(seat, seat.T)
    # Where a round finds the elements of its seats: where those who sit there now sat in the round before.
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


_CHOOSE = """
    const float negligible = 3.0e-8f;  // of the larger diagonal element: below what float32 can tell
    const float converged = 1.0e-4f;  // a sweep that meets nothing larger leaves about its square
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
"""  # the rotation that makes the element pq within a pair k zero, on both kinds of device


# How a rotation is chosen, and rotates what lies within its pair (CPU):
# 1. Read the pair's diagonal elements pp and qq and the element pq between them, where the last round left them.
# 2. An element that is small beside both diagonal elements is not rotated. One that is not yet tiny makes another sweep
#    necessary.
# 3. From cot 2 angle follow sine, cosine and tangent of half the angle, without any trigonometric function. The angle
#    is the smaller of the two that make pq zero, at most an eighth of a turn, because that one converges.
# 4. Write sine and tangent twice in a row: the blocks of the pairs ahead then read them as whole vectors.
@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
    auto reciprocal = [](float x) {{ return 1.0f / x; }};
    auto reciprocal_root = [](float x) {{ return 1.0f / sqrtf(x); }};
    const int width = spectrum.rotation.shape[1] / 2, others = 2 * pairs - 1;
    const int* __restrict__ place = tournament.moved.data;
    const float* __restrict__ old = spectrum.elements.data + (now ^ 1) * spectrum.elements.shape[1];
    float* __restrict__ element = spectrum.elements.data + now * spectrum.elements.shape[1];
    float* __restrict__ sine = spectrum.rotation.data;
    float* __restrict__ tangent = spectrum.rotation.data + 2 * width;
    int large = 0;
    for (int k = 0; k < pairs; ++k) {{
        const float pp = old[place[k]], qq = old[place[width + k]], pq = old[place[2 * width + k]];
        {_CHOOSE}
        sine[k] = rotates ? s : 0.0f;
        tangent[k] = rotates ? tau : 0.0f;
        sine[pairs + k] = rotates ? s : 0.0f;  // once more, for the pairs that are ahead of the last
        tangent[pairs + k] = rotates ? tau : 0.0f;
        element[k] = rotates ? pp - change : pp;
        element[width + k] = rotates ? qq + change : qq;
        element[2 * width + k] = rotates ? 0.0f : pq;
    }}
    return large;
#else
    return 0;
#endif
""")
def _find_rotations(pairs: int, round: int, now: int, tournament: Tournament, spectrum: Spectrum) -> int:
    """Choose the rotations that make the elements within pairs zero, and rotate these and the diagonal.

    Returns whether anything was large.
    """
    ...


# How the 2 x 2 elements between two pairs are rotated (CPU), eight pairs k in one instruction:
# 1. Gather the four elements of each block from where the last round left them.
# 2. Rotate their rows by pair k's angle, then their columns by the angle of the pair ahead. With tau, the tangent of
#    half the angle, ``c x - s y = x - s (y + tau x)``: a small correction instead of a product with a cosine near
#    one.
@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
    typedef float Numbers __attribute__((vector_size(32), aligned(4)));
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
    for (int k = 0; k < pairs; k += 8) {  // the row is filled up to whole vectors
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
#endif
""")
def _rotate_blocks(pairs: int, ahead: int, now: int, tournament: Tournament, spectrum: Spectrum) -> None:
    """Rotate the 2 x 2 elements between each pair k and the pair ``k + ahead``, by k's rotation and by the other's."""
    ...


_SEATS = """
    int first_row = round + k, second_row = round - k;
    if (first_row >= others) first_row -= others;
    if (second_row < 0) second_row += others;
    if (k == 0) second_row = others;
    float* p = spectrum.axes.data + first_row * spectrum.axes.shape[1];
    float* q = spectrum.axes.data + second_row * spectrum.axes.shape[1];
"""  # the rows of V that a pair k rotates: they lie in coordinates' order


# Each pair's rows of V are rotated like a block's rows, eight columns in one instruction. V stays in the coordinates'
# order, so that only its two rows have to be found; a pair that does not rotate is left out.
@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
    typedef float Numbers __attribute__((vector_size(32), aligned(4)));
    const int others = 2 * pairs - 1;
    const float* tangent = spectrum.rotation.data + spectrum.rotation.shape[1];
    for (int k = 0; k < pairs; ++k) {{
        const float s = spectrum.rotation.data[k], tau = tangent[k];
        if (s == 0.0f) continue;
        {_SEATS}
        for (int i = 0; i < 2 * pairs; i += 8) {{
            const Numbers old_p = *(Numbers*)(p + i), old_q = *(Numbers*)(q + i);
            *(Numbers*)(p + i) = old_p - s * (old_q + tau * old_p);
            *(Numbers*)(q + i) = old_q + s * (old_p - tau * old_q);
        }}
    }}
#endif
""")
def _rotate_axes(pairs: int, round: int, spectrum: Spectrum) -> None:
    """Rotate the rows of V."""
    ...


@wp.func
def _diagonalize_alone(tournament: Tournament, spectrum: Spectrum) -> int:
    """All sweeps by one CPU thread. Returns the row of ``elements`` that the result lies in."""
    pairs = spectrum.axes.shape[0] // 2
    now = int(0)
    sweep = int(1)
    while sweep <= _SWEEPS:
        large = int(0)
        for round in range(2 * pairs - 1):
            now = 1 - now
            large |= _find_rotations(pairs, round, now, tournament, spectrum)
            for ahead in range(1, pairs // 2 + 1):
                _rotate_blocks(pairs, ahead, now, tournament, spectrum)
            _rotate_axes(pairs, round, spectrum)
        sweep = wp.where(large != 0, sweep + 1, _SWEEPS + 1)
    return now


# All sweeps on a GPU. In a round the lanes of a block have three kinds of work, which do not wait for each other:
# 1. Choosers (the first warps, a lane a pair) find the rotations of the next round. That needs the three elements of
#    the next pair, after this round: the diagonal ones are known, and the one between is rotated here from its old
#    block.
# 2. Workers rotate the 2 x 2 blocks of this round, a lane a block, from the old elements to the new ones.
# 3. Other workers rotate the rows of V, a lane four columns a quarter of a row apart.
# Then all lanes wait once, and old and new elements change places, as do this round's and the next one's rotations.
# A chooser that met a large element in a sweep notes the sweep's number. When nobody has, the matrix is diagonal.
@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    auto reciprocal = [](float x) {{ float y; asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x)); return y; }};
    auto reciprocal_root = [](float x) {{ float y; asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x)); return y; }};
    const int pairs = spectrum.axes.shape[0] / 2, others = 2 * pairs - 1, blocks = pairs * (pairs - 1) / 2;
    const int width = spectrum.rotation.shape[1] / 2, quarter = 2 * ((2 * pairs + 7) / 8);
    const int* __restrict__ moved = tournament.moved.data;
    // A's rows: four over the blocks; then over the pairs two of the diagonal, those between, and the next of these.
    const int p_row = 4 * blocks, q_row = p_row + pairs, pq_row = q_row + pairs, next_pq_row = pq_row + pairs;

    struct Block {{ int place[4], k, m; }};  // the four elements between two pairs
    auto block_at = [&](int b, int swapped) {{
        Block block;
        for (int i = 0; i < 4; ++i) block.place[i] = moved[(i ^ swapped) * blocks + b];
        block.k = b % pairs;
        block.m = block.k + b / pairs + 1;
        if (block.m >= pairs) block.m -= pairs;
        return block;
    }};
    struct Next {{ int pp, qq; Block between; float left_sign, right_sign; }};  // where a pair's next elements lie
    auto next_of = [&](int k) {{
        Next next;
        next.pp = moved[p_row + k];
        next.qq = moved[q_row + k];
        if (blocks == 0) return next;
        // A second row or column rotates like a first, by the opposite angle, after swapping the two.
        const int from = moved[pq_row + k], which = from / blocks;
        next.between = block_at(from - which * blocks, which);
        next.left_sign = which & 2 ? -1.0f : 1.0f;
        next.right_sign = which & 1 ? -1.0f : 1.0f;
        return next;
    }};
    float* element = spectrum.elements.data + spectrum.elements.shape[1];  // after the round, and before it
    float* old = spectrum.elements.data;
    float *sine = spectrum.rotation.data + width, *then_sine = spectrum.rotation.data;  // of the round, and of the next
    // Choose a pair's rotation, and leave it and the rotated elements where the round after this one looks for them.
    int large = 0;
    auto choose = [&](int k, float pp, float qq, float pq, int round, float* after, float* sine_after) {{
        {_CHOOSE}
        sine_after[k] = rotates ? s : 0.0f;
        sine_after[2 * width + k] = rotates ? tau : 0.0f;
        after[p_row + k] = rotates ? pp - change : pp;
        after[q_row + k] = rotates ? qq + change : qq;
        after[next_pq_row + k] = rotates ? 0.0f : pq;
    }};
    auto choose_next = [&](int k, const Next& next, int round) {{
        const float left = element[next_pq_row + k];
        float pq = left;
        if (blocks > 0) {{
            const Block& b = next.between;
            const float s = next.left_sign * sine[b.k], tau = next.left_sign * sine[2 * width + b.k];
            const float s_m = next.right_sign * sine[b.m], tau_m = next.right_sign * sine[2 * width + b.m];
            const float x = old[b.place[0]], right = old[b.place[1]], below = old[b.place[2]], across = old[b.place[3]];
            const float left_p = x - s * (below + tau * x), right_p = right - s * (across + tau * right);
            pq = left_p - s_m * (right_p + tau_m * left_p);
        }}
        choose(k, element[next.pp], element[next.qq], pq, round, old, then_sine);
        element[pq_row + k] = left;
    }};
    auto rotate_block = [&](int b, const Block& block) {{
        const float s = sine[block.k], tau = sine[2 * width + block.k];
        const float s_m = sine[block.m], tau_m = sine[2 * width + block.m];
        const float pp = old[block.place[0]], pq = old[block.place[1]];
        const float qp = old[block.place[2]], qq = old[block.place[3]];
        const float left_p = pp - s * (qp + tau * pp), left_q = qp + s * (pp - tau * qp);
        const float right_p = pq - s * (qq + tau * pq), right_q = qq + s * (pq - tau * qq);
        element[b] = left_p - s_m * (right_p + tau_m * left_p);
        element[blocks + b] = right_p + s_m * (left_p - tau_m * right_p);
        element[2 * blocks + b] = left_q - s_m * (right_q + tau_m * left_q);
        element[3 * blocks + b] = right_q + s_m * (left_q - tau_m * right_q);
    }};
    auto rotate_axes = [&](int k, int column, int round) {{
        const float s = sine[k], tau = sine[2 * width + k];
        if (s == 0.0f) return;
        {_SEATS}
        float old_p[4], old_q[4];  // all read before any is written: a lane waits for memory once
        for (int c = 0; c < 4; ++c) old_p[c] = p[column + c * quarter], old_q[c] = q[column + c * quarter];
        for (int c = 0; c < 4; ++c) {{
            p[column + c * quarter] = old_p[c] - s * (old_q[c] + tau * old_p[c]);
            q[column + c * quarter] = old_q[c] + s * (old_p[c] - tau * old_q[c]);
        }}
    }};

    const int choosers = 32 * ((pairs + 31) / 32);
    const bool has_workers = lanes > choosers;
    const int worker = has_workers ? lane - choosers : lane, workers = has_workers ? lanes - choosers : lanes;
    const int parts = quarter * pairs;
    const int b = worker < 0 ? blocks : worker;
    const int part = worker < 0 ? parts : workers - 1 - worker;  // first for the lanes without a block
    const int k = part / quarter, column = part - k * quarter;
    Block block;
    Next next;
    if (b < blocks) block = block_at(b, 0);
    if (lane < pairs) {{
        next = next_of(lane);
        choose(lane, old[next.pp], old[next.qq], old[moved[pq_row + lane]], 0, element, sine);
    }}
    if (lane == 0) spectrum.last_sweep.data[0] = 0.0f;
    __syncthreads();
    int now = 0;
    for (int sweep = 1; sweep <= sweeps; ++sweep) {{
        for (int round = 0; round < others; ++round) {{
            if (lane < pairs) {{
                const bool is_last = round == others - 1;
                if (is_last & large) spectrum.last_sweep.data[0] = sweep;
                if (is_last) large = 0;
                choose_next(lane, next, is_last ? 0 : round + 1);
            }}
            if (b < blocks) rotate_block(b, block);
            for (int i = b + workers; i < blocks; i += workers) rotate_block(i, block_at(i, 0));
            if (part < parts) rotate_axes(k, column, round);
            for (int i = part + workers; i < parts; i += workers) rotate_axes(i / quarter, i % quarter, round);
            __syncthreads();
            float* swapped = element; element = old; old = swapped;
            swapped = sine; sine = then_sine; then_sine = swapped;
            now ^= 1;
        }}
        // Nobody can write a number below the next sweep's before all lanes have read this.
        if (spectrum.last_sweep.data[0] < sweep) break;
    }}
    return now;
#else
    return 0;
#endif
""")
def _diagonalize_together(tournament: Tournament, spectrum: Spectrum, sweeps: int, lane: int, lanes: int) -> int:
    """All sweeps by the lanes of a GPU's block. Returns the row of ``elements`` that the result lies in."""
    ...


@wp.func
def diagonalize(tournament: Tournament, spectrum: Spectrum, lane: int, lanes: int) -> int:
    """Rotate A until it is diagonal, and the rows of ``axes`` with it.

    All ``lanes`` of a block must call: whole warps, and at least a lane for each pair.
    A lies in row 0 of ``elements``, and the result in the row that is returned.
    """
    if lanes > 1:
        return _diagonalize_together(tournament, spectrum, _SWEEPS, lane, lanes)
    return _diagonalize_alone(tournament, spectrum)


def lanes_worth(dofs: int) -> int:
    """Lanes that a matrix keeps busy: some choose, some rotate blocks, some rows of V; in fours of warps.

    An H200's multiprocessor has four schedulers: at D = 39, 512 lanes take 58 us for ask and tell, 448 take 60.
    """
    pairs = (dofs + 1) // 2
    blocks, parts = pairs * (pairs - 1) // 2, pairs * 2 * -(-dofs // 8)
    warps = sum(-(-items // 32) for items in (pairs, blocks, parts))
    return min(MOST_LANES, 128 * -(-warps // 4))
