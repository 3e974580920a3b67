"""The settings of an adjustment of cameras, checked."""

from __future__ import annotations

from dataclasses import dataclass

from mmocap_warp.body.model import Subject
from mmocap_warp.calibration.adjust.camera_changes import Deviations
from mmocap_warp.formats.toml_table import describes_settings, setting


@describes_settings
@dataclass(frozen=True)
class AdjustConfig:
    """Settings of an adjustment of cameras."""

    deviations: Deviations = setting(
        Deviations(), "How far cameras may be from their calibration.", "those of Deviations", flag=False
    )
    fixed: str | None = setting(
        None, "The camera that stands still.", "the one beside which the others move least", flag=False
    )
    height: float | None = setting(None, "Of the person, where it is known [m].", flag=False)
    distance: tuple[str, str, float] | None = setting(
        None, "Two cameras and the metres between their centres, where they are known.", flag=False
    )
    frames: int = setting(20, "Number of frames that the cameras are solved from.", flag=False)
    judges: int = setting(10, "Number of further frames that judge the cameras.", flag=False)
    scale: float | None = setting(None, "Of masks and cameras, up to 1.", "images 640 pixels long")
    seed: int = setting(0, "Of the random numbers.")
    device: str = setting("auto", "auto, cpu or a CUDA device such as cuda:0.")
    threads: int | None = setting(None, "CPU threads.", "all that this process may use")
    subject: Subject | None = setting(
        None, "The person in the pose of the first frame, where that is known.", "a body is fitted", flag=False
    )

    def __post_init__(self) -> None:
        for name in ("frames", "judges"):
            if getattr(self, name) < 2:
                raise ValueError(f"{name} must be at least 2, got {getattr(self, name)}")
        if self.scale is not None and not 0.0 < self.scale <= 1.0:
            raise ValueError(f"scale must be in (0, 1], got {self.scale}")
        for name, metres in (("height", self.height), ("distance", self.distance and self.distance[2])):
            if metres is not None and not 0.0 < metres < 100.0:
                raise ValueError(f"{name} must be in (0, 100) m, got {metres}")

    def check_names(self, cameras: tuple[str, ...]) -> None:
        """See that the named cameras are among those of the scene.

        Raises:
            ValueError: one is not.
        """
        for name, camera in (("fixed", self.fixed), *(("distance", each) for each in (self.distance or ())[:2])):
            if camera is not None and camera not in cameras:
                raise ValueError(f"{name} must name one of {', '.join(cameras)}, got {camera}")
