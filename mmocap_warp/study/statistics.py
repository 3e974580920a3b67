"""Non-parametric comparison of algorithms over several problems, as the paper's section 5.4 does it, and more.

A *block* is a problem that every algorithm solved: one of the sequences. Scores are "lower is better" throughout.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

ALPHA = 0.05
CONFIDENCE = 0.95
RESAMPLES = 1000


@dataclass(frozen=True)
class Omnibus:
    """Do the algorithms differ at all?"""

    statistic: float  # Friedman's; distributed as chi-square with ``dof`` degrees of freedom
    dof: int  # algorithms less one
    p: float  # chance of a larger statistic, were all algorithms alike
    critical: float  # value that the statistic must exceed at level ``ALPHA``
    f: float  # Iman and Davenport's less conservative statistic, distributed as F with ``f_dof``
    f_dof: tuple[int, int]  # degrees of freedom of ``f``
    f_p: float  # the p-value of ``f``
    kendall_w: float  # agreement of the blocks' rankings, 0 none to 1 the same ranking in each: the effect's size


def friedman(average_rank: np.ndarray, blocks: int, tie_variance: float = 1.0) -> Omnibus:
    """Friedman's test from average ranks (algorithm,), with Iman-Davenport's F and Kendall's W.

    ``12 n / (k (k + 1)) * (sum R² - k (k + 1)² / 4)``, divided by ``tie_variance``, see :func:`tie_variance`. Raises a
    ValueError for fewer than two algorithms or blocks.
    """
    from scipy.stats import chi2
    from scipy.stats import f as f_distribution

    n, k = blocks, len(average_rank)
    if n < 2 or k < 2:
        raise ValueError(f"a test needs two algorithms and two blocks, got {k} and {n}")
    square_sum = float((np.asarray(average_rank) ** 2).sum())
    statistic = 12 * n / (k * (k + 1)) * (square_sum - k * (k + 1) ** 2 / 4)
    statistic = max(statistic / tie_variance, 0.0) if tie_variance > 0 else 0.0
    most, f_dof = n * (k - 1), (k - 1, (k - 1) * (n - 1))  # the statistic where all blocks agree
    f = (n - 1) * statistic / (most - statistic) if statistic < most * (1 - 1e-12) else np.inf
    p, critical = float(chi2.sf(statistic, k - 1)), float(chi2.isf(ALPHA, k - 1))
    return Omnibus(statistic, k - 1, p, critical, f, f_dof, float(f_distribution.sf(f, *f_dof)), statistic / most)


def tie_variance(rank: np.ndarray) -> float:
    """Variance of the ranks (block, algorithm) relative to that without ties: 1 without, 0 if all are equal."""
    blocks, k = rank.shape
    return float(((rank - (k + 1) / 2) ** 2).sum() / (blocks * k * (k**2 - 1) / 12))


@dataclass(frozen=True)
class Comparison:
    """An algorithm against the control, the one with the best average rank."""

    algorithm: int  # its place among the average ranks that were given
    rank: float  # the average
    z: float  # how many standard errors it ranks behind the control
    p: float  # two-sided, unadjusted; NaN for the control itself
    threshold: float  # Holm's, which ``p`` must fall below: ``ALPHA / (place - 1)``; NaN for the control
    adjusted_p: float  # Holm's, to be compared with ``ALPHA`` itself
    rejected: bool  # whether it differs from the control; Holm stops at the first that does not


def against_control(average_rank: np.ndarray, blocks: int) -> list[Comparison]:
    """Holm's procedure on ``z = (R - R_control) / sqrt(k (k + 1) / (6 n))``, best average rank first."""
    from scipy.stats import norm

    k = len(average_rank)
    order = np.argsort(average_rank, kind="stable")
    best, error = float(average_rank[order[0]]), float(np.sqrt(k * (k + 1) / (6 * blocks)))
    rows = [Comparison(int(order[0]), best, 0.0, np.nan, np.nan, np.nan, False)]
    still, adjusted = True, 0.0
    for place in range(k, 1, -1):  # from the worst, whose p is the smallest
        algorithm = int(order[place - 1])
        z = (float(average_rank[algorithm]) - best) / error
        p, threshold = 2 * float(norm.sf(z)), ALPHA / (place - 1)
        still, adjusted = still and p < threshold, max(adjusted, min(1.0, (place - 1) * p))
        rows.insert(1, Comparison(algorithm, float(average_rank[algorithm]), z, p, threshold, adjusted, still))
    return rows


def signed_rank(pairs: np.ndarray) -> float:
    """Wilcoxon's signed-rank test of (block, 2) scores: the two-sided p-value; 1 where all pairs are ties.

    Exact where there are no ties. Of nine blocks it is at least 0.0039, and 0.0078 with one against the rest.
    """
    from scipy.stats import wilcoxon

    difference = pairs[:, 0] - pairs[:, 1]
    return float(wilcoxon(difference).pvalue) if difference.any() else 1.0


def superiority(runs: np.ndarray, others: np.ndarray) -> float:
    """Vargha and Delaney's A, the chance that one of these (block, run) is below one of those: mean over blocks."""
    mine, theirs = runs[:, :, None], others[:, None, :]
    return float(((mine < theirs) + 0.5 * (mine == theirs)).mean())


def resampled_means(scores: np.ndarray) -> np.ndarray:
    """Bootstrap: means of runs drawn with replacement, for each block and algorithm apart; the blocks stay.

    From (block, algorithm, run) to (resample, block, algorithm), the same at each call.
    """
    return np.einsum("sbar,bar->sba", _shares(scores.shape), scores)


def central(samples: np.ndarray) -> np.ndarray:
    """The ends of the central interval that holds ``CONFIDENCE`` of the samples: (sample, ...) to (2, ...)."""
    tail = (1 - CONFIDENCE) / 2
    return np.quantile(samples, (tail, 1 - tail), axis=0)


@lru_cache(maxsize=4)
def _shares(shape: tuple[int, int, int]) -> np.ndarray:
    """(resample, block, algorithm, run): the share of its sample that each run makes up."""
    blocks, algorithms, runs = shape
    rng = np.random.default_rng(0)
    return rng.multinomial(runs, np.full(runs, 1 / runs), size=(RESAMPLES, blocks, algorithms)) / runs
