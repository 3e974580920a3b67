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

from typing import Any

import numpy as np
import warp as wp

from mmocap_warp.kernels.block import matrix_at
from mmocap_warp.kernels.native import native_sections
from mmocap_warp.kernels.structs import allocated

wp.set_module_options({"enable_backward": False})

_native = native_sections(__file__)

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


def make_tournament(dofs: int, device: wp.DeviceLike) -> Any:
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
    return allocated(Tournament, device, start=seat[np.ix_(sat_at, sat_at)], moved=moved)


def _seated(players: int, round: int) -> np.ndarray:
    """Who sits where in a round: pair k is ``round + k`` and ``round - k``, but the last player always plays first."""
    k = np.arange(players // 2)
    others = players - 1
    second = (round - k) % others
    second[0] = others
    return np.concatenate([(round + k) % others, second])


# How a rotation is chosen, and rotates what lies within its pair (CPU):
# 1. Read the pair's diagonal elements pp and qq and the element pq between them, where the last round left them.
# 2. An element that is small beside both diagonal elements is not rotated. One that is not yet tiny makes another sweep
#    necessary.
# 3. From cot 2 angle follow sine, cosine and tangent of half the angle, without any trigonometric function. The angle
#    is the smaller of the two that make pq zero, at most an eighth of a turn, because that one converges.
# 4. Write sine and tangent twice in a row: the blocks of the pairs ahead then read them as whole vectors.
@wp.func_native(_native("find_rotations"))
def _find_rotations(pairs: int, round: int, now: int, tournament: Tournament, spectrum: Spectrum) -> int:
    """Choose the rotations that make the elements within pairs zero, and rotate these and the diagonal.

    Returns whether anything was large.
    """


# How the 2 x 2 elements between two pairs are rotated (CPU), eight pairs k in one instruction:
# 1. Gather the four elements of each block from where the last round left them.
# 2. Rotate their rows by pair k's angle, then their columns by the angle of the pair ahead. With tau, the tangent of
#    half the angle, ``c x - s y = x - s (y + tau x)``: a small correction instead of a product with a cosine near
#    one.
@wp.func_native(_native("rotate_blocks"))
def _rotate_blocks(pairs: int, ahead: int, now: int, tournament: Tournament, spectrum: Spectrum) -> None:
    """Rotate the 2 x 2 elements between each pair k and the pair ``k + ahead``, by k's rotation and by the other's."""


# Each pair's rows of V are rotated like a block's rows, eight columns in one instruction. V stays in the coordinates'
# order, so that only its two rows have to be found; a pair that does not rotate is left out.
@wp.func_native(_native("rotate_axes"))
def _rotate_axes(pairs: int, round: int, spectrum: Spectrum) -> None:
    """Rotate the rows of V."""


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
@wp.func_native(_native("diagonalize_together"))
def _diagonalize_together(tournament: Tournament, spectrum: Spectrum, sweeps: int, lane: int, lanes: int) -> int:
    """All sweeps by the lanes of a GPU's block. Returns the row of ``elements`` that the result lies in."""


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
