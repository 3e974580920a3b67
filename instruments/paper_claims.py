"""The paper's findings, each checked on a study's own numbers: ``python instruments/paper_claims.py RESULTS...``.

The folders are what ``mmocap study run`` wrote. What it prints is Markdown; docs/study/README.md draws on it, by
``study_figures.py``.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.study.overview import LOST_LIMB, radii_table, shared_sequences
from mmocap_warp.study.report_parts import Table
from mmocap_warp.study.statistics import ALPHA, FEWEST_PAIRS
from mmocap_warp.study.store import read_results
from mmocap_warp.study.study_tables import (
    FEWEST_SEQUENCES,
    ModelDifference,
    Ranking,
    algorithm_rankings,
    model_differences,
    model_rankings,
)
from mmocap_warp.study.summary import BASELINES, MEASURE_OF, CellSummary, Measure, StudySummary, algorithm_label
from mmocap_warp.study.wording import DASH, counted, named, over, with_unit

AGREES, MOSTLY, FAILS, DIFFERS, TIED = "agrees", "mostly agrees", "fails", "differs", "tied"
UNTESTED, TOO_FEW = "not tested", "cannot be judged"
_MIN_POINTS = 5  # smallest difference in lost limbs that is reported [percentage points]

EVOLUTIONARY: tuple[str, ...] = ("h-cmaes", "cmaes", "h-pso", "pso", "h-de", "de")
FILTERS: tuple[str, ...] = ("apf", "psapf")

Verdict = tuple[str, str]
"""A verdict and its evidence."""


@dataclass(frozen=True)
class Finding:
    """A claim of the paper and what became of it.

    The verdict is ``agrees`` if it holds in every case. If it does not: ``fails`` where the paper claims it of all
    cases, else ``mostly agrees`` if it holds in more than half, ``tied`` if every case is a tie, and ``differs``
    otherwise. ``not tested`` where the study has no case, ``cannot be judged`` where it has too few sequences.
    """

    claim: str
    where: str  # it is made
    by: str  # the measure that it was checked on
    verdict: str
    evidence: str  # the numbers


def check_claims(study: StudySummary, measure: Measure) -> list[Finding]:
    """The paper's findings on a study's main preset.

    Those of section 5.3 are about the tracking error: they are judged by ``measure``. Those of section 5.4 are about
    Tables 4 to 7, which rank "best solutions' fitness": they are judged by ``measure``, and beside it by the fitness.
    """
    measures = [measure, *(other for other in study.measures if other.key == "cost" and other != measure)]
    rankings = [(each, Rankings.of(study, each)) for each in measures]
    few = TOO_FEW, f"Too few for that: {counted(len(study.sequences), 'sequence', in_words=True)}."
    findings = []
    for each in CLAIMS["rankings"]:
        judge = partial(_JUDGES[each["judge"]], **each.get("with", {}))
        for by, every in rankings:
            verdict = judge(every.over_enough(significant=each.get("significant", False)))
            verdict = few if verdict[0] == UNTESTED != judge(every)[0] else verdict
            findings.append(Finding(each["claim"], each["where"], named(by), *verdict))
    for each in CLAIMS["errors"]:
        by = MEASURE_OF[each["by"]] if "by" in each else measure
        verdict = _JUDGES[each["judge"]](study, by, **each.get("with", {}))
        verdict = few if verdict[0] != UNTESTED and len(study.sequences) < FEWEST_SEQUENCES else verdict
        findings.append(Finding(each["claim"], "section 5.3", named(by), *verdict))
    return findings


def judged(leads: Iterable[float], evidence: str, *, of_all: bool = False) -> Verdict:
    """A claim's verdict and its evidence, which may name how many ``{held}`` of how many ``{cases}``.

    The ``leads`` of cases are above zero where it holds, below where it does not; zero is a tie. What the paper claims
    ``of_all`` cases one exception refutes, be it a tie.
    """
    signs = [int(np.sign(lead)) for lead in leads]
    held, tied = signs.count(1), signs.count(0)
    if not signs:
        return UNTESTED, "The study has no case of it."
    verdict = MOSTLY if held > len(signs) / 2 else DIFFERS
    if held == len(signs):
        verdict = AGREES
    elif tied == len(signs) or of_all:
        verdict = TIED if tied == len(signs) else FAILS
    return verdict, evidence.format(held=held, cases=len(signs)) + (f" {counted(tied, 'tie')}." if tied else "")


# ---- Claims about rankings: section 5.4, the abstract and section 6.


@dataclass(frozen=True)
class Rankings:
    """A study's rankings by a measure."""

    of_algorithms: list[Ranking]  # against each other, of each model and budget
    of_models: dict[str, Ranking]  # each algorithm's models and budgets, by the algorithm
    differences: list[ModelDifference]  # between the models, of each algorithm and budget

    @classmethod
    def of(cls, study: StudySummary, measure: Measure) -> Rankings:
        """All of them."""
        return cls(
            [ranking for dof in study.models for ranking in algorithm_rankings(study, measure, dof)],
            {name: ranking for name in study.algorithms for ranking in model_rankings(study, measure, [name])},
            model_differences(study, measure),
        )

    def over_enough(self, *, significant: bool) -> Rankings:
        """Those over sequences enough to speak of sequences in general, or for a difference to be significant."""

        def enough(ranking: Ranking) -> bool:
            return ranking.decisive if significant else len(ranking.sequences) >= FEWEST_SEQUENCES

        fewest = FEWEST_PAIRS if significant else FEWEST_SEQUENCES
        return Rankings(
            [ranking for ranking in self.of_algorithms if enough(ranking)],
            {name: ranking for name, ranking in self.of_models.items() if enough(ranking)},
            [pair for pair in self.differences if pair.sequences >= fewest],
        )


