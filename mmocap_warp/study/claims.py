"""The paper's findings, each checked on a study's own numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from mmocap_warp.study.summary import MEASURES, CellSummary, Measure, StudySummary
from mmocap_warp.study.tables import Ranking, Row, by_algorithm, by_model
from mmocap_warp.study.wording import algorithm_label, shown

AGREES, MOSTLY, DIFFERS, UNTESTED = "agrees", "mostly agrees", "differs", "not tested"

EVOLUTIONARY: tuple[str, ...] = ("h-cmaes", "cmaes", "h-pso", "pso", "h-de", "de")
FILTERS: tuple[str, ...] = ("apf", "psapf")


@dataclass(frozen=True)
class Finding:
    """A claim of the paper and what became of it.

    Attributes:
        claim: in the paper's sense.
        where: it is made.
        verdict: ``agrees`` if it holds in every case, ``mostly agrees`` in more than half, ``differs`` otherwise, or
            ``not tested`` where the study has no case.
        evidence: the numbers.
    """

    claim: str
    where: str
    verdict: str
    evidence: str


def check_claims(study: StudySummary, measure: Measure) -> list[Finding]:
    """The paper's findings on a study's main preset, judged by one measure."""
    rankings = {
        (dof, budget): ranking
        for dof in study.models
        for budget in study.budgets
        if (ranking := by_algorithm(study, measure, dof, budget)) is not None
    }
    models = {name: ranking for name in study.algorithms if (ranking := by_model(study, measure, name)) is not None}
    checks: tuple[tuple[str, str, Callable[[], tuple[str, str]]], ...] = (
        (
            "H-CMAES has the best average rank for either model and every budget.",
            "Tables 4-5",
            lambda: _control_is(rankings, "h-cmaes"),
        ),
        (
            "The evolutionary algorithms rank before the particle filters.",
            "section 5.4",
            lambda: _filters_last(rankings),
        ),
        (
            "The particle filters differ significantly from the best.",
            "section 5.4",
            lambda: _filters_significant(rankings),
        ),
        (
            "Searching part by part ranks before searching all at once: H-CMAES, H-PSO and H-DE before CMAES, PSO, DE.",
            "section 5.4",
            lambda: _hierarchy_first(rankings),
        ),
        (
            "39 degrees of freedom are better than 28 for the evolutionary algorithms.",
            "Tables 6-7",
            lambda: _larger_model(study, measure, EVOLUTIONARY, larger_is_better=True),
        ),
        (
            "28 degrees of freedom are better than 39 for the particle filters.",
            "Tables 6-7",
            lambda: _larger_model(study, measure, FILTERS, larger_is_better=False),
        ),
        (
            "CMAES and H-CMAES reach their best with 39 degrees of freedom and 500 evaluations: more of them make no "
            "significant difference.",
            "section 5.4",
            lambda: _frugal(models, {"h-cmaes": 500, "cmaes": 500}),
        ),
        (
            "H-DE, H-PSO, DE and PSO do so with 1500.",
            "section 5.4",
            lambda: _frugal(models, {"h-de": 1500, "h-pso": 1500, "de": 1500, "pso": 1500}),
        ),
        ("Gestures are tracked best, boxing worst.", "section 5.3", lambda: _actions(study, measure)),
        ("Subject S3 is the hardest.", "section 5.3", lambda: _subjects(study, measure)),
        ("More evaluations narrow the errors’ spread.", "section 5.3", lambda: _narrower(study, measure)),
        (
            "CMAES tracks more evenly over time than DE and PSO, whose bodies vibrate.",
            "section 5.3",
            lambda: _steadier(study),
        ),
    )
    return [Finding(claim, where, *check()) for claim, where, check in checks]


def _verdict(cases: Iterable[bool], evidence: str) -> tuple[str, str]:
    held = list(cases)
    if not held:
        return UNTESTED, "The study has no case of it."
    verdict = AGREES if all(held) else MOSTLY if sum(held) > len(held) / 2 else DIFFERS
    return verdict, evidence.format(held=sum(held), cases=len(held))


def _control_is(rankings: dict[tuple[int, int], Ranking], algorithm: str) -> tuple[str, str]:
    with_it = [ranking for (dof, budget), ranking in rankings.items() if ranking.row(algorithm, dof, budget)]
    others = sorted({str(ranking.rows[0].contender) for ranking in with_it if not _led_by(ranking, algorithm)})
    instead = f"; elsewhere {', '.join(others)}" if others else ""
    return _verdict((_led_by(ranking, algorithm) for ranking in with_it), "First in {held} of {cases}" + instead + ".")


def _led_by(ranking: Ranking, algorithm: str) -> bool:
    return ranking.rows[0].contender.algorithm == algorithm


def _average_ranks(ranking: Ranking) -> dict[str, float]:
    return {row.contender.algorithm: row.comparison.rank for row in ranking.rows}


def _filters_last(rankings: dict[tuple[int, int], Ranking]) -> tuple[str, str]:
    cases = []
    for ranking in rankings.values():
        of = _average_ranks(ranking)
        cases += [of[own] < of[other] for own in EVOLUTIONARY for other in FILTERS if own in of and other in of]
    return _verdict(cases, "True of {held} of {cases} pairs of an evolutionary algorithm and a particle filter.")


def _filters_significant(rankings: dict[tuple[int, int], Ranking]) -> tuple[str, str]:
    cases = [
        row.comparison.rejected
        for ranking in rankings.values()
        if ranking.test is not None
        for row in ranking.rows
        if row.contender.algorithm in FILTERS
    ]
    return _verdict(cases, "Holm's test rejects equality with the control in {held} of {cases} cases.")


def _hierarchy_first(rankings: dict[tuple[int, int], Ranking]) -> tuple[str, str]:
    won: dict[str, list[bool]] = {}
    for ranking in rankings.values():
        of = _average_ranks(ranking)
        for name in ("cmaes", "pso", "de"):
            if name in of and f"h-{name}" in of:
                won.setdefault(name, []).append(of[f"h-{name}"] < of[name])
    each = ", ".join(f"{algorithm_label(f'h-{name}')} {sum(cases)} of {len(cases)}" for name, cases in won.items())
    return _verdict((case for cases in won.values() for case in cases), f"Better ranked: {each}.")


def _larger_model(
    study: StudySummary, measure: Measure, algorithms: tuple[str, ...], *, larger_is_better: bool
) -> tuple[str, str]:
    cases, notes = [], []
    for name in algorithms:
        pairs = [(_level(study, measure, name, 39, b), _level(study, measure, name, 28, b)) for b in study.budgets]
        known = [(large, small) for large, small in pairs if np.isfinite(large) and np.isfinite(small)]
        if known:
            gain = float(np.mean([small - large for large, small in known])) * (-1 if measure.higher_is_better else 1)
            cases.append((gain > 0) == larger_is_better)
            notes.append(f"{algorithm_label(name)} {_with_unit(gain, measure, sign=True)}")
    return _verdict(cases, f"Gain of 39 over 28, mean over budgets: {', '.join(notes)}.")


def _frugal(models: dict[str, Ranking], budgets: dict[str, int]) -> tuple[str, str]:
    cases, notes = [], []
    for name, budget in budgets.items():
        ranking = models.get(name)
        row = ranking.row(name, 39, budget) if ranking is not None else None
        more = ranking is not None and any(other.contender.evaluations > budget for other in ranking.rows)
        if row is not None and ranking is not None and ranking.test is not None and more:
            cases.append(not row.comparison.rejected)
            best = ranking.rows[0].contender
            notes.append(f"{algorithm_label(name)}: best ranked is ({best.dof},{best.evaluations}), " + _p_of(row))
    return _verdict(cases, "; ".join(notes) + ".")


def _p_of(row: Row) -> str:
    return "the same" if np.isnan(row.comparison.p) else f"p = {row.comparison.p:.2g}"


def _actions(study: StudySummary, measure: Measure) -> tuple[str, str]:
    return _in_order(_by_part(study, measure, 1), [("Gestures", "Walking"), ("Walking", "Box")], measure)


def _subjects(study: StudySummary, measure: Measure) -> tuple[str, str]:
    return _in_order(_by_part(study, measure, 0), [("S1", "S3"), ("S2", "S3")], measure)


def _in_order(of: dict[str, float], pairs: list[tuple[str, str]], measure: Measure) -> tuple[str, str]:
    """Whether the first of each pair is better, where the study has all of them."""
    if not {name for pair in pairs for name in pair} <= of.keys():
        return _verdict([], "")
    sign = -1 if measure.higher_is_better else 1
    cases = [sign * of[better] < sign * of[worse] for better, worse in pairs]
    return _verdict(cases, ", ".join(f"{name} {_with_unit(of[name], measure)}" for name in sorted(of)) + ".")


def _narrower(study: StudySummary, measure: Measure) -> tuple[str, str]:
    """The least budget's interquartile range against the largest's, for every algorithm and model."""
    least, most = study.budgets[0], study.budgets[-1]
    cases = []
    for name in study.algorithms:
        for dof in study.models:
            for sequence in study.sequences:
                few, many = (study.find(sequence, name, dof, budget) for budget in (least, most))
                if few and many and least < most and measure.key in few.spread and measure.key in many.spread:
                    cases.append(_quartile_range(many, measure) < _quartile_range(few, measure))
    text = f"From {least} to {most} evaluations the interquartile range shrinks in {{held}} of {{cases}} cells."
    return _verdict(cases, text)


def _quartile_range(cell: CellSummary, measure: Measure) -> float:
    spread = cell.spread[measure.key]
    return float(spread[3] - spread[1])


def _steadier(study: StudySummary) -> tuple[str, str]:
    measure = next(measure for measure in MEASURES if measure.key == "jerk")
    of = {name: _level(study, measure, name) for name in ("cmaes", "de", "pso", "h-cmaes", "h-de", "h-pso")}
    pairs = [("cmaes", "de"), ("cmaes", "pso"), ("h-cmaes", "h-de"), ("h-cmaes", "h-pso")]
    cases = [of[mine] < of[other] for mine, other in pairs if np.isfinite(of[mine]) and np.isfinite(of[other])]
    known = [
        f"{algorithm_label(name)} {_with_unit(value, measure)}" for name, value in of.items() if np.isfinite(value)
    ]
    return _verdict(cases, f"Jerk: {', '.join(known)}.")


def _level(
    study: StudySummary,
    measure: Measure,
    algorithm: str | None = None,
    dof: int | None = None,
    budget: int | None = None,
) -> float:
    """Mean of a measure over the cells of the main preset that fit; NaN where there is none."""
    values = [
        float(summary.runs[measure.key].mean())
        for cell, summary in study.cells.items()
        if cell.preset == study.preset
        and measure.key in summary.runs
        and algorithm in (None, cell.algorithm)
        and dof in (None, cell.dof)
        and budget in (None, cell.evaluations)
    ]
    return float(np.mean(values)) if values else np.nan


def _by_part(study: StudySummary, measure: Measure, part: int) -> dict[str, float]:
    """Mean of a measure by the subject (part 0) or the action (part 1) of the sequences' names.

    Empty unless every subject was tracked in every action, as else one would be taken for the other.
    """
    names = [tuple(sequence.split("/")) for sequence in study.sequences if sequence.count("/") == 1]
    if len(names) != len({name[0] for name in names}) * len({name[1] for name in names}):
        return {}
    values: dict[str, list[float]] = {}
    for cell, summary in study.cells.items():
        parts = cell.sequence.split("/")
        if cell.preset == study.preset and len(parts) == 2 and measure.key in summary.runs:
            values.setdefault(parts[part], []).append(float(summary.runs[measure.key].mean()))
    return {name: float(np.mean(found)) for name, found in values.items()}


def _with_unit(value: float, measure: Measure, *, sign: bool = False) -> str:
    return shown(value, measure, sign=sign) + (f" {measure.unit}" if measure.unit else "")
