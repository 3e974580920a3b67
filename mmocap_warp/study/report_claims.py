"""The paper's findings, each checked on a study's own numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from mmocap_warp.study.error_claims import error_claims
from mmocap_warp.study.rank_claims import Rankings, rank_claims
from mmocap_warp.study.study_tables import FEWEST_SEQUENCES
from mmocap_warp.study.summary import Measure, StudySummary
from mmocap_warp.study.verdicts import TOO_FEW, UNTESTED
from mmocap_warp.study.wording import named, spelled


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
    """Section 5.4, the abstract and section 6.

    What they say of significance is checked on those rankings alone that could tell.
    """
    every = Rankings.of(study, measure)
    enough, anyhow = rank_claims(every.general(), every.decisive()), rank_claims(every, every)
    for (claim, where, judge), (_, _, judge_anyhow) in zip(enough, anyhow, strict=True):
        verdict, evidence = judge()
        if verdict == UNTESTED and judge_anyhow()[0] != UNTESTED:
            verdict, evidence = TOO_FEW, _why_too_few(study)
        yield Finding(claim, where, named(measure), verdict, evidence)


def _about_errors(study: StudySummary, measure: Measure) -> Iterator[Finding]:
    """Section 5.3."""
    for claim, by, (verdict, evidence) in error_claims(study, measure):
        if verdict != UNTESTED and len(study.sequences) < FEWEST_SEQUENCES:
            verdict, evidence = TOO_FEW, _why_too_few(study)
        yield Finding(claim, "section 5.3", named(by), verdict, evidence)


def _why_too_few(study: StudySummary) -> str:
    return f"Too few for that: {spelled(len(study.sequences), 'sequence')}."
