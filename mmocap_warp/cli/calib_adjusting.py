"""What ``mmocap calib check`` and ``refine`` are both told: which frames and body, and how to run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cyclopts import Parameter

if TYPE_CHECKING:
    from mmocap_warp.body.model import BodyModel
    from mmocap_warp.scene.recording import Scene


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class AdjustFlags:
    """Frames, body, and settings of ``AdjustConfig`` for both commands."""

    body: str | None = None
    """The generic body that the person's is near to: shipped, or a USD file. [default: the scene's, or adult_man]"""
    frames: str | None = None
    """Of the recording: first:end or first:end:stride; 20 s of them are used. [default: those of the scene]"""
    scale: float | None = None
    """Of masks and cameras, up to 1. [default: images 640 pixels long]"""
    seed: int | None = None
    """Of the random numbers. [default: 0]"""
    device: str | None = None
    """auto, cpu or a CUDA device such as cuda:0. [default: auto]"""
    threads: int | None = None
    """CPU threads. [default: all]"""

    @property
    def settings(self) -> dict[str, Any]:
        """Those of the configuration that were given."""
        given = {"scale": self.scale, "seed": self.seed, "device": self.device, "threads": self.threads}
        return {name: value for name, value in given.items() if value is not None}

    def generic_body(self, scene: Scene) -> BodyModel:
        """The body that the person's is near to.

        Raises:
            InputError: there is no such body.
        """
        from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body

        return load_body(self.body or scene.body or DEFAULT_BODY, "--body" if self.body else scene.path)