def _h_cmaes_first(rankings: Rankings) -> Verdict:
    """By how far its average rank is before the best of the others."""
    leads, others = [], set()
    for ranking in rankings.of_algorithms:
        rank = _average_ranks(ranking)
        if (own := rank.pop("h-cmaes", None)) is not None:
            leads.append(min(rank.values()) - own)
            others |= {str(ranking.rows[0].contender)} if leads[-1] < 0 else set()
    instead = f"; elsewhere {', '.join(sorted(others))}" if others else ""
    return judged(leads, "First in {held} of {cases}" + instead + ".", of_all=True)


def _average_ranks(ranking: Ranking) -> dict[str, float]:
    return {row.contender.algorithm: row.comparison.rank for row in ranking.rows}


def _filters_last(rankings: Rankings) -> Verdict:
    leads = []
    for rank in map(_average_ranks, rankings.of_algorithms):
        leads += [rank[other] - rank[own] for own in EVOLUTIONARY for other in FILTERS if {own, other} <= rank.keys()]
    text = "True of {held} of {cases} pairs of an evolutionary algorithm and a particle filter."
    return judged(leads, text, of_all=True)


def _filters_significant(rankings: Rankings) -> Verdict:
    tested = [ranking for ranking in rankings.of_algorithms if ranking.test is not None]
    rows = [row for ranking in tested for row in ranking.rows if row.contender.algorithm in FILTERS]
    leads = [1 if row.comparison.rejected else -1 for row in rows]
    return judged(leads, "Holm's test rejects equality with the control in {held} of {cases} cases.", of_all=True)


def _hierarchy_first(rankings: Rankings) -> Verdict:
    leads: dict[str, list[float]] = {}
    for rank in map(_average_ranks, rankings.of_algorithms):
        for name in ("cmaes", "pso", "de"):
            if {name, f"h-{name}"} <= rank.keys():
                leads.setdefault(f"h-{name}", []).append(rank[name] - rank[f"h-{name}"])
    each = ", ".join(f"{algorithm_label(name)} {sum(x > 0 for x in of)} of {len(of)}" for name, of in leads.items())
    return judged((lead for of in leads.values() for lead in of), f"Better ranked: {each}.", of_all=True)


