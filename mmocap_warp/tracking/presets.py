"""Where the search radii come from: the step size, or the box, with which a frame's search starts."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Preset:
    """Search radii of every algorithm.

    Attributes:
        radius: rotation [rad] and translation [m], at ``fps`` frames per second where that is given.
        own: the same for algorithms that have a radius of their own.
        fps: the frame rate that the radii are for; they grow with the frame interval. None: the same at any rate.
    """

    radius: tuple[float, float]
    own: dict[str, tuple[float, float]] = field(default_factory=dict)
    fps: float | None = None

    def at(self, algorithm: str, fps: float) -> tuple[float, float]:
        """Rotation [rad] and translation [m] radius of an algorithm at a frame rate."""
        interval = 1.0 if self.fps is None else self.fps / fps
        rotation, translation = self.own.get(algorithm, self.radius)
        return rotation * interval, translation * interval


PRESETS: dict[str, Preset] = {
    # The best of a scan on a real recording at 500 evaluations, see docs/accuracy.md. CMA-ES wants to start small; DE
    # and PSO only ever contract, so that they must start wide.
    "recording": Preset(
        (0.03, 0.02),
        {
            "cmaes": (0.01, 0.0067),
            "h-cmaes": (0.02, 0.0133),
            "de": (0.08, 0.053),
            "h-de": (0.06, 0.04),
            "pso": (0.02, 0.0133),
        },
        fps=60.0,
    ),
    # Section 5.2: one radius for everything.
    "paper": Preset((0.5, 0.5)),
    # The authors' own command line: the upper default of its radius, and its filters' first-layer noise, 2 degrees.
    "authors": Preset((0.05, 0.05), dict.fromkeys(("apf", "psapf"), (0.0349, 0.01))),
}
