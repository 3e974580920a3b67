"""The settings of a fit, checked."""

from dataclasses import dataclass
from typing import Any

from mmocap_warp.formats.toml_table import check_kinds, describes_settings, setting

LONGEST_IMAGE = 480
"""The longer side of the images that a fit looks at unless a scale is given [px]: plenty for a shape."""

KNOWN: dict[str, Any] = {"rigid": True, "evaluations": 300, "finalists": 1}
"""Settings that find a known body. With four headings, somebody who faced between two of them was not found."""


@describes_settings
@dataclass(frozen=True)
class FitConfig:
    """Settings of a fit."""

    seed: int = setting(0, "Where random numbers begin.")
    scale: float | None = setting(
        None, "Scale of the views, up to 1.", f"images {LONGEST_IMAGE} pixels long, which is plenty for a shape"
    )
    headings: int = setting(8, "How many directions it starts from; for a body that may lie any way up, the best.")
    evaluations: int = setting(1000, "What is spent on each heading.", flag=False)
    finalists: int = setting(4, "How many headings have their limbs searched.", flag=False)
    frames: int = setting(
        16,
        "How many frames of the clip's first seconds and of later ones show the body; 1 takes the first alone.",
        flag=False,
    )
    rigid: bool | None = setting(
        None, "Find the pose alone: bones' lengths, girths and scale are known, as a robot's are.", "what the body says"
    )
    device: str = setting("auto", "auto, cpu or a CUDA device such as cuda:0.")
    threads: int | None = setting(None, "How many CPU threads work.", "all that this process may use")

    def __post_init__(self) -> None:
        check_kinds(self)
        if self.scale is not None and not 0.0 < self.scale <= 1.0:
            raise ValueError(f"scale must be in (0, 1], got {self.scale}")
        for name in ("headings", "evaluations", "finalists", "frames", "threads"):
            if (value := getattr(self, name)) is not None and value < 1:
                raise ValueError(f"{name} must be at least 1, got {value}")
        if not 0 <= self.seed < 2**31:
            raise ValueError(f"seed must be in 0 .. 2^31 - 1, got {self.seed}")