def _larger_model(rankings: Rankings, algorithms: list[str], sign: int) -> Verdict:
    """The larger model's rank against the smaller's at each budget, among all models and budgets of an algorithm.

    ``sign`` is 1 where the larger model is claimed to be better, -1 where the smaller.
    """
    cases, notes = [], []
    for name in (name for name in algorithms if name in rankings.of_models):
        ranking = rankings.of_models[name]
        of = {(row.contender.dof, row.contender.evaluations): row for row in ranking.rows}
        pairs = [(row, of[28, budget]) for (dof, budget), row in of.items() if dof == 39 and (28, budget) in of]
        if pairs:
            leads = [small.comparison.rank - large.comparison.rank for large, small in pairs]
            cases += [sign * lead for lead in leads]
            gain = ranking.measure.sign * float(np.mean([small.mean - large.mean for large, small in pairs]))
            in_words = with_unit(gain, ranking.measure, sign=True, space=" ")
            notes.append(f"{algorithm_label(name)} {sum(lead > 0 for lead in leads)} of {len(pairs)} ({in_words})")
    return judged(cases, f"39 ranks before 28 (mean gain): {', '.join(notes)}.")


def _significantly_larger(rankings: Rankings) -> Verdict:
    """By Wilcoxon's signed-rank test of 39 against 28 at each budget; CMAES is in the evidence, and does not count."""
    cases: list[int] = []
    notes = []
    for name in EVOLUTIONARY:
        of = [pair for pair in rankings.differences if pair.algorithm == name]
        better, worse = ([pair.p < ALPHA and (pair.superiority - 0.5) * sign > 0 for pair in of] for sign in (1, -1))
        cases += [1 if each else -1 for each in better] if name != "cmaes" else []
        notes += [f"{algorithm_label(name)} {sum(better)} of {len(of)} (worse: {sum(worse)})"] if of else []
    return judged(cases, f"Wilcoxon’s test below {ALPHA:g}: {', '.join(notes)}.", of_all=True)


def _frugal(rankings: Rankings, algorithms: list[str], budget: int) -> Verdict:
    """Whether nothing is significantly better than 39 degrees of freedom with this budget."""
    cases, notes = [], []
    for name in (name for name in algorithms if name in rankings.of_models):
        ranking = rankings.of_models[name]
        row = ranking.row(name, 39, budget)
        more = any(other.contender.evaluations > budget for other in ranking.rows)
        if row is not None and ranking.test is not None and more:
            cases.append(-1 if row.comparison.rejected else 1)
            best, p = ranking.rows[0].contender, row.comparison.p
            against = "the same" if np.isnan(p) else f"p = {p:.2g}"
            notes.append(f"{algorithm_label(name)}: best ranked is ({best.dof},{best.evaluations}), {against}")
    return judged(cases, "; ".join(notes) + ".")


# ---- Claims about tracking errors: section 5.3.


def _in_order(
    study: StudySummary, measure: Measure, part: int, pairs: list[list[str]], note: str = "", spread: bool = False
) -> Verdict:
    """Whether the first of each pair of subjects (part 0) or actions (part 1) is better, where the study has them all.

    Levels are means over cells of their means, or of how they spread. Nothing is tested unless every subject was
    tracked in every action, as else one would be taken for the other.
    """
    names = [tuple(sequence.split("/")) for sequence in study.sequences if sequence.count("/") == 1]
    values: dict[str, list[float]] = {}
    for cell in study.grid:
        parts, summary = cell.sequence.split("/"), study.cells[cell]
        if len(parts) == 2 and measure.key in summary.spread:
            values.setdefault(parts[part], []).append((_quartile_range if spread else _mean)(summary, measure))
    level = {name: float(np.mean(found)) for name, found in sorted(values.items())}
    whole = len(names) == len({name[0] for name in names}) * len({name[1] for name in names})
    if not whole or not {name for pair in pairs for name in pair} <= level.keys():
        return judged([], "")
    leads = [(1 if spread else measure.sign) * (level[worse] - level[better]) for better, worse in pairs]
    words = ", ".join(f"{name} {with_unit(value, measure, space=' ')}" for name, value in level.items())
    return judged(leads, f"{words}.{note}")


def _narrower(study: StudySummary, measure: Measure) -> Verdict:
    """The least budget's interquartile range against the largest's, for every algorithm and model."""
    least, most = study.budgets[0], study.budgets[-1]
    leads = []
    for cell in study.grid if least < most else ():
        few, many = (study.cells.get(replace(cell, evaluations=budget)) for budget in (least, most))
        if cell.evaluations == least and few and many and measure.key in few.spread.keys() & many.spread.keys():
            leads.append(_quartile_range(few, measure) - _quartile_range(many, measure))
    text = f"From {least} to {most} evaluations the interquartile range shrinks in {{held}} of {{cases}} cells."
    return judged(leads, text)


