"""What a tracking run is told: its settings, checked, and the search radii that follow from them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from mmocap_warp.contour.clip.clip_problem import ACCELERATION
from mmocap_warp.silhouettes.objective import COSTS
from mmocap_warp.silhouettes.renderers import RENDERERS
from mmocap_warp.tracking.algorithms import ALGORITHMS, BUDGET, BUDGETS, CONTOUR_TRACKERS
from mmocap_warp.tracking.presets import PRESETS


@dataclass(frozen=True)
class TrackConfig:
    """Settings of a tracking run.

    Attributes:
        algorithm: one of ``ALGORITHMS`` or ``CONTOUR_TRACKERS``.
        dof: degrees of freedom that are searched, by one of the body's models; None for its default. People have 39,
            28 and 51 (Table 1).
        evaluations: budget of a frame's search, never exceeded; None for the algorithm's own. A contour tracker may
            search again where a frame was lost.
        polish: finish each frame of one of ``ALGORITHMS`` by its contours.
        smooth: standard deviation that a point's acceleration may have, for the clip as one problem [m/s^2]; 0 leaves
            the frames as they were tracked. None: ``ACCELERATION`` with contours, else 0.
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

    algorithm: str = "search-contour"
    dof: int | None = None
    evaluations: int | None = None
    polish: bool = False
    smooth: float | None = None
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
        _one_of("algorithm", self.algorithm, (*CONTOUR_TRACKERS, *ALGORITHMS))
        _one_of("preset", self.preset, PRESETS)
        _one_of("cost", self.cost, COSTS)
        _one_of("renderer", self.renderer, RENDERERS)
        for name in ("evaluations", "runs"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"{name} must be at least 1, got {value}")
        if self.polish and self.algorithm in CONTOUR_TRACKERS:
            raise ValueError(f"polish is for {list(ALGORITHMS)}; {self.algorithm} fits contours by itself")
        if self.smooth is not None and not (math.isfinite(self.smooth) and self.smooth >= 0):
            raise ValueError(f"smooth must be finite and not negative, got {self.smooth}")
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

    @property
    def budget(self) -> int:
        """Evaluations of a frame's search."""
        return BUDGETS.get(self.algorithm, BUDGET) if self.evaluations is None else self.evaluations

    @property
    def fits_contours(self) -> bool:
        """Whether frames are finished by their contours."""
        return self.polish or self.algorithm in CONTOUR_TRACKERS

    @property
    def acceleration(self) -> float:
        """What ``smooth`` means [m/s^2]; 0 for no smoothing."""
        own = ACCELERATION if self.fits_contours else 0.0
        return own if self.smooth is None else self.smooth

    def radii(self, fps: float) -> tuple[float, float]:
        """Rotation [rad] and translation [m] radius at a frame rate: the flags', or the preset's for it."""
        rotation, translation = PRESETS[self.preset].at(CONTOUR_TRACKERS.get(self.algorithm) or self.algorithm, fps)
        return self.rotation_radius or rotation, self.translation_radius or translation


def _one_of(name: str, value: object, allowed: Iterable[object]) -> None:
    if value not in allowed:
        raise ValueError(f"{name} must be one of {list(allowed)}, got {value!r}")
