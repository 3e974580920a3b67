"""The settings of a tracking run, checked, and the search radii that follow from them."""

import math
from dataclasses import dataclass, replace
from typing import Self

from mmocap_warp.contour import ACCELERATION
from mmocap_warp.formats.toml_table import check_kinds, describes_settings, listed, setting
from mmocap_warp.result import CONFIGURED_LENGTHS
from mmocap_warp.silhouettes import COSTS, RENDERERS
from mmocap_warp.tracking.algorithms import ALGORITHMS, BUDGET, BUDGETS, CONTOUR_TRACKERS, PRESETS

_FLAT, _BY_PARTS = ([name for name, one in ALGORITHMS.items() if one.hierarchical == parts] for parts in (False, True))

AS_GIVEN, REFINE = "as given", "refine"


@describes_settings
@dataclass(frozen=True)
class TrackConfig:
    """Settings of a tracking run."""

    algorithm: str = setting(
        next(iter(CONTOUR_TRACKERS)),
        f"{' or '.join(CONTOUR_TRACKERS)}, which fit contours, the last one without a search; or the paper's: "
        f"{', '.join(_FLAT)}, and {', '.join(_BY_PARTS)}, which search part by part.",
    )
    dof: int | None = setting(
        None,
        "Degrees of freedom that are searched, one of the body's models: of a person 39, 28 or 51 (Table 1).",
        "the body's; of a person 39",
    )
    evaluations: int | None = setting(
        None,
        "Budget of a frame's search, for each run; it is never exceeded.",
        f"{BUDGET}; {BUDGETS['search-contour']} with search-contour, where a search is needed",
    )
    polish: bool = setting(False, "Finish each frame of one of the paper's algorithms by its contours.")
    smooth: float | None = setting(
        None,
        "Standard deviation of a joint's acceleration in m/s^2, when the clip's frames are solved together; 0 leaves "
        "each frame as it was tracked.",
        f"{ACCELERATION:g} with contours, 0 with the paper's algorithms",
    )
    seed: int = setting(0, "Of the first run; run r uses seed + r.")
    runs: int = setting(1, "Independent runs, tracked at once.")
    preset: str = setting(next(iter(PRESETS)), f"Where the search radii come from: {listed(PRESETS)}.")
    rotation_radius: float | None = setting(None, "In radians, instead of the preset's.", "the preset's")
    translation_radius: float | None = setting(None, "In metres, instead of the preset's.", "the preset's")
    cost: str = setting(COSTS[0], f"{listed(COSTS)}; the first is Eq. 4-5.")
    renderer: str = setting(RENDERERS[0], f"{listed(RENDERERS)}, for the paper's algorithms; the results are the same.")
    limits: bool = setting(True, "Keep joints within their anatomical limits.")
    cameras: str = setting(
        AS_GIVEN,
        f"'{AS_GIVEN}', or '{REFINE}': cameras and times are first refined by the subject in front of them, where that "
        "is significantly better.",
    )
    scale: float = setting(
        1.0, "Of masks and cameras, up to 1.", "1; in large images less, for a subject of 220 to 440 pixels"
    )
    device: str = setting("auto", "auto, cpu or a CUDA device such as cuda:0.")
    threads: int | None = setting(None, "CPU threads.", "all that this process may use")

    def __post_init__(self) -> None:
        check_kinds(self)
        choices = {"algorithm": [*CONTOUR_TRACKERS, *ALGORITHMS], "preset": [*PRESETS], "cost": [*COSTS]}
        choices |= {"cameras": [AS_GIVEN, REFINE], "renderer": [*RENDERERS]}
        for name, allowed in choices.items():
            if (value := getattr(self, name)) not in allowed:
                raise ValueError(f"{name} must be one of {allowed}, got {value!r}")
        for name in ("evaluations", "runs", "threads"):
            if (value := getattr(self, name)) is not None and value < 1:
                raise ValueError(f"{name} must be at least 1, got {value}")
        if self.polish and self.algorithm in CONTOUR_TRACKERS:
            raise ValueError(f"polish is for {list(ALGORITHMS)}; {self.algorithm} fits contours by itself")
        if self.smooth is not None and not (math.isfinite(self.smooth) and self.smooth >= 0):
            raise ValueError(f"smooth must be finite and not negative, got {self.smooth}")
        for name in ("rotation_radius", "translation_radius"):
            if (value := getattr(self, name)) is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive and finite, got {value}")
        if not 0.0 < self.scale <= 1.0:
            raise ValueError(f"scale must be in (0, 1], got {self.scale}")
        if not 0 <= self.seed < 2**31 - self.runs:
            raise ValueError(f"seed must be in 0 .. 2^31 - 1 - runs, got {self.seed}")

    def in_unit(self, unit: float) -> Self:
        """These settings, those in metres in a unit [m]."""
        given = {name: getattr(self, name) for name in CONFIGURED_LENGTHS}
        return replace(self, **{name: value / unit for name, value in given.items() if value is not None})

    @property
    def budget(self) -> int:
        """Evaluations of a frame's search; none where an algorithm has none."""
        usual = BUDGETS.get(self.algorithm, BUDGET)
        return self.evaluations if usual and self.evaluations is not None else usual

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
