"""Image sizes that a calibration may leave out, as the recording or the user tells them."""

from __future__ import annotations

from collections.abc import Mapping

from mmocap_warp.errors import InputError

EVERY_OTHER = ""
"""Stands for all cameras that are not named."""


def told_size(sizes: Mapping[str, tuple[int, int]] | None, name: str, source: object, problem: str) -> tuple[int, int]:
    """Width and height [px] of a camera's images, from elsewhere than its file.

    Raises:
        InputError: nobody has said; ``problem`` says what the file lacks.
    """
    told = sizes or {}
    if name not in told and EVERY_OTHER not in told:
        raise InputError(source, problem, "add the image size in pixels, or name the camera's video in the scene")
    return told.get(name) or told[EVERY_OTHER]
