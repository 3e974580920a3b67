"""Claims of the paper about rankings, by section 5.4, the abstract and section 6, and what judges each of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mmocap_warp.study.statistics import ALPHA, FEWEST_PAIRS
from mmocap_warp.study.study_tables import (
    FEWEST_SEQUENCES,
    ModelDifference,
    Ranking,
    Row,
    by_algorithm,
    by_model,
    model_differences,
)
from mmocap_warp.study.summary import Measure, StudySummary
from mmocap_warp.study.tracker_labels import algorithm_label
from mmocap_warp.study.verdicts import judged, lead_where, with_unit

EVOLUTIONARY: tuple[str, ...] = ("h-cmaes", "cmaes", "h-pso", "pso", "h-de", "de")
FILTERS: tuple[str, ...] = ("apf", "psapf")


@dataclass(frozen=True)
class Rankings:
    """A study's rankings by a measure.

    Attributes:
        of_algorithms: against each other, by degrees of freedom and budget.
        of_models: each algorithm's models and budgets, by the algorithm.
        differences: between the models, of each algorithm and budget.
    """

    of_algorithms: dict[tuple[int, int], Ranking]
    of_models: dict[str, Ranking]
    differences: list[ModelDifference]

    @classmethod
    def of(cls, study: StudySummary, measure: Measure) -> Rankings:
        """All of them."""
        of_algorithms = {
            (dof, budget): ranking
            for dof in study.models
            for budget in study.budgets
            if (ranking := by_algorithm(study, measure, dof, budget)) is not None
        }
        of_models = {
            name: ranking for name in study.algorithms if (ranking := by_model(study, measure, name)) is not None
        }
        return cls(of_algorithms, of_models, model_differences(study, measure))

    def general(self) -> Rankings:
        """Those over sequences enough to say something about sequences in general."""
        return self._where(lambda ranking: len(ranking.sequences) >= FEWEST_SEQUENCES, FEWEST_SEQUENCES)

    def decisive(self) -> Rankings:
        """Those over sequences enough for a difference to be significant."""
        return self._where(lambda ranking: ranking.decisive, FEWEST_PAIRS)

    def _where(self, taken: Callable[[Ranking], bool], fewest: int) -> Rankings:
        return Rankings(
            {key: ranking for key, ranking in self.of_algorithms.items() if taken(ranking)},
            {key: ranking for key, ranking in self.of_models.items() if taken(ranking)},
            [pair for pair in self.differences if pair.sequences >= fewest],
        )


def rank_claims(rankings: Rankings, decisive: Rankings) -> tuple[tuple[str, str, Callable[[], tuple[str, str]]], ...]:
    """What the paper says of rankings, where, and what judges it on these; ``decisive`` could tell what is significant.

    A judge gives a verdict and its evidence.
    """
    return (
        (
            "H-CMAES has the best average rank for either model and every budget.",
            "Tables 4-5",
            lambda: _control_is(rankings.of_algorithms, "h-cmaes"),
        ),
        (
            "In all cases the evolutionary algorithms rank before the particle filters.",
            "abstract",
            lambda: _filters_last(rankings.of_algorithms),
        ),
        (
            "In all cases the particle filters differ significantly from the best.",
            "section 5.4",
            lambda: _filters_significant(decisive.of_algorithms),
        ),
        (
            "In all tests searching part by part ranks before searching all at once: H-CMAES, H-PSO and H-DE before "
            "CMAES, PSO and DE.",
            "section 6",
            lambda: _hierarchy_first(rankings.of_algorithms),
        ),
        (
            "39 degrees of freedom are better than 28 for the evolutionary algorithms.",
            "Tables 6-7",
            lambda: _larger_model(rankings.of_models, EVOLUTIONARY, larger_is_better=True),
        ),
        (
            "39 are significantly better than 28 for every evolutionary algorithm but CMAES.",
            "Tables 6-7",
            lambda: _significantly_larger(decisive.differences),
        ),
        (
            "28 degrees of freedom are better than 39 for the particle filters.",
            "Tables 6-7",
            lambda: _larger_model(rankings.of_models, FILTERS, larger_is_better=False),
        ),
        (
            "CMAES and H-CMAES need no more than 500 evaluations with 39 degrees of freedom: nothing else is "
            "significantly better.",
            "section 5.4",
            lambda: _frugal(decisive.of_models, {"h-cmaes": 500, "cmaes": 500}),
        ),
        (
            "H-DE, H-PSO, DE and PSO need no more than 1500.",
            "section 5.4",
            lambda: _frugal(decisive.of_models, {"h-de": 1500, "h-pso": 1500, "de": 1500, "pso": 1500}),
        ),
    )


def _control_is(rankings: dict[tuple[int, int], Ranking], algorithm: str) -> tuple[str, str]:
    with_it = [ranking for (dof, budget), ranking in rankings.items() if ranking.row(algorithm, dof, budget)]
    others = sorted({str(ranking.rows[0].contender) for ranking in with_it if _lead_of(ranking, algorithm) < 0})
    instead = f"; elsewhere {', '.join(others)}" if others else ""
    leads = [_lead_of(ranking, algorithm) for ranking in with_it]
    return judged(leads, "First in {held} of {cases}" + instead + ".", of_all=True)


def _lead_of(ranking: Ranking, algorithm: str) -> float:
    """How far an algorithm's average rank is before the best of the others."""
    of = _average_ranks(ranking)
    return min(rank for name, rank in of.items() if name != algorithm) - of[algorithm]


