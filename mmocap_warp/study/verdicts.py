"""Verdicts on claims of the paper: how a study's cases are counted, and how the evidence is worded."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mmocap_warp.study.summary import Measure
from mmocap_warp.study.wording import counted, shown

AGREES, MOSTLY, FAILS, DIFFERS, TIED = "agrees", "mostly agrees", "fails", "differs", "tied"
UNTESTED, TOO_FEW = "not tested", "cannot be judged"


def judged(leads: Iterable[float], evidence: str, *, of_all: bool = False) -> tuple[str, str]:
    """A claim's verdict and its evidence.

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


def lead_where(condition: bool | np.bool_) -> float:
    """A case that has no ties."""
    return 1.0 if condition else -1.0


def with_unit(value: float, measure: Measure, *, sign: bool = False) -> str:
    """A value of a measure with its unit, within a sentence."""
    return shown(value, measure, sign=sign) + (f" {measure.unit}" if measure.unit else "")
