"""HumanEva's small text files: numbers between white space (``.cal``, ``.ofs``), and named ones (``.mp``)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mmocap_warp.errors import InputError

_AGAIN = "copy it again from the data set"


def read_numbers(path: str | Path) -> np.ndarray:
    """(n,) float64, all numbers of the file.

    Raises:
        InputError: missing, not text, or something else than finite numbers.
    """
    try:
        numbers = np.array([float(word) for word in _text(path).split()])
    except ValueError as error:
        raise InputError(path, str(error), _AGAIN) from None
    if not np.isfinite(numbers).all():
        raise InputError(path, "holds a number that is not finite", _AGAIN)
    return numbers


def read_measures(path: str | Path) -> dict[str, float]:
    """Vicon's measures of a subject [mm, degrees] by name, from lines such as ``$LKneeWidth = 105.0``.

    Raises:
        InputError: missing or not text.
    """
    found = re.findall(r"^\s*\$(\w+)\s*=\s*([-+.\deE]+)\s*$", _text(path), re.M)
    try:
        return {name: float(value) for name, value in found}
    except ValueError as error:
        raise InputError(path, str(error), _AGAIN) from None


def _text(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="ascii")
    except FileNotFoundError:
        raise InputError(path, "no such file", _AGAIN) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read as text ({error})", _AGAIN) from None
