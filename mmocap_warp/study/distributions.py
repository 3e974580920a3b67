"""Tails of the distributions that the tests need, without a statistics library."""

from __future__ import annotations

import math

_ROUNDING = 1e-16
_MAX_TERMS = 10_000


def normal_two_sided(z: float) -> float:
    """Probability that a standard normal is farther from zero than ``z``."""
    return math.erfc(abs(z) / math.sqrt(2.0))


def chi2_tail(x: float, dof: int) -> float:
    """Probability that chi-square with ``dof`` degrees of freedom exceeds ``x``: the finite sums of integer ``dof``."""
    if x <= 0:
        return 1.0
    if dof % 2 == 0:
        term = total = math.exp(-x / 2)
        for i in range(1, dof // 2):
            term *= x / (2 * i)
            total += term
        return total
    total = math.erfc(math.sqrt(x / 2))
    term = math.sqrt(2 * x / math.pi) * math.exp(-x / 2)
    for i in range((dof - 1) // 2):
        total += term
        term *= x / (2 * i + 3)
    return total


def chi2_critical(alpha: float, dof: int) -> float:
    """The value that chi-square exceeds with probability ``alpha``, by bisection."""
    low, high = 0.0, 1.0
    while chi2_tail(high, dof) > alpha:
        high *= 2
    while high - low > 1e-12 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if chi2_tail(middle, dof) > alpha else (low, middle)
    return high


def f_tail(x: float, dof: tuple[int, int]) -> float:
    """Probability that F with the given degrees of freedom exceeds ``x``."""
    if x <= 0:
        return 1.0
    if math.isinf(x):
        return 0.0
    return _incomplete_beta(dof[1] / (dof[1] + dof[0] * x), dof[1] / 2, dof[0] / 2)


def _incomplete_beta(x: float, a: float, b: float) -> float:
    """The regularised incomplete beta function I_x(a, b), by its continued fraction (DLMF 8.17.22)."""
    if x > (a + 1) / (a + b + 2):  # there the fraction converges slowly
        return 1.0 - _incomplete_beta(1.0 - x, b, a)
    log_front = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    # Steed's way from the front: each term changes the sum by `change`.
    fraction, ratio, change = 1.0, 1.0, 1.0
    for i in range(1, _MAX_TERMS):
        m, odd = divmod(i, 2)
        if odd:
            d = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        else:
            d = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        ratio = 1.0 / (1.0 + d * ratio)
        change *= ratio - 1.0
        fraction += change
        if abs(change) < _ROUNDING * abs(fraction):
            break
    return math.exp(log_front) / a * fraction
