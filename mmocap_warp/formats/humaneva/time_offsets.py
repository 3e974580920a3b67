"""HumanEva's ``.ofs``, and how its software aligns the seven videos and the motion capture by them.

All indices are HumanEva's own: they count from 1, and those of the motion capture have fractions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.formats.humaneva.numbers import read_numbers


class StreamOffset(NamedTuple):
    """A video frame and the motion capture frame of the same moment, and how many of those pass in one of these."""

    image_start: float
    mocap_start: float
    mocap_per_image: float


@dataclass(frozen=True)
class Synchronisation:
    """Where each frame of a sequence lies in its streams.

    Frame ``n`` of the sequence is frame ``start[k] + n - 1`` of video ``k`` and lies at
    ``mocap_start + (n - 1) * mocap_per_frame`` in the motion capture.

    Attributes:
        start: (camera,) int.
        mocap_start: at least 1.
        mocap_per_frame: about 2, for 120 and 60 Hz.
    """

    start: np.ndarray
    mocap_start: float
    mocap_per_frame: float

    def mocap_position(self, frames: np.ndarray) -> np.ndarray:
        """Where frames of the sequence lie in the motion capture."""
        return self.mocap_start + (frames - 1) * self.mocap_per_frame


def read_ofs(path: str | Path) -> StreamOffset:
    """Read a camera's offset.

    Raises:
        InputError: missing, or not three finite numbers of which the last is positive.
    """
    numbers = read_numbers(path)
    if len(numbers) != 3 or numbers[2] <= 0:
        raise InputError(
            path,
            f"holds {numbers.tolist()}, not a video frame, a motion capture frame and a positive scale",
            "copy it again from the data set's corrected Sync_Data",
        )
    return StreamOffset(*numbers.tolist())


def synchronise(offsets: Sequence[StreamOffset]) -> Synchronisation:
    """Align all streams as HumanEva's software does, for cameras in its order: C1 to C3, then BW1 to BW4.

    The sequence starts where the last stream does: one video, or the motion capture, begins at its frame 1. Videos are
    shifted by whole frames, so a camera may be off by up to half a frame.
    """
    image_start, mocap_start, scale = (np.array(column) for column in zip(*offsets, strict=True))
    common, per_frame = mocap_start[0], scale.mean()
    start = image_start + (common - mocap_start) / scale
    common -= per_frame * (start.min() - 1)
    start -= start.min() - 1
    if common < 1:  # the motion capture starts last
        start -= (common - 1) / per_frame
        common = 1.0
    return Synchronisation(np.floor(start + 0.5).astype(int), float(common), float(per_frame))
