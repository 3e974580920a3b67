"""Reading a calibration's text, and what the text may leave open: the unit of lengths and the images' sizes."""

import math
from collections.abc import Mapping
from pathlib import Path

from mmocap_warp.cameras.rig import METRES
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.whole_file import read_text

MOST_BYTES = 2**20
"""Of the file of a calibration."""


def read_short_text(path: str | Path, kind: str, most: int = MOST_BYTES) -> str:
    """A file's text; ``kind`` says what it should be, for the remedy."""
    return read_text(path, f"give {kind}", missing=f"give {kind}", most=most)


def numbers_of(words: list[str], where: object, remedy: str) -> list[float]:
    """The finite numbers that words of a text are; an InputError with that remedy if one is none."""
    with input_errors(where, "{error}", remedy, ValueError):
        numbers = [float(word) for word in words]
    if not all(map(math.isfinite, numbers)):
        raise InputError(where, "holds a number that is not finite", remedy)
    return numbers


def number_of(text: object) -> float:
    """The number that a text is; NaN where it is none to Python, such as YAML's .nan and .inf."""
    try:
        return float(text) if isinstance(text, str) else math.nan
    except ValueError:
        return math.nan


def stated_metres(units: str | None, source: object) -> float:
    """Metres per unit of length, where a format has no unit of its own; an InputError if it is not known."""
    if units is None:
        known = " or ".join(f'"{unit}"' for unit in METRES)
        remedy = f"say which: units = {known} under [cameras] of the scene, or --units"
        raise InputError(source, "does not state the unit of its lengths", remedy)
    return METRES[units]


Sizes = Mapping[str, tuple[int, int]] | None
"""Width and height [px] of cameras' images, by name."""

EVERY_OTHER = ""
"""Stands for all cameras that are not named."""


def image_size_of(sizes: Sizes, name: str, source: object, problem: str) -> tuple[int, int]:
    """Width and height [px] of a camera's images; an InputError if unknown, its ``problem`` what the file lacks."""
    stated = sizes or {}
    if name not in stated and EVERY_OTHER not in stated:
        raise InputError(source, problem, "add the image size in pixels, or name the camera's video in the scene")
    return stated.get(name) or stated[EVERY_OTHER]
