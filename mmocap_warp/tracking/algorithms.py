"""Trackers by name. The paper's: an optimizer, and whether it searches the body's parts one after the other.

A ninth needs its optimizer's file and a line here; see docs/algorithms.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mmocap_warp.optimizers.annealed_filter import AnnealedFilter
from mmocap_warp.optimizers.cma_es import CmaEs
from mmocap_warp.optimizers.de import De
from mmocap_warp.optimizers.protocol import Optimizer
from mmocap_warp.optimizers.pso import Pso


@dataclass(frozen=True)
class Algorithm:
    """A tracker.

    Attributes:
        optimizer: makes an optimizer from what it searches and the budget of the whole search.
        label: its name for people.
        hierarchical: the body's parts one after the other, instead of all degrees of freedom at once.
        partitioned: of one that is hierarchical, whether a single optimizer searches all parts, whose sizes it is given
            as ``partitions``, instead of one optimizer each.
    """

    optimizer: Callable[..., Optimizer]
    label: str
    hierarchical: bool
    partitioned: bool = False


ALGORITHMS: dict[str, Algorithm] = {
    "cmaes": Algorithm(CmaEs, "CMAES", hierarchical=False),
    "h-cmaes": Algorithm(CmaEs, "H-CMAES", hierarchical=True),
    "de": Algorithm(De, "DE", hierarchical=False),
    "h-de": Algorithm(De, "H-DE", hierarchical=True),
    "pso": Algorithm(Pso, "PSO", hierarchical=False),
    "h-pso": Algorithm(Pso, "H-PSO", hierarchical=True),
    "apf": Algorithm(AnnealedFilter, "APF", hierarchical=False),
    "psapf": Algorithm(AnnealedFilter, "PSAPF", hierarchical=True, partitioned=True),
}
"""The labels in lower case are the paper's names; ``h-`` is the six-step hierarchy."""

CONTOUR_TRACKERS: dict[str, str | None] = {"search-contour": "h-cmaes", "contour": None}
"""Trackers that fit contours, and the algorithm that searches for them."""

BUDGETS: dict[str, int] = {"search-contour": 120, "contour": 0}
"""Evaluations of a frame's search unless something else is asked for, where that is not ``BUDGET``."""
BUDGET = 500
