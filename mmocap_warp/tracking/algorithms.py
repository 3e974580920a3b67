"""The trackers of the paper by name: an optimizer, and whether it searches the body's parts one after the other.

A ninth needs its optimizer's file and a line here; see docs/optimizers.md.
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
        optimizer: makes the optimizer of a part from ``(index, radius, runs, seed, draw, evaluations)``.
        hierarchical: six parts one after the other, instead of all degrees of freedom at once.
    """

    optimizer: Callable[..., Optimizer]
    hierarchical: bool


ALGORITHMS: dict[str, Algorithm] = {
    "cmaes": Algorithm(CmaEs, hierarchical=False),
    "h-cmaes": Algorithm(CmaEs, hierarchical=True),
    "de": Algorithm(De, hierarchical=False),
    "h-de": Algorithm(De, hierarchical=True),
    "pso": Algorithm(Pso, hierarchical=False),
    "h-pso": Algorithm(Pso, hierarchical=True),
    "apf": Algorithm(AnnealedFilter, hierarchical=False),
    "psapf": Algorithm(AnnealedFilter, hierarchical=True),
}
"""The paper's names in lower case; ``h-`` is the six-step hierarchy."""
