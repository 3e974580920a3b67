"""Trackers by name. The paper's: an optimizer, and whether it searches the body's parts one after the other.

A ninth needs its optimizer's file and a line here; see docs/optimizers.md. An optimizer is imported when a search
begins, so that the list costs nothing to import.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from mmocap_warp.kernels.optimizers.populations import SearchSpace
    from mmocap_warp.optimizers.protocol import Optimizer


@dataclass(frozen=True)
class Algorithm:
    """A tracker.

    Attributes:
        source: its optimizer: ``module:class`` within this package, or what makes one.
        label: its name for people.
        hierarchical: the body's parts one after the other, instead of all degrees of freedom at once.
        partitioned: of one that is hierarchical, whether a single optimizer searches all parts, whose sizes it is given
            as ``partitions``, instead of one optimizer each.
        settings: of the optimizer, where they are not its own.
    """

    source: str | Callable[..., Optimizer]
    label: str
    hierarchical: bool
    partitioned: bool = False
    settings: dict[str, Any] = field(default_factory=dict)

    def optimizer(self, space: SearchSpace, evaluations: int, **partitions: Any) -> Optimizer:
        """An optimizer of what is searched, with the budget of the whole search."""
        make, config = self.source, {}
        if isinstance(make, str):
            module_name, _, class_name = make.partition(":")
            module = import_module(f"mmocap_warp.{module_name}")
            make = getattr(module, class_name)
            config = {"config": getattr(module, f"{class_name}Config")(**self.settings)} if self.settings else {}
        optimizer: Optimizer = make(space, evaluations, **config, **partitions)
        return optimizer


ALGORITHMS: dict[str, Algorithm] = {
    "cmaes": Algorithm("optimizers.cma_es:CmaEs", "CMAES", hierarchical=False),
    "h-cmaes": Algorithm("optimizers.cma_es:CmaEs", "H-CMAES", hierarchical=True),
    "de": Algorithm("optimizers.de:De", "DE", hierarchical=False),
    "h-de": Algorithm("optimizers.de:De", "H-DE", hierarchical=True),
    "pso": Algorithm("optimizers.pso:Pso", "PSO", hierarchical=False),
    "h-pso": Algorithm("optimizers.pso:Pso", "H-PSO", hierarchical=True),
    "apf": Algorithm("optimizers.annealed_filter:AnnealedFilter", "APF", hierarchical=False),
    "psapf": Algorithm("optimizers.annealed_filter:AnnealedFilter", "PSAPF", hierarchical=True, partitioned=True),
}
"""The labels in lower case are the paper's names; ``h-`` is the six-step hierarchy."""

CONTOUR_TRACKERS: dict[str, str | None] = {"search-contour": "h-cmaes", "contour": None}
"""Trackers that fit contours, and the algorithm that searches for them."""

BUDGETS: dict[str, int] = {"search-contour": 120, "contour": 0}
"""Evaluations of a frame's search unless something else is asked for, where that is not ``BUDGET``."""
BUDGET = 500
