"""The paper's Tables 4 to 7 from a study: rankings with their tests."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from mmocap_warp.study import statistics
from mmocap_warp.study.summary import CellSummary, Contender, Measure, StudySummary

FEWEST_SEQUENCES = 3
"""From fewer, nothing is concluded about sequences in general."""


@dataclass(frozen=True)
class Row:
    """A contender's line. Intervals are bootstrapped over seeds."""

    contender: Contender
    comparison: statistics.Comparison  # rank, p-value and Holm's verdict
    rank_interval: tuple[float, float]  # of the average rank
    mean: float  # of the measure over sequences: the mean of their means over runs
    mean_interval: tuple[float, float]
    superiority: float  # Vargha and Delaney's A: the chance that a run of the control is better; NaN for the control


@dataclass(frozen=True)
class Ranking:
    """One column group of the paper's tables."""

    measure: Measure  # contenders are ranked by it
    rows: tuple[Row, ...]  # the best average rank, the control, first
    test: statistics.Omnibus | None  # None with fewer than two sequences
    sequences: tuple[str, ...]  # the blocks: those that every contender has tracked
    left_out: tuple[str, ...]  # sequences that some have not tracked
    absent: tuple[Contender, ...]  # they have tracked fewer than half as many sequences as others, and do not count
    seeds: int  # runs of each cell that count

    def row(self, algorithm: str, dof: int, evaluations: int) -> Row | None:
        """A contender's line."""
        wanted = Contender(algorithm, dof, evaluations)
        return next((row for row in self.rows if row.contender == wanted), None)


def by_algorithm(study: StudySummary, measure: Measure, dof: int, evaluations: int) -> Ranking | None:
    """A column group of Table 4 or 5: all algorithms with one model and budget; None with fewer than two."""
    return rank(study, measure, [Contender(name, dof, evaluations) for name in study.algorithms])


def by_model(study: StudySummary, measure: Measure, algorithm: str) -> Ranking | None:
    """A column group of Table 6 or 7: one algorithm with all models and budgets; None with fewer than two."""
    return rank(study, measure, [Contender(algorithm, dof, budget) for dof in study.models for budget in study.budgets])


def algorithm_rankings(study: StudySummary, measure: Measure, dof: int) -> list[Ranking]:
    """Table 4 or 5: the rankings of a model that there are, a budget each."""
    return [found for budget in study.budgets if (found := by_algorithm(study, measure, dof, budget))]


def model_rankings(study: StudySummary, measure: Measure, algorithms: Iterable[str]) -> list[Ranking]:
    """Table 6 or 7: the rankings of these algorithms' models and budgets that there are."""
    return [found for name in algorithms if (found := by_model(study, measure, name))]


def rank(study: StudySummary, measure: Measure, contenders: list[Contender]) -> Ranking | None:
    """Rank the contenders that the study has, over the sequences that all of them have tracked.

    A contender that has tracked fewer than half as many sequences as another one is left out, so that those that have
    hardly begun do not take the others' sequences away. None with fewer than two contenders, or without a sequence that
    all have tracked. A study keeps its rankings, as many figures and tables ask for the same.
    """
    key = measure, *contenders
    if key not in study.rankings:
        study.rankings[key] = _rank(study, measure, contenders)
    return study.rankings[key]


