"""Which of HumanEva's background clips shows the room as it was when a sequence was recorded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mmocap_warp.masks.frames import Frames, as_colour

_SAMPLES = 15
_OUTLIER = 16.0  # gray levels; where the subject is, images differ more, and by how much says nothing


def nearest_background(recording: Frames, clips: Sequence[Frames]) -> int:
    """The clip whose room looks most like the recording's start.

    HumanEva filmed the empty room at three times of a week. Light and things in the room changed meanwhile, so the
    clip nearest in time fits best, and the whole image says which that is.

    Raises:
        ValueError: a clip of another size than the recording.
    """
    if any(clip.size != recording.size for clip in clips):
        raise ValueError("background clips must have the recording's size")
    seen = _typical(recording)
    return int(np.argmin([np.minimum(np.abs(_typical(clip) - seen), _OUTLIER).mean() for clip in clips]))


def _typical(frames: Frames) -> np.ndarray:
    """(height, width, 3) median of the first images."""
    return np.median([as_colour(image) for image in frames.sample(_SAMPLES)], axis=0)
