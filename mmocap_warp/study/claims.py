"""The paper's findings, each checked on a study's own numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from mmocap_warp.study.labels import algorithm_label
from mmocap_warp.study.statistics import ALPHA, FEWEST_PAIRS
from mmocap_warp.study.summary import MEASURES, CellSummary, Measure, StudySummary
from mmocap_warp.study.tables import (
    FEWEST_SEQUENCES,
    ModelDifference,
    Ranking,
    Row,
    by_algorithm,
    by_model,
    model_differences,
)
from mmocap_warp.study.wording import counted, named, shown, spelled

AGREES, MOSTLY, FAILS, DIFFERS, TIED = "agrees", "mostly agrees", "fails", "differs", "tied"
UNTESTED, TOO_FEW = "not tested", "cannot be judged"

EVOLUTIONARY: tuple[str, ...] = ("h-cmaes", "cmaes", "h-pso", "pso", "h-de", "de")
FILTERS: tuple[str, ...] = ("apf", "psapf")

_Key = TypeVar("_Key")


@dataclass(frozen=True)
class Finding:
    """A claim of the paper and what became of it.

    Attributes:
        claim: in the paper's sense.
        where: it is made.
        by: the measure that it was checked on.
        verdict: ``agrees`` if it holds in every case. If it does not: ``fails`` where the paper claims it of all cases,
            else ``mostly agrees`` if it holds in more than half, ``tied`` if every case is a tie, and ``differs``
            otherwise. ``not tested`` where the study has no case, ``cannot be judged`` where it has too few sequences.
        evidence: the numbers.
    """

    claim: str
    where: str
    by: str
    verdict: str
    evidence: str


def check_claims(study: StudySummary, measure: Measure) -> list[Finding]:
    """The paper's findings on a study's main preset.

    Those of section 5.3 are about the tracking error: they are judged by ``measure``. Those of section 5.4 are about
    Tables 4 to 7, which rank "best solutions' fitness": they are judged by ``measure``, and beside it by the fitness.
    """
    judged = [measure, *(other for other in study.measures if other.key == "cost" and other != measure)]
    of_ranks = zip(*(_about_ranks(study, each) for each in judged), strict=True)
    return [finding for findings in of_ranks for finding in findings] + list(_about_errors(study, measure))


def _about_ranks(study: StudySummary, measure: Measure) -> Iterator[Finding]:
    """Section 5.4, the abstract and section 6."""
    every = {
        (dof, budget): ranking
        for dof in study.models
        for budget in study.budgets
        if (ranking := by_algorithm(study, measure, dof, budget)) is not None
    }
    of_every = {name: ranking for name in study.algorithms if (ranking := by_model(study, measure, name)) is not None}
    pairs = model_differences(study, measure)
    decisive = [pair for pair in pairs if pair.sequences >= FEWEST_PAIRS]
    enough = _of_ranks(_large(every), _large(of_every), _decisive(every), _decisive(of_every), decisive)
    anyhow = _of_ranks(every, of_every, every, of_every, pairs)
    for (claim, where, judged), (_, _, judged_anyhow) in zip(enough, anyhow, strict=True):
        verdict, evidence = judged()
        if verdict == UNTESTED and judged_anyhow()[0] != UNTESTED:
            verdict, evidence = TOO_FEW, _why_too_few(study)
        yield Finding(claim, where, named(measure), verdict, evidence)


def _large(rankings: dict[_Key, Ranking]) -> dict[_Key, Ranking]:
    """Those over sequences enough to say something about sequences in general."""
    return {key: ranking for key, ranking in rankings.items() if len(ranking.sequences) >= FEWEST_SEQUENCES}


def _decisive(rankings: dict[_Key, Ranking]) -> dict[_Key, Ranking]:
    """Those over sequences enough for a difference to be significant."""
    return {key: ranking for key, ranking in rankings.items() if ranking.decisive}


def _why_too_few(study: StudySummary) -> str:
    return f"Too few for that: {spelled(len(study.sequences), 'sequence')}."


def _of_ranks(
    rankings: dict[tuple[int, int], Ranking],
    models: dict[str, Ranking],
    decisive: dict[tuple[int, int], Ranking],
    decisive_models: dict[str, Ranking],
    pairs: list[ModelDifference],
) -> tuple[tuple[str, str, Callable[[], tuple[str, str]]], ...]:
    """What the paper says of rankings by algorithm and by model, where, and how it is checked.

    What it says of significance is checked on those rankings alone that could tell.
    """
    return (
        (
            "H-CMAES has the best average rank for either model and every budget.",
            "Tables 4-5",
            lambda: _control_is(rankings, "h-cmaes"),
        ),
        (
            "In all cases the evolutionary algorithms rank before the particle filters.",
            "abstract",
            lambda: _filters_last(rankings),
        ),
        (
            "In all cases the particle filters differ significantly from the best.",
            "section 5.4",
            lambda: _filters_significant(decisive),
        ),
        (
            "In all tests searching part by part ranks before searching all at once: H-CMAES, H-PSO and H-DE before "
            "CMAES, PSO and DE.",
            "section 6",
            lambda: _hierarchy_first(rankings),
        ),
        (
            "39 degrees of freedom are better than 28 for the evolutionary algorithms.",
            "Tables 6-7",
            lambda: _larger_model(models, EVOLUTIONARY, larger_is_better=True),
        ),
        (
            "39 are significantly better than 28 for every evolutionary algorithm but CMAES.",
            "Tables 6-7",
            lambda: _significantly_larger(pairs),
        ),
        (
            "28 degrees of freedom are better than 39 for the particle filters.",
            "Tables 6-7",
            lambda: _larger_model(models, FILTERS, larger_is_better=False),
        ),
        (
            "CMAES and H-CMAES need no more than 500 evaluations with 39 degrees of freedom: nothing else is "
            "significantly better.",
            "section 5.4",
            lambda: _frugal(decisive_models, {"h-cmaes": 500, "cmaes": 500}),
        ),
        (
            "H-DE, H-PSO, DE and PSO need no more than 1500.",
            "section 5.4",
            lambda: _frugal(decisive_models, {"h-de": 1500, "h-pso": 1500, "de": 1500, "pso": 1500}),
        ),
    )


def _about_errors(study: StudySummary, measure: Measure) -> Iterator[Finding]:
    """Section 5.3."""
    jerk = next(measure for measure in MEASURES if measure.key == "jerk")
    checks: tuple[tuple[str, Measure, tuple[str, str]], ...] = (
        ("Gestures are tracked best.", measure, _gestures_first(study, measure)),
        ("Errors spread least in gestures and most in boxing.", measure, _boxing_spreads(study, measure)),
        ("Subject S3 is the hardest.", measure, _subjects(study, measure)),
        ("More evaluations narrow the errors’ spread.", measure, _narrower(study, measure)),
        ("CMAES tracks more evenly over time than DE and PSO, whose bodies vibrate.", jerk, _steadier(study, jerk)),
    )
    for claim, by, (verdict, evidence) in checks:
        if verdict != UNTESTED and len(study.sequences) < FEWEST_SEQUENCES:
            verdict, evidence = TOO_FEW, _why_too_few(study)
        yield Finding(claim, "section 5.3", named(by), verdict, evidence)


def _verdict(leads: Iterable[float], evidence: str, *, of_all: bool = False) -> tuple[str, str]:
    """The verdict and the evidence.

    Args:
        leads: of every case, above zero where it holds, below where it does not; zero is a tie.
        evidence: may name how many ``{held}`` of how many ``{cases}``; ties are added.
        of_all: the paper claims it of all cases, so that one exception refutes it, be it a tie.
    """
    signs = [int(np.sign(lead)) for lead in leads]
    held, tied = signs.count(1), signs.count(0)
    if not signs:
        return UNTESTED, "The study has no case of it."
    if held == len(signs):
        verdict = AGREES
    elif tied == len(signs):
        verdict = TIED
    elif of_all:
        verdict = FAILS
    else:
        verdict = MOSTLY if held > len(signs) / 2 else DIFFERS
    ties = f" {counted(tied, 'tie')}." if tied else ""
    return verdict, evidence.format(held=held, cases=len(signs)) + ties


def _lead(condition: bool | np.bool_) -> float:
    """A case that has no ties."""
    return 1.0 if condition else -1.0


def _control_is(rankings: dict[tuple[int, int], Ranking], algorithm: str) -> tuple[str, str]:
    with_it = [ranking for (dof, budget), ranking in rankings.items() if ranking.row(algorithm, dof, budget)]
    others = sorted({str(ranking.rows[0].contender) for ranking in with_it if _lead_of(ranking, algorithm) < 0})
    instead = f"; elsewhere {', '.join(others)}" if others else ""
    leads = [_lead_of(ranking, algorithm) for ranking in with_it]
    return _verdict(leads, "First in {held} of {cases}" + instead + ".", of_all=True)


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
    return _verdict(cases, text, of_all=True)


def _filters_significant(rankings: dict[tuple[int, int], Ranking]) -> tuple[str, str]:
    cases = [
        _lead(row.comparison.rejected)
        for ranking in rankings.values()
        if ranking.test is not None
        for row in ranking.rows
        if row.contender.algorithm in FILTERS
    ]
    return _verdict(cases, "Holm's test rejects equality with the control in {held} of {cases} cases.", of_all=True)


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
    return _verdict((lead for leads in won.values() for lead in leads), f"Better ranked: {each}.", of_all=True)


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
            shown_gain = _with_unit(-gain if measure.higher_is_better else gain, measure, sign=True)
            notes.append(f"{algorithm_label(name)} {sum(lead > 0 for lead in leads)} of {len(pairs)} ({shown_gain})")
    return _verdict(cases, f"39 ranks before 28 (mean gain): {', '.join(notes)}.")


def _significantly_larger(pairs: list[ModelDifference]) -> tuple[str, str]:
    """By Wilcoxon's signed-rank test of 39 against 28 at each budget; of CMAES it is told, and does not count."""
    cases, notes = [], []
    for name in EVOLUTIONARY:
        of = [pair for pair in pairs if pair.algorithm == name]
        better, worse = ([pair.p < ALPHA and (pair.superiority - 0.5) * sign > 0 for pair in of] for sign in (1, -1))
        cases += [_lead(each) for each in better] if name != "cmaes" else []
        notes += [f"{algorithm_label(name)} {sum(better)} of {len(of)} (worse: {sum(worse)})"] if of else []
    return _verdict(cases, f"Wilcoxon’s test below {ALPHA:g}: {', '.join(notes)}.", of_all=True)


