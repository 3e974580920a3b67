"""Common time from motion alone: the shifts of views at which they share most information.

The measure of a pair at a lag is the mutual information of their signals, taken to be jointly Gaussian:
``-1/2 sum log(1 - rho^2)`` over their canonical correlations ``rho``, regularised, times the frames that overlap. It
needs no calibration, because it asks for no particular relation between two views, only that there is one. Few frames
show a relation by chance too, so the information about the other view run backwards is subtracted.

This is too little where motion repeats itself: of a walk's signals some combination fits at every lag. So those
signals that all views show alike, such as the head's height, count once more. Each is compared with itself in the other
view, and counts only where the correlation is positive.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self

import numpy as np

_NOISE = 1.0  # variance that regularises each signal, over its own variance
_LIKE_NOISE = 0.1  # the same for a signal that is compared with itself in another view
_PEAK_WIDTH = 0.1  # seconds between lags that belong to one peak
_STARTS = 8  # random starts of the search for common offsets
_ROUNDS = 50  # rounds of a search, at most


@dataclass(frozen=True, eq=False)
class PairScores:
    """How much information pairs of views share at each lag."""

    # (view, view, lag) float64, of the second view's frame ``f + lag`` with the first view's frame ``f``
    score: np.ndarray
    reach: int  # lags run from minus this to this [frames]
    near: int  # lags within this of one another belong to one peak [frames]

    def within(self, reach: int) -> Self:
        """The scores of shorter lags alone."""
        return replace(self, score=self.score[:, :, self.reach - reach : self.reach + reach + 1], reach=reach)

    def without(self, view: int) -> Self:
        """The scores of the other views."""
        return replace(self, score=np.delete(np.delete(self.score, view, 0), view, 1))

    def total(self, offsets: np.ndarray) -> float:
        """The sum over all pairs at offsets (view,); a lag out of reach counts nothing."""
        pairs = combinations(range(len(offsets)), 2)
        lags = [(one, other, int(offsets[other] - offsets[one])) for one, other in pairs]
        return float(sum(self.score[i, j, lag + self.reach] for i, j, lag in lags if abs(lag) <= self.reach))

    def best_lag(self, one: int, other: int) -> int:
        """The best lag of two views alone [frames]."""
        return int(np.argmax(self.score[one, other])) - self.reach

    def of_view(self, view: int, offsets: np.ndarray) -> np.ndarray:
        """(candidate,) mean score of a view at candidate offsets from ``-reach`` to ``reach``, others as they are.

        A candidate for which no pair's lag is within reach has minus infinity.
        """
        candidates = np.arange(-self.reach, self.reach + 1)
        total, count = np.zeros(len(candidates)), np.zeros(len(candidates))
        for other in np.delete(np.arange(len(offsets)), view):
            lag = candidates - offsets[other] + self.reach
            within = (lag >= 0) & (lag <= 2 * self.reach)
            total[within] += self.score[other, view, lag[within]]
            count += within
        return np.where(count > 0, total / np.maximum(count, 1), -np.inf)


def pair_scores(signals: list[np.ndarray], like: np.ndarray, fps: float, reach: int) -> PairScores:
    """Compare all pairs of views at lags up to ``reach`` [frames].

    Each view has ``signals`` (frame, signal), whose frames are numbered alike; their number may differ. ``like``
    (signal,) is the weight of each as one that views show alike.
    """
    views = len(signals)
    score = np.zeros((views, views, 2 * reach + 1))
    longest = max(map(len, signals))
    for one, other in combinations(range(views), 2):
        # Information at each lag, the same by chance, and that of signals compared with themselves.
        shared, by_chance, alike, frames = (np.zeros(2 * reach + 1) for _ in range(4))
        for place, lag in enumerate(range(-reach, reach + 1)):
            # Frames of one view that have a partner ``lag`` later in the other, and these partners.
            begin = max(0, -lag)
            end = max(begin, min(len(signals[one]), len(signals[other]) - lag))
            first, second = signals[one][begin:end], signals[other][begin + lag : end + lag]
            frames[place] = len(first)
            if len(first) > 2:
                shared[place] = len(first) * _information(first, second)
                by_chance[place] = len(first) * _information(first, second[::-1])
                alike[place] = len(first) * _self_information(first, second) @ like
        # What chance gives is linear in the number of frames.
        line = np.stack([np.ones_like(frames), frames / longest], axis=1)
        expected = line @ np.linalg.lstsq(line, by_chance, rcond=None)[0]
        score[one, other] = (shared - expected + alike) / longest
        score[other, one] = score[one, other, ::-1]
    return PairScores(score, reach, max(2, round(_PEAK_WIDTH * fps)))


def _information(one: np.ndarray, other: np.ndarray) -> float:
    """Mutual information of two views' signals (frame, signal), in nats a frame."""
    whitened = []
    for values in (one, other):
        centred = values - values.mean(axis=0)
        spread = centred.std(axis=0)
        scaled = centred / np.where(spread > 0, spread, 1.0)
        noisy = scaled.T @ scaled / len(scaled) + _NOISE * np.eye(scaled.shape[1])
        whitened.append(np.linalg.solve(np.linalg.cholesky(noisy), scaled.T))
    correlation = np.linalg.svd(whitened[0] @ whitened[1].T / len(one), compute_uv=False)
    return float(-0.5 * np.log1p(-(np.minimum(correlation, 1 - 1e-9) ** 2)).sum())


def _self_information(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(signal,) information of each signal about itself in the other view [nats a frame]; 0 where anticorrelated."""
    first, second = one - one.mean(axis=0), other - other.mean(axis=0)
    size = np.sqrt((first**2).sum(axis=0) * (second**2).sum(axis=0))
    correlation = (first * second).sum(axis=0) / np.where(size > 0, size, 1.0) / (1 + _LIKE_NOISE)
    return -0.5 * np.log1p(-(np.maximum(correlation, 0.0) ** 2))


def common_offsets(scores: PairScores) -> np.ndarray:
    """(view,) offsets [frames] at which all pairs together score highest; the first view's is 0.

    Offsets are improved one view at a time from several starts. Each pair votes with its whole curve, not with the
    place of its peak, so that a pair whose peak is one period off is outvoted.
    """
    views = len(scores.score)
    random = np.random.default_rng(0)
    starts = [np.zeros(views, int), np.array([0, *(scores.best_lag(0, view) for view in range(1, views))])]
    starts += [random.integers(-scores.reach // 2, scores.reach // 2 + 1, views) for _ in range(_STARTS)]

    def best_offset(view: int, offsets: np.ndarray) -> int:
        return int(np.argmax(scores.of_view(view, offsets))) - scores.reach

    ends = [move_in_turn(np.clip(each, -scores.reach, scores.reach), best_offset, _ROUNDS) for each in starts]
    best = max(ends, key=scores.total)
    return best - best[0]


def move_in_turn(offsets: np.ndarray, best_offset: Callable[[int, np.ndarray], int], rounds: int) -> np.ndarray:
    """Offsets (view,) after each view in turn has moved to its best one, until none moves, in ``rounds`` at most.

    ``best_offset`` is given a view's number and all offsets.
    """
    offsets = offsets.copy()
    for _ in range(rounds):
        before = offsets.copy()
        for view in range(len(offsets)):
            offsets[view] = best_offset(view, offsets)
        if (offsets == before).all():
            break
    return offsets
