"""Units that a calibration's lengths may have."""

from __future__ import annotations

from mmocap_warp.errors import InputError

METRES = {"m": 1.0, "mm": 0.001}
"""Metres per unit of length."""


def stated_metres(units: str | None, source: object) -> float:
    """Metres per unit of length of a file whose format has no unit of its own.

    Raises:
        InputError: nobody has said which it is.
    """
    if units is None:
        raise InputError(
            source,
            "has lengths in a unit that the format does not tell",
            'say which: units = "m" or "mm" under [cameras] of the scene, or --units',
        )
    return METRES[units]