def _frugal(models: dict[str, Ranking], budgets: dict[str, int]) -> tuple[str, str]:
    cases, notes = [], []
    for name, budget in budgets.items():
        ranking = models.get(name)
        row = ranking.row(name, 39, budget) if ranking is not None else None
        more = ranking is not None and any(other.contender.evaluations > budget for other in ranking.rows)
        if row is not None and ranking is not None and ranking.test is not None and more:
            cases.append(_lead(not row.comparison.rejected))
            best = ranking.rows[0].contender
            notes.append(f"{algorithm_label(name)}: best ranked is ({best.dof},{best.evaluations}), " + _p_of(row))
    return _verdict(cases, "; ".join(notes) + ".")


def _p_of(row: Row) -> str:
    return "the same" if np.isnan(row.comparison.p) else f"p = {row.comparison.p:.2g}"


def _gestures_first(study: StudySummary, measure: Measure) -> tuple[str, str]:
    return _in_order(_by_part(study, measure, 1, _mean), [("Gestures", "Walking"), ("Gestures", "Box")], measure)


def _boxing_spreads(study: StudySummary, measure: Measure) -> tuple[str, str]:
    """By the interquartile range over all frames of all runs; the less, the better, whatever the measure."""
    of = _by_part(study, measure, 1, _quartile_range)
    return _in_order(of, [("Gestures", "Walking"), ("Walking", "Box")], replace(measure, higher_is_better=False))