def _rank(study: StudySummary, measure: Measure, contenders: list[Contender]) -> Ranking | None:
    from scipy.stats import rankdata

    # Who counts, and over which sequences.
    known = {contender: study.known(contender, study.sequences, measure) for contender in contenders}
    most = max((len(cells) for cells in known.values()), default=0)
    found = {contender: cells for contender, cells in known.items() if 2 * len(cells) >= most > 0}
    shared = [name for name in study.sequences if all(name in cells for cells in found.values())]
    if len(found) < 2 or not shared:
        return None
    # Ranks over the sequences, and the same of runs that are drawn anew, for intervals.
    scores = _scores(found, shared, measure)
    lower = measure.sign * scores
    of_blocks = rankdata(lower.mean(axis=2), axis=-1)
    average, drawn = of_blocks.mean(axis=0), statistics.resampled_means(lower)
    known_ends = np.where(scores.shape[2] > 1, 0.0, np.nan)  # one run says nothing of others
    rank_ends = (statistics.central(rankdata(drawn, axis=-1).mean(axis=1)) + known_ends).T.tolist()
    mean_ends = (np.sort(measure.sign * statistics.central(drawn.mean(axis=1)), axis=0) + known_ends).T.tolist()
    # A row for each contender, the control first.
    comparisons, names = statistics.against_control(average, len(shared)), list(found)
    control, rows = comparisons[0].algorithm, []
    for comparison in comparisons:
        i = comparison.algorithm
        behind = statistics.superiority(lower[:, control], lower[:, i]) if i != control else np.nan
        mean = float(scores[:, i].mean())
        rows.append(Row(names[i], comparison, tuple(rank_ends[i]), mean, tuple(mean_ends[i]), behind))
    test = statistics.friedman(average, len(shared), statistics.tie_variance(of_blocks)) if len(shared) > 1 else None
    left_out = tuple(name for name in study.sequences if name not in shared)
    absent = tuple(contender for contender, cells in known.items() if cells and contender not in found)
    return Ranking(measure, tuple(rows), test, tuple(shared), left_out, absent, scores.shape[2])


@dataclass(frozen=True)
class ModelDifference:
    """39 against 28 degrees of freedom for an algorithm and a budget."""

    algorithm: str
    evaluations: int
    difference: float  # of the measure's means, the larger model's less the smaller's
    interval: tuple[float, float]  # of that, bootstrapped
    superiority: float  # the chance that a run with the larger model is better than one with the smaller
    p: float  # of Wilcoxon's test over the sequences, two-sided; NaN with fewer than ``FEWEST_SEQUENCES``
    sequences: int


def model_differences(study: StudySummary, measure: Measure) -> list[ModelDifference]:
    """The larger model against the smaller, over the sequences that both have tracked; empty with one model."""
    found = []
    for algorithm, budget in product(study.algorithms, study.budgets) if len(study.models) > 1 else ():
        models = study.models[0], study.models[-1]
        pair = {dof: study.known(Contender(algorithm, dof, budget), study.sequences, measure) for dof in models}
        shared = [name for name in study.sequences if all(name in cells for cells in pair.values())]
        if not shared:
            continue
        scores = _scores(pair, shared, measure)
        drawn, lower = statistics.resampled_means(scores), measure.sign * scores
        low, high = statistics.central((drawn[..., 0] - drawn[..., 1]).mean(axis=1)).tolist()
        low, high = (low, high) if scores.shape[2] > 1 else (np.nan, np.nan)
        difference = float((scores[:, 0] - scores[:, 1]).mean())
        better = statistics.superiority(lower[:, 0], lower[:, 1])
        p = statistics.signed_rank(scores.mean(axis=2)) if len(shared) >= FEWEST_SEQUENCES else np.nan
        found.append(ModelDifference(algorithm, budget, difference, (low, high), better, p, len(shared)))
    return found


def _scores(found: Mapping[Any, dict[str, CellSummary]], sequences: list[str], measure: Measure) -> np.ndarray:
    """(sequence, contender, run): each run's mean over frames, of the seeds that all cells have.

    Where cells share no seed, as many runs count as the shortest cell has.
    """
    cells = [[of[name] for of in found.values()] for name in sequences]
    every = [cell for row in cells for cell in row]
    seeds = list(set.intersection(*(set(cell.seeds.tolist()) for cell in every)))
    first = slice(min(len(cell.seeds) for cell in every))
    runs = [[cell.runs[measure.key][np.isin(cell.seeds, seeds) if seeds else first] for cell in row] for row in cells]
    return np.array(runs)
