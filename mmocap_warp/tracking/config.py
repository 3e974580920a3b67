"""What a tracking run is told: its settings, checked, and the search radii that follow from them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from mmocap_warp.objective.objective import COSTS
from mmocap_warp.objective.renderers import RENDERERS
from mmocap_warp.tracking.algorithms import ALGORITHMS
from mmocap_warp.tracking.presets import PRESETS


@dataclass(frozen=True)
class TrackConfig:
    """Settings of a tracking run.

    Attributes:
        algorithm: one of ``ALGORITHMS``.
        dof: degrees of freedom that are searched, by one of the body's models; None for its default. People have 39,
            28 and 51 (Table 1).
        evaluations: budget per frame; never exceeded.
        seed: of the first run; run r uses ``seed + r``.
        runs: independent runs, tracked at once.
        preset: where the radii come from.
        rotation_radius: [rad], over the preset's.
        translation_radius: [m], over the preset's.
        cost: ``paper`` (Eq. 4-5), ``xor`` or ``iou``.
        renderer: ``raycast`` or ``raster``; the counts, and so the results, are the same.
        limits: keep joints within their anatomical limits.
        scale: of masks and cameras, in (0, 1].
        device: ``auto``, ``cpu`` or a CUDA device.
        threads: CPU threads; None for all that this process may use.
    """

    algorithm: str = "h-cmaes"
    dof: int | None = None
    evaluations: int = 500
    seed: int = 0
    runs: int = 1
    preset: str = "recording"
    rotation_radius: float | None = None
    translation_radius: float | None = None
    cost: str = "paper"
    renderer: str = "raycast"
    limits: bool = True
    scale: float = 1.0
    device: str = "auto"
    threads: int | None = None

    def __post_init__(self) -> None:
        _one_of("algorithm", self.algorithm, ALGORITHMS)
        _one_of("preset", self.preset, PRESETS)
        _one_of("cost", self.cost, COSTS)
        _one_of("renderer", self.renderer, RENDERERS)
        for name in ("evaluations", "runs"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.threads is not None and self.threads < 1:
            raise ValueError(f"threads must be at least 1, got {self.threads}")
        for name in ("rotation_radius", "translation_radius"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive and finite, got {value}")
        if not 0.0 < self.scale <= 1.0:
            raise ValueError(f"scale must be in (0, 1], got {self.scale}")
        if not 0 <= self.seed < 2**31 - self.runs:
            raise ValueError(f"seed must be in 0 .. 2^31 - runs, got {self.seed}")

    def radii(self, fps: float) -> tuple[float, float]:
        """Rotation [rad] and translation [m] radius at a frame rate: the flags', or the preset's for it."""
        rotation, translation = PRESETS[self.preset].at(self.algorithm, fps)
        return self.rotation_radius or rotation, self.translation_radius or translation


def _one_of(name: str, value: object, allowed: Iterable[object]) -> None:
    if value not in allowed:
        raise ValueError(f"{name} must be one of {list(allowed)}, got {value!r}")
