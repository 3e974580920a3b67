"""Trackers by name, and presets: where the search radii come from, and other settings of the paper's trackers.

A tracker of the paper is an optimizer, and whether it searches the body's parts one after the other.

A ninth needs its optimizer's file and a line here; see docs/algorithms.md. An optimizer is imported when a search
begins, so that the list costs nothing to import.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from mmocap_warp.kernels.optimizers.populations import SearchSpace
    from mmocap_warp.optimizers.search import Optimizer


@dataclass(frozen=True)
class Algorithm:
    """A tracker."""

    source: str | Callable[..., Optimizer]  # its optimizer: ``module:class`` within this package, or what makes one
    label: str  # its name for people
    hierarchical: bool  # the body's parts one after the other, instead of all degrees of freedom at once
    # of one that is hierarchical, whether a single optimizer searches all parts, whose sizes it is given as
    # ``partitions``, instead of one optimizer each
    partitioned: bool = False
    settings: dict[str, Any] = field(default_factory=dict)  # of the optimizer, where they are not its own

    def optimizer(self, space: SearchSpace, evaluations: int, **partitions: Any) -> Optimizer:
        """An optimizer of what is searched, with the budget of the whole search."""
        make, config = self.source, {}
        if isinstance(make, str):
            module_name, _, class_name = make.partition(":")
            module = import_module(f"mmocap_warp.{module_name}")
            make = getattr(module, class_name)
            config = {"config": getattr(module, f"{class_name}Config")(**self.settings)} if self.settings else {}
        return make(space, evaluations, **config, **partitions)


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


@dataclass(frozen=True)
class Preset:
    """Search radii of every algorithm, and where one is not run as printed, its settings."""

    radius: tuple[float, float]  # rotation [rad] and translation [m], at ``fps`` frames per second where that is given
    # the same for algorithms that have a radius of their own
    own: dict[str, tuple[float, float]] = field(default_factory=dict)
    # the frame rate that the radii are for; they grow with the frame interval. None: the same at any rate
    fps: float | None = None
    filters: dict[str, dict[str, Any]] = field(default_factory=dict)  # settings of annealed filters, by algorithm

    def at(self, algorithm: str, fps: float) -> tuple[float, float]:
        """Rotation [rad] and translation [m] radius of an algorithm at a frame rate."""
        interval = 1.0 if self.fps is None else self.fps / fps
        rotation, translation = self.own.get(algorithm, self.radius)
        return rotation * interval, translation * interval

    def algorithm(self, name: str) -> Algorithm:
        """An algorithm with the preset's settings."""
        algorithm = ALGORITHMS[name]
        return replace(algorithm, settings=self.filters[name]) if name in self.filters else algorithm


# The best of a scan on a real recording at 500 evaluations, see docs/accuracy.md. CMA-ES wants to start small; DE and
# PSO only ever contract, so that they must start wide.
_OWN = {"cmaes": (0.01, 0.0067), "h-cmaes": (0.02, 0.0133), "pso": (0.02, 0.0133)}
_OWN |= {"de": (0.08, 0.053), "h-de": (0.06, 0.04)}
_RECORDING = Preset((0.03, 0.02), _OWN, fps=60.0)

PRESETS: dict[str, Preset] = {
    "recording": _RECORDING,
    # APF begins each frame at its last answer, and its layers choose their own exponents. The particles that the paper
    # carries over are spread already, and the first layer spreads them again: with the same radii that is less
    # accurate, see docs/accuracy.md.
    "recording-restart": replace(_RECORDING, filters={"apf": {"carries": False}}),
    # One radius for all algorithms, where `recording` has each one's own.
    "common": Preset(_RECORDING.radius, fps=60.0),
    # Section 5.2: one radius for everything; and that of the angles or of the translation alone.
    "paper": Preset((0.5, 0.5)),
    "paper-rotation": Preset((0.5, 0.02)),
    "paper-translation": Preset((0.02, 0.5)),
    # The authors' own command line: the upper default of its radius, and its filters' first-layer noise, 2 degrees.
    "authors": Preset((0.05, 0.05), dict.fromkeys(("apf", "psapf"), (0.0349, 0.01))),
}
