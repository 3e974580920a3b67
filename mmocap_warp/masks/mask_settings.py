"""How masks are made, as the scene's [foreground] table says."""

from dataclasses import dataclass, fields, replace

MODELS: tuple[str, ...] = ("gaussian", "mog2", "knn")
BACKGROUNDS: tuple[str, ...] = ("clean_plate", "background_video", "recording")
"""The sources that are subtracted, the best first."""
SOURCES: tuple[str, ...] = ("masks", *BACKGROUNDS, "program")
SUBTRACTION: tuple[str, ...] = ("source", "model", "threshold", "noise", "shadow_brightness", "shadow_chroma")
"""Settings that decide what is subtracted; the others decide what is made of that."""
KEEP: tuple[str, ...] = ("all", "largest", "nearest")


@dataclass(frozen=True)
class ForegroundSettings:
    """How masks are made. Lengths and areas are in pixels of the calibrated image and shrink with the scale.

    Raises:
        ValueError: a value that makes no sense, by name.
    """

    # ``masks`` are given; or the background is learnt from a ``clean_plate``, a ``background_video`` or the
    # ``recording`` itself (whose subject must not stand still); or a ``program`` makes them in ``mmocap mask``.
    source: str = "masks"
    model: str = "gaussian"  # what is learnt: ``gaussian`` (colour statistics per pixel), OpenCV's ``mog2`` or ``knn``
    threshold: float = 7.0  # of ``gaussian``: Mahalanobis distance from the background beyond which is foreground
    noise: float = 4.0  # of ``gaussian`` and ``mog2``: least standard deviation per channel [gray levels of 256]
    # Of ``gaussian``: a pixel with the background's colour at this to 1 times its brightness is a shadow, thus
    # background; 1 turns that off.
    shadow_brightness: float = 0.7
    shadow_chroma: float = 3.0  # of ``gaussian``: how far, in ``noise``, a shadow's colour may be off
    median: float = 0.0  # side of the median filter [px]; 0 leaves it out, as for the following
    open: float = 0.0  # diameter of the opening [px], removes specks and thin bridges
    close: float = 0.0  # diameter of the closing [px], bridges thin gaps
    fill_holes: float = 0.0  # enclosed holes up to this area are filled [px^2]
    min_area: float = 0.0  # components below this area are dropped [px^2]
    keep: str = "all"  # ``all`` components, the ``largest``, or the ``nearest`` to where the body was last
    join: float = 40.0  # pieces up to this far apart count as one component [px]; a mask may be cut at the waist
    repair: bool = False  # fill holes where the other views' visual hull is thick
    identity: int = 0  # of given masks that show several objects, the label of the one to track; 0 for all of them

    def __post_init__(self) -> None:
        for name, choices in (("source", SOURCES), ("model", MODELS), ("keep", KEEP)):
            if getattr(self, name) not in choices:
                raise ValueError(f"{name} must be one of {choices}, got {getattr(self, name)!r}")
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not 0 <= value < 1e9:
                raise ValueError(f"{field.name} must be 0 or more and below 1e9, got {value:g}")
        if not 0 <= self.identity < 1 << 16:
            raise ValueError(f"identity must be 1 to 65535, or 0 for all, got {self.identity}")
        if self.threshold == 0 or self.noise == 0:
            raise ValueError(f"threshold and noise must be positive, got {self.threshold:g} and {self.noise:g}")
        if self.shadow_brightness > 1:
            raise ValueError(f"shadow_brightness must be 0 to 1, got {self.shadow_brightness:g}")

    @property
    def model_remembers(self) -> bool:
        """Whether what is subtracted from a frame depends on the frames before it."""
        return self.source in BACKGROUNDS and self.model == "knn"


SUBTRACTED = ForegroundSettings(
    source="clean_plate", median=12.0, close=20.0, fill_holes=1000.0, min_area=2000.0, keep="nearest"
)
"""What a scene starts from when masks are subtracted rather than given, from images of 1,920 pixels or more."""

GIVEN = ForegroundSettings(keep="nearest")
"""What a scene starts from when masks are given, or made by a program."""


def subtracted(longest: int) -> ForegroundSettings:
    """:data:`SUBTRACTED`, for images whose longer side has up to so many pixels."""
    whole, share = SUBTRACTED, min(1.0, longest / 1920)
    lengths = replace(whole, median=whole.median * share, close=whole.close * share)
    return replace(lengths, fill_holes=whole.fill_holes * share**2, min_area=whole.min_area * share**2)
