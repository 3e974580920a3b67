"""What the paper prints of its grid and its ranks, to compare with."""

from fractions import Fraction

ALGORITHM_ORDER: tuple[str, ...] = ("h-cmaes", "h-pso", "cmaes", "h-de", "de", "pso", "apf", "psapf")
"""The paper's algorithms in the order of its Table 4; their labels are ``mmocap_warp.tracking.algorithms``'s."""

BLOCKS = 9
"""Sequences: Walking, Gestures and Box of S1, S2 and S3."""

EVALUATIONS = (500, 1500, 3000)
SECONDS_PER_500 = 1.18
"""Of 500 evaluations on one core of a Core 2 Quad Q8400, with seven cameras, loading images and all else included."""

GRID_EVALUATIONS = 2.0e10
"""8366 frames x 30 seeds x 8 algorithms x 2 models x 5000 evaluations; the paper says "more than 8300" frames, and 8366
is what HumanEva's own lists of these sequences add up to."""

CPU_WEEKS = (40, 12)
"""CPUs, and the weeks that they took."""

# Table 4 (39 DOF) and Table 5 (28 DOF): average rank by algorithm, in ALGORITHM_ORDER's order.
_RANKS: dict[tuple[int, int], tuple[str, ...]] = {
    (39, 500): ("1.222", "2.333", "3.000", "3.555", "5.111", "5.888", "7.000", "7.888"),
    (39, 1500): ("2.000", "2.777", "2.666", "3.111", "4.777", "6.111", "7.555", "7.000"),
    (39, 3000): ("1.777", "2.888", "2.444", "4.000", "4.222", "6.222", "7.555", "6.888"),
    (28, 500): ("1.666", "1.888", "2.888", "4.444", "4.666", "6.111", "6.222", "8.000"),
    (28, 1500): ("2.111", "2.666", "2.444", "4.111", "5.222", "6.333", "6.777", "6.666"),
    (28, 3000): ("2.444", "2.444", "3.111", "4.111", "5.444", "5.555", "6.888", "5.999"),
}


def average_ranks(model: int, evaluations: int) -> dict[str, Fraction]:
    """Average rank by algorithm, the printed decimals restored to the ninths that nine sequences give."""
    printed = zip(ALGORITHM_ORDER, _RANKS[model, evaluations], strict=True)
    return {name: Fraction(round(float(rank) * BLOCKS), BLOCKS) for name, rank in printed}


def printed_ranks(model: int, evaluations: int) -> dict[str, float]:
    """Average rank by algorithm; empty for a model or budget that the paper does not have."""
    if (model, evaluations) not in _RANKS:
        return {}
    return {name: float(rank) for name, rank in average_ranks(model, evaluations).items()}