def _subjects(study: StudySummary, measure: Measure) -> tuple[str, str]:
    of = _by_part(study, measure, 0, _mean)
    verdict, evidence = _in_order(of, [("S1", "S3"), ("S2", "S3")], measure)
    made_so = " The shipped sequences are made so: S3's tracked body and masks are the worst."
    return verdict, evidence if verdict == UNTESTED else evidence + made_so


def _in_order(of: dict[str, float], pairs: list[tuple[str, str]], measure: Measure) -> tuple[str, str]:
    """Whether the first of each pair is better, where the study has all of them."""
    if not {name for pair in pairs for name in pair} <= of.keys():
        return _verdict([], "")
    sign = -1 if measure.higher_is_better else 1
    cases = [sign * (of[worse] - of[better]) for better, worse in pairs]
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
                    cases.append(_quartile_range(few, measure) - _quartile_range(many, measure))
    text = f"From {least} to {most} evaluations the interquartile range shrinks in {{held}} of {{cases}} cells."
    return _verdict(cases, text)


def _mean(cell: CellSummary, measure: Measure) -> float:
    return float(cell.runs[measure.key].mean())


def _quartile_range(cell: CellSummary, measure: Measure) -> float:
    spread = cell.spread[measure.key]
    return float(spread[3] - spread[1])


def _steadier(study: StudySummary, measure: Measure) -> tuple[str, str]:
    of = {name: _level(study, measure, name) for name in ("cmaes", "de", "pso", "h-cmaes", "h-de", "h-pso")}
    pairs = [("cmaes", "de"), ("cmaes", "pso"), ("h-cmaes", "h-de"), ("h-cmaes", "h-pso")]
    cases = [of[other] - of[mine] for mine, other in pairs if np.isfinite(of[mine]) and np.isfinite(of[other])]
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
    """Mean of a measure over the cells of the grid that fit; NaN where there is none."""
    values = [
        _mean(study.cells[cell], measure)
        for cell in study.grid
        if measure.key in study.cells[cell].runs
        and algorithm in (None, cell.algorithm)
        and dof in (None, cell.dof)
        and budget in (None, cell.evaluations)
    ]
    return float(np.mean(values)) if values else np.nan


def _by_part(
    study: StudySummary, measure: Measure, part: int, of: Callable[[CellSummary, Measure], float]
) -> dict[str, float]:
    """Mean over cells of ``of``, by the subject (part 0) or the action (part 1) of the sequences' names.

    Empty unless every subject was tracked in every action, as else one would be taken for the other.
    """
    names = [tuple(sequence.split("/")) for sequence in study.sequences if sequence.count("/") == 1]
    if len(names) != len({name[0] for name in names}) * len({name[1] for name in names}):
        return {}
    values: dict[str, list[float]] = {}
    for cell in study.grid:
        parts, summary = cell.sequence.split("/"), study.cells[cell]
        if len(parts) == 2 and measure.key in summary.spread:
            values.setdefault(parts[part], []).append(of(summary, measure))
    return {name: float(np.mean(found)) for name, found in values.items()}


def _with_unit(value: float, measure: Measure, *, sign: bool = False) -> str:
    return shown(value, measure, sign=sign) + (f" {measure.unit}" if measure.unit else "")
