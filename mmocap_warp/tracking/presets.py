"""Where the search radii come from: the step size, or the box, with which a frame's search starts; other settings."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from mmocap_warp.tracking.algorithms import ALGORITHMS, Algorithm


@dataclass(frozen=True)
class Preset:
    """Search radii of every algorithm, and where one is not run as printed, its settings.

    Attributes:
        radius: rotation [rad] and translation [m], at ``fps`` frames per second where that is given.
        own: the same for algorithms that have a radius of their own.
        fps: the frame rate that the radii are for; they grow with the frame interval. None: the same at any rate.
        filters: settings of annealed filters, by algorithm.
    """

    radius: tuple[float, float]
    own: dict[str, tuple[float, float]] = field(default_factory=dict)
    fps: float | None = None
    filters: dict[str, dict[str, Any]] = field(default_factory=dict)

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
_RECORDING = Preset(
    (0.03, 0.02),
    {
        "cmaes": (0.01, 0.0067),
        "h-cmaes": (0.02, 0.0133),
        "de": (0.08, 0.053),
        "h-de": (0.06, 0.04),
        "pso": (0.02, 0.0133),
    },
    fps=60.0,
)

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
