"""How masks are made, as the scene's [foreground] table says."""

from __future__ import annotations

from dataclasses import dataclass

SOURCES: tuple[str, ...] = ("masks", "clean_plate", "background_video", "recording")
MODELS: tuple[str, ...] = ("gaussian", "mog2", "knn")
KEEP: tuple[str, ...] = ("all", "largest", "nearest")


@dataclass(frozen=True)
class ForegroundSettings:
    """How masks are made. Sizes are in pixels of the calibrated image and shrink with the scale.

    Attributes:
        source: ``masks`` are given; or the background is learnt from a ``clean_plate``, a ``background_video`` or the
            ``recording`` itself.
        model: what is learnt: ``gaussian`` (colour statistics per pixel), OpenCV's ``mog2`` or ``knn``.
        repair: fill holes where the other views' visual hull is thick.
    """

    source: str = "masks"
    model: str = "gaussian"
    repair: bool = False