def _average_ranks(ranking: Ranking) -> dict[str, float]:
    return {row.contender.algorithm: row.comparison.rank for row in ranking.rows}


def _filters_last(rankings: dict[tuple[int, int], Ranking]) -> tuple[str, str]:
    cases = []
    for ranking in rankings.values():
        of = _average_ranks(ranking)
        cases += [of[other] - of[own] for own in EVOLUTIONARY for other in FILTERS if own in of and other in of]
    text = "True of {held} of {cases} pairs of an evolutionary algorithm and a particle filter."
    return judged(cases, text, of_all=True)


def _filters_significant(rankings: dict[tuple[int, int], Ranking]) -> tuple[str, str]:
    cases = [
        lead_where(row.comparison.rejected)
        for ranking in rankings.values()
        if ranking.test is not None
        for row in ranking.rows
        if row.contender.algorithm in FILTERS
    ]
    return judged(cases, "Holm's test rejects equality with the control in {held} of {cases} cases.", of_all=True)


def _hierarchy_first(rankings: dict[tuple[int, int], Ranking]) -> tuple[str, str]:
    won: dict[str, list[float]] = {}
    for ranking in rankings.values():
        of = _average_ranks(ranking)
        for name in ("cmaes", "pso", "de"):
            if name in of and f"h-{name}" in of:
                won.setdefault(name, []).append(of[name] - of[f"h-{name}"])
    each = ", ".join(
        f"{algorithm_label(f'h-{name}')} {sum(lead > 0 for lead in leads)} of {len(leads)}"
        for name, leads in won.items()
    )
    return judged((lead for leads in won.values() for lead in leads), f"Better ranked: {each}.", of_all=True)


def _larger_model(
    models: dict[str, Ranking], algorithms: tuple[str, ...], *, larger_is_better: bool
) -> tuple[str, str]:
    """The larger model's rank against the smaller's at each budget, among all models and budgets of an algorithm."""
    cases, notes = [], []
    for name in (name for name in algorithms if name in models):
        of = {(row.contender.dof, row.contender.evaluations): row for row in models[name].rows}
        pairs = [(row, of[28, budget]) for (dof, budget), row in of.items() if dof == 39 and (28, budget) in of]
        if pairs:
            leads = [small.comparison.rank - large.comparison.rank for large, small in pairs]
            cases += leads if larger_is_better else [-lead for lead in leads]
            measure = models[name].measure
            gain = float(np.mean([small.mean - large.mean for large, small in pairs]))
            shown_gain = with_unit(-gain if measure.higher_is_better else gain, measure, sign=True)
            notes.append(f"{algorithm_label(name)} {sum(lead > 0 for lead in leads)} of {len(pairs)} ({shown_gain})")
    return judged(cases, f"39 ranks before 28 (mean gain): {', '.join(notes)}.")


def _significantly_larger(pairs: list[ModelDifference]) -> tuple[str, str]:
    """By Wilcoxon's signed-rank test of 39 against 28 at each budget; of CMAES it is told, and does not count."""
    cases, notes = [], []
    for name in EVOLUTIONARY:
        of = [pair for pair in pairs if pair.algorithm == name]
        better, worse = ([pair.p < ALPHA and (pair.superiority - 0.5) * sign > 0 for pair in of] for sign in (1, -1))
        cases += [lead_where(each) for each in better] if name != "cmaes" else []
        notes += [f"{algorithm_label(name)} {sum(better)} of {len(of)} (worse: {sum(worse)})"] if of else []
    return judged(cases, f"Wilcoxon’s test below {ALPHA:g}: {', '.join(notes)}.", of_all=True)


def _frugal(models: dict[str, Ranking], budgets: dict[str, int]) -> tuple[str, str]:
    cases, notes = [], []
    for name, budget in budgets.items():
        ranking = models.get(name)
        row = ranking.row(name, 39, budget) if ranking is not None else None
        more = ranking is not None and any(other.contender.evaluations > budget for other in ranking.rows)
        if row is not None and ranking is not None and ranking.test is not None and more:
            cases.append(lead_where(not row.comparison.rejected))
            best = ranking.rows[0].contender
            notes.append(f"{algorithm_label(name)}: best ranked is ({best.dof},{best.evaluations}), " + _p_of(row))
    return judged(cases, "; ".join(notes) + ".")


def _p_of(row: Row) -> str:
    return "the same" if np.isnan(row.comparison.p) else f"p = {row.comparison.p:.2g}"