def _steadier(study: StudySummary, measure: Measure) -> Verdict:
    levels = {}
    for name in ("cmaes", "de", "pso", "h-cmaes", "h-de", "h-pso"):
        cells = [study.cells[cell] for cell in study.grid if cell.algorithm == name]
        means = [_mean(cell, measure) for cell in cells if measure.key in cell.runs]
        levels |= {name: float(np.mean(means))} if means else {}
    pairs = [("cmaes", "de"), ("cmaes", "pso"), ("h-cmaes", "h-de"), ("h-cmaes", "h-pso")]
    leads = [levels[other] - levels[own] for own, other in pairs if {own, other} <= levels.keys()]
    known = [f"{algorithm_label(name)} {with_unit(value, measure, space=' ')}" for name, value in levels.items()]
    return judged(leads, f"Jerk: {', '.join(known)}.")


def _mean(cell: CellSummary, measure: Measure) -> float:
    return float(cell.runs[measure.key].mean())


def _quartile_range(cell: CellSummary, measure: Measure) -> float:
    spread = cell.spread[measure.key]
    return float(spread[3] - spread[1])


CLAIMS: dict[str, list[dict[str, Any]]] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
_JUDGES: dict[str, Callable[..., Verdict]] = {
    judge.__name__.removeprefix("_"): judge
    for judge in (
        *(_h_cmaes_first, _filters_last, _filters_significant, _hierarchy_first, _larger_model),
        *(_significantly_larger, _frugal, _in_order, _narrower, _steadier),
    )
}


# ---- The search radii: section 5.1.


def which_half(study: StudySummary) -> list[str]:
    """Which of the paper's two radii loses the limbs, and whose: a sentence per budget with both halves tracked."""
    table = radii_table(study, LOST_LIMB) if LOST_LIMB in study.measures else None
    if table is None:
        return []
    *rows, total = [dict(zip(table.head, row, strict=True)) for row in table.rows if row[0] not in BASELINES.values()]
    sentences = []
    for title in table.head:
        budget, _, preset = title.partition(": ")
        pairs = {"0.5 rad and 0.02 m": "paper-rotation", "0.02 rad and 0.5 m": "paper-translation"}
        halves = {radii: f"{budget}: {preset}" for radii, preset in pairs.items()}
        if preset != study.preset or not all(total.get(column, DASH) != DASH for column in halves.values()):
            continue
        shares = "; ".join(f"{total[column]} % with {radii}" for radii, column in halves.items())
        at = [cell for cell in study.cells if cell.preset != study.preset and f"{cell.evaluations:,}" == budget]
        sentence = (
            f"At {budget} evaluations, over {over(shared_sequences(study, at, False))}, a limb is lost in "
            f"{total[title]} % of the frames with each algorithm’s own radii; {shares}; "
            f"{total.get(f'{budget}: paper', DASH)} % with 0.5 of both, mean over the algorithms."
        )
        for radii, column in halves.items():
            gained = {row["Algorithm"]: float(row[column]) - float(row[title]) for row in rows}
            more = ", ".join(name for name, points in gained.items() if points >= _MIN_POINTS) or "none"
            less = ", ".join(name for name, points in gained.items() if points <= -_MIN_POINTS) or "none"
            limbs = f" With {radii} limbs are lost in {_MIN_POINTS} % more of the frames, or above that"
            sentence += f"{limbs}: {more}; less: {less}."
        sentences.append(sentence)
    return sentences


def main(folders: Sequence[str]) -> int:
    """Print the findings on these folders' results."""
    try:
        results = list(chain.from_iterable(map(read_results, folders)))
    except InputError as error:
        print(error, file=sys.stderr)
        return 3
    study = StudySummary.of(result for result in results if not isinstance(result, InputError))
    if not study.measures:
        print("name folders that hold results of 'mmocap study run'", file=sys.stderr)
        return 3
    rows = [astuple(finding) for finding in check_claims(study, study.measures[0])]
    print(Table("", ["Finding", "where", "here by", "verdict", "evidence"], rows).markdown("The paper's findings"))
    print(*which_half(study), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
